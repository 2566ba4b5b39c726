"""Links that copy, corrupt and falsify messages: nothing breaks, all is counted."""

from collections import Counter
from functools import cache
from math import isfinite, isnan

import pytest

from scenarios.definition.scenario import load_scenario
from tests.made.convoys.driven import Driven, driven
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import Command, GpsPose, LinkVerdict, LogText, Tracking, TruePose

RATE_LIMIT, PERIOD = 1.18, 0.02
"""How fast front wheels turn (rad/s), and the time (s) from one command to the next."""

DURATION_S = 4.4
"""Until after all false content has ended."""
CASES = {
    "offset": ("{false=[{kind='offset', left_m=1.5, from_s=1.0, to_s=3.0}]}", {"", "offset"}),
    "far offset": ("{false=[{kind='offset', east_m=9e3, from_s=1.0, to_s=3.0}]}", {"", "offset"}),
    "drift": ("{false=[{kind='drift', left_mps=0.4, from_s=1.0}]}", {"", "drift"}),
    "frozen": ("{false=[{kind='frozen', from_s=1.0, to_s=3.0}]}", {"", "frozen"}),
    "replayed": ("{false=[{kind='replayed', age_s=1.0, from_s=1.0}]}", {"", "replayed"}),
    "ghost": ("{false=[{kind='ghost', ahead_m=2.0, left_m=1.0, from_s=1.0}]}", {"", "ghost"}),
    "far ghost": ("{false=[{kind='ghost', ahead_m=-30.0, from_s=1.0}]}", {"", "ghost"}),
    "all at once": (
        "{bit_error_ratio=2e-4, frame_check=false, duplicate_ratio=0.3, filter_duplicates=false,"
        " reorder_ratio=0.2, false=[{kind='replayed', age_s=0.5, from_s=1.0, to_s=2.0},"
        " {kind='drift', ahead_mps=-3.0, from_s=2.0, to_s=4.0}, {kind='ghost', left_m=2.0}]}",
        {"ghost", "replayed+ghost", "drift+ghost"},
    ),
    "wrong bits": ("{bit_error_ratio=3e-4}", {""}),
    "wrong bits accepted": ("{bit_error_ratio=1e-3, frame_check=false}", {"", "corrupted"}),
    "copies": ("{duplicate_ratio=0.5, reorder_ratio=0.2}", {""}),
    "copies accepted": (
        "{duplicate_ratio=0.5, filter_duplicates=false, reorder_ratio=0.2}", {""}
    ),
}  # fmt: skip


@cache
def drive(content: str, followers: str = "same") -> Driven:
    """Drive three cars into the lane change."""
    return driven(
        "lane_change",
        "convoy.vehicles=3",
        f"duration_s={DURATION_S}",
        f"speed.followers={followers!r}",
        f"links.content={content}",
    )


@pytest.mark.spread(6)
@pytest.mark.parametrize("followers", ["same", "gap"])
@pytest.mark.parametrize("case", CASES)
def test_followers_survive_any_message(case: str, followers: str) -> None:
    content, kinds = CASES[case]
    run = drive(content, followers)
    assert not [m.text for m in run.all(LogText) if m.level == "fatal"]
    last: dict[str, float] = {}
    commands = run.all(Command)
    assert len(commands) == 3 * round(DURATION_S / PERIOD)
    for one in commands:
        assert isfinite(one.steering_rad + one.acceleration_mps2 + one.target_speed_mps)
        assert abs(one.steering_rad) <= LINCOLN_MKZ.steering_limit
        turned = abs(one.steering_rad - last.get(one.vehicle, one.steering_rad))
        assert turned <= RATE_LIMIT * PERIOD * (1.0 + 1e-9)
        assert -6.0 - 1e-9 <= one.acceleration_mps2 <= 2.0 + 1e-9
        last[one.vehicle] = one.steering_rad
    for track in run.all(Tracking):
        assert not isnan(track.lateral_error_m + track.heading_error_rad + track.curvature_per_m)
    verdicts = run.all(LinkVerdict)
    assert kinds <= {v.content for v in verdicts if v.outcome == "delivered"}


@pytest.mark.spread(4)
@pytest.mark.parametrize("case", CASES)
def test_the_log_holds_what_was_sent_and_a_verdict_on_each(case: str) -> None:
    content, _ = CASES[case]
    run = drive(content)
    plane = LocalPlane(load_scenario("lane_change").origin)
    poses = run.all(GpsPose)
    truths = {(m.vehicle, m.true_at_ns): m for m in run.all(TruePose)}
    measured = 0
    for pose in poses:
        if truth := truths.get((pose.vehicle, pose.measured_at_ns)):
            east, north = plane.to_plane(pose.latitude_deg, pose.longitude_deg, pose.altitude_m)
            assert abs(east - truth.east_m) + abs(north - truth.north_m) < 0.2
            measured += 1
    assert measured > 100
    verdicts = run.all(LinkVerdict)
    results = Counter((v.vehicle, v.sender, v.pose_seq) for v in verdicts)
    assert set(results.values()) == {1}
    # The last ones were still in transit.
    assert {v.outcome for v in verdicts} <= {"delivered", "dropped"}
    links = len({(v.vehicle, v.sender) for v in verdicts})
    sent = links * round(DURATION_S * 20.0)
    assert sent - links * 5 <= len(verdicts) <= sent
    by_number = {(pose.vehicle, pose.seq): pose for pose in poses}
    for one in verdicts:
        pose = by_number[one.sender, one.pose_seq]
        assert (one.measured_at_ns, one.sent_at_ns) == (pose.measured_at_ns, pose.sent_at_ns)


def test_a_follower_trusts_a_small_offset_and_leaves_its_lane() -> None:
    """Shows that the tests above can fail: both sources state a road further left."""
    straight, aside = drive("{}"), drive(CASES["offset"][0])
    assert straight.summary != aside.summary

    def furthest(run: Driven) -> float:
        return max(abs(m.lateral_error_m) for m in run.of("v3", Tracking))

    assert furthest(straight) < 0.1 < furthest(aside)
