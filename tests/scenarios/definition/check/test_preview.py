"""What `convoy check` says of followers that hear too little of the path ahead of them."""

import pytest

from scenarios.definition.check.findings import check

SLOW_POSES = ("gnss.rate_hz=2.0",)
LATE = ("links.latency_ms=180.0",)
ALONE = ('control.fusion="predecessor"',)
GAP_KEPT = ('speed.followers="gap"', "speed.gap.headway_s=0.3")


@pytest.mark.parametrize(
    ("changes", "who", "why"),
    [
        ((), "", ""),
        (("convoy.gap_m=3.0",), "v2:", "known 5.8 m ahead, less than the 10.5 m behind"),
        (("convoy.gap_m=3.0", *ALONE), "v2, v3, v4:", "known 5.8 m ahead"),
        # 10 m and a car's length less 30 m/s for 0.18 + 0.05 s
        (LATE, "v2:", "known 8.0 m ahead"),
        ((*LATE, *ALONE), "v2, v3, v4:", "known 8.0 m ahead"),
        ((*LATE, 'control.fusion="blend"'), "v2, v3, v4:", "known 8.0 m ahead"),
        (("links.latency_ms=590.0",), "v2:", "0.0 poses of v1 lie in the preview"),
        (("links.loss_ratio=1.0",), "v2, v3, v4:", "0.0 poses"),
        (SLOW_POSES, "v2, v3, v4:", "a trajectory takes 3"),
        (("convoy.gap_m=55.0", *SLOW_POSES), "v2, v3, v4:", "1.6 poses"),
        # At least 5 m are looked ahead.
        (("control.preview_s=0.1", "gnss.rate_hz=14.0"), "v2, v3, v4:", "2.3 poses"),
        # What is sent counts, not what is measured: a CAM each 200 ms, 6 m apart.
        (("sending.kind=cam", "convoy.gap_m=11.0"), "v2:", "9.3 m of which are known"),
        (("sending={kind='fixed', rate_hz=2.0}",), "v2, v3, v4:", "a trajectory takes 3"),
        (("sending={kind='intervals', table='cam_vw_highway'}",), "v2, v3, v4:", "a trajectory"),
        (("gnss.latency_ms=150.0", "links.latency_ms=30.0"), "v2:", "known 8.0 m ahead"),
        # 3 m and 0.3 s: 12 m at 30 m/s, 17 m between the centres
        (GAP_KEPT, "", ""),
        ((*GAP_KEPT, *LATE), "v2:", "known 10.0 m ahead"),
    ],
)
def test_too_short_a_preview_is_said_in_one_line(
    changes: tuple[str, ...], who: str, why: str
) -> None:
    found = check("lane_change", changes).warnings
    assert len(found) == bool(who)
    for line in found:
        assert line.startswith(f"{who} at 30 m/s ")
        assert why in line
        assert "\n" not in line


GILBERT = 'links.loss={kind="gilbert_elliott",loss_ratio=0.5,burst_messages_mean=2.0}'
RADIO = (
    'links.radio={kind="table",distance_m=[0.0,14.0,30.0,60.0],delivery_ratio=[1.0,0.5,0.5,0.0]}'
)


@pytest.mark.parametrize("law", [GILBERT, RADIO])
def test_every_law_of_loss_thins_the_poses_alike(law: str) -> None:
    """As much as independent losses of the same share, at the distance of the source."""
    half = ("links.loss_ratio=0.5", "gnss.rate_hz=14.0", *ALONE)
    other = (law, *half[1:])
    expected = check("lane_change", half).warnings
    assert expected
    assert check("lane_change", other).warnings == expected


def test_only_the_link_that_is_late_counts() -> None:
    late = 'link=[{sender="v2",receiver="v3",latency_ms=180.0}]'
    assert check("lane_change", [late]).warnings == ()  # the lead reaches further
    (line,) = check("lane_change", [late, *ALONE]).warnings
    assert line.startswith("v3: at 30 m/s the path of v2")


def test_at_walking_pace_the_preview_is_never_too_short() -> None:
    assert check("lane_change", ["convoy.gap_m=0.1", "speed.set_mps=1.5"]).warnings == ()


def test_the_remedy_is_the_rate_that_lacks() -> None:
    (by_fixes,) = check("lane_change", SLOW_POSES).warnings
    assert "raise gnss.rate_hz or" in by_fixes
    (by_rule,) = check("lane_change", ["sending={kind='fixed', rate_hz=2.0}"]).warnings
    assert "raise the rate of sending or" in by_rule
