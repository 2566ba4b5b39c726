"""Warnings about followers that receive too few poses of the path ahead."""

import pytest

from scenarios.definition.check.findings import check

SLOW_POSES = ("gnss.rate_hz=2.0",)
LATE = ("links.latency_ms=180.0",)
ALONE = ('information_flow.lateral="predecessor"',)
GAP_KEPT = ('speed.followers="gap"', "speed.gap.headway_s=0.3")


@pytest.mark.parametrize(
    ("changes", "names", "facts"),
    [
        ((), "", ""),
        (("convoy.gap_m=3.0",), "v2:", "known 5.8 m ahead (10.5 m needed)"),
        (("convoy.gap_m=3.0", *ALONE), "v2, v3, v4:", "known 5.8 m ahead"),
        # 10 m and a car's length less 30 m/s for 0.18 + 0.05 s
        (LATE, "v2:", "known 8.0 m ahead"),
        ((*LATE, *ALONE), "v2, v3, v4:", "known 8.0 m ahead"),
        ((*LATE, 'control.fusion="blend"'), "v2, v3, v4:", "known 8.0 m ahead"),
        (("links.latency_ms=590.0",), "v2:", "0.0 poses of v1"),
        (("links.loss_ratio=1.0",), "v2, v3, v4:", "0.0 poses"),
        (SLOW_POSES, "v2, v3, v4:", "(3 needed)"),
        (("convoy.gap_m=55.0", *SLOW_POSES), "v2, v3, v4:", "1.6 poses"),
        # The preview is at least 5 m.
        (("control.preview_s=0.1", "gnss.rate_hz=14.0"), "v2, v3, v4:", "2.3 poses"),
        # The rate of sending counts, not that of measuring: a CAM every 200 ms, 6 m apart.
        (("sending.kind=cam", "convoy.gap_m=11.0"), "v2:", "9.3 m of known path"),
        (("sending={kind='fixed', rate_hz=2.0}",), "v2, v3, v4:", "(3 needed)"),
        (("sending={kind='intervals', table='cam_vw_highway'}",), "v2, v3, v4:", "(3 needed)"),
        (("gnss.latency_ms=150.0", "links.latency_ms=30.0"), "v2:", "known 8.0 m ahead"),
        # 3 m and 0.3 s: 12 m at 30 m/s, 17 m between the centres
        (GAP_KEPT, "", ""),
        ((*GAP_KEPT, *LATE), "v2:", "known 10.0 m ahead"),
    ],
)
def test_too_short_a_preview_gets_one_line(
    changes: tuple[str, ...], names: str, facts: str
) -> None:
    warnings = check("lane_change", changes).warnings
    assert len(warnings) == bool(names)
    for line in warnings:
        assert line.startswith(f"{names} at 30 m/s ")
        assert facts in line
        assert "\n" not in line
        assert "Raise" in line or "Lower" in line or "Reduce" in line


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


@pytest.mark.parametrize(
    ("cut", "others", "warned"),
    [
        ("at_s=8.0, for_s=14.0", (), True),
        ("at_s=8.0, for_s=14.0, receiver='v3'", (), True),
        ("at_s=8.0, for_s=9.0", (), False),
        ("at_s=8.0", (), False),  # there are no poses after it
        ("at_s=8.0, for_s=14.0, sender='v2', receiver='v3'", (), False),
        ("at_s=8.0, for_s=14.0", ("speed.lead_waits=true",), False),
        ("at_s=8.0, for_s=14.0", ("sending.path_history_m=500.0",), False),
    ],
)
def test_cuts_in_which_the_lead_drives_beyond_its_history_are_named(
    cut: str, others: tuple[str, ...], warned: bool
) -> None:
    lines = check("lane_change", (f"change=[{{kind='cut', {cut}}}]", *others)).warnings
    assert any("420 m" in line and "300 m" in line for line in lines) == warned
