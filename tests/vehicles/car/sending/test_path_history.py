"""The path history that a vehicle sends: its chords, its limits, and when it restarts."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles.sent_paths import PLANE, fixes, message, sent
from transport.codec import encode
from vehicles.car.gnss import Fix
from vehicles.car.path_history import PathHistory
from vehicles.car.sending_rules import Sender
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.received_pose import ReceivedPose, receive

STRAIGHT = path_from_segments([Segment(3000.0, 0.0)], yaw=1.0)
BENDS = st.lists(
    st.tuples(st.floats(5.0, 60.0), st.floats(-0.2, 0.2)).map(lambda pair: Segment(*pair)),
    min_size=1,
    max_size=8,
)


def clothoid(length: float, curvature: float) -> SampledPath:
    """A bend whose curvature grows linearly, in pieces of half a metre."""
    pieces = round(2.0 * length)
    return path_from_segments([Segment(0.5, curvature * (k + 0.5) / pieces) for k in range(pieces)])


def worst_distance(pose: ReceivedPose, driven: Sequence[Fix]) -> float:
    """Largest distance (m) of fixes from the chord of the history around their instant."""
    places = [*pose.path_history(), (pose.measured_at, pose.east, pose.north)]
    worst = 0.0
    for (begin, *start), (end, *stop) in pairwise(places):
        a, b = np.array(start), np.array(stop)
        within = [fix for fix in driven if begin <= fix.measured_at <= end]
        points = np.array([(fix.east, fix.north) for fix in within])
        share = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0.0, 1.0)
        off = points - a - share[:, None] * (b - a)
        worst = max(worst, float(np.hypot(*off.T).max()))
    return worst


@examples(13, 400)
@given(bends=BENDS, speed=st.floats(10.0, 40.0), noise=st.sampled_from([0.0, 0.02, 0.05]))
def test_chords_are_within_5_cm_of_all_fixes(
    bends: list[Segment], speed: float, noise: float
) -> None:
    path = path_from_segments(bends, 100.0, -2000.0, 2.0)
    stations = np.arange(0.0, path.station[-1], speed / 20.0)
    driven = list(fixes(path, stations, noise))
    for pose in list(sent(driven))[::29]:
        assert worst_distance(pose, driven) <= 0.05


@pytest.mark.parametrize("speed", [0.4, 1.4, 5.0, 30.0])
@pytest.mark.parametrize("curvature", [0.0, 1 / 500, -1 / 50, 1 / 6])
def test_chords_of_growing_bends_are_within_5_cm(speed: float, curvature: float) -> None:
    path = clothoid(min(200.0, speed * 40.0), curvature)
    stations = np.arange(0.0, path.station[-1], speed / 20.0)
    driven = list(fixes(path, stations))
    for pose in list(sent(driven))[::7]:
        assert worst_distance(pose, driven) <= 0.05


@pytest.mark.parametrize("points", [1, 2, 5, 23])
def test_the_number_of_positions_is_limited(points: int) -> None:
    circle = path_from_segments([Segment(300.0, 1 / 20.0)])
    driven = list(fixes(circle, np.arange(0.0, 290.0, 0.5), 0.02))
    for pose in sent(driven, points=points):
        assert len(pose.path_history()) <= points
    assert len(pose.path_history()) == points
    assert worst_distance(pose, driven) <= 0.05


def test_it_restarts_while_the_car_is_off_its_path() -> None:
    history = PathHistory(PLANE, 300.0, 23)
    driven = list(fixes(STRAIGHT, np.arange(0.0, 100.0, 1.0)))
    for fix in driven:
        history.record(fix, on_path=not 40 <= fix.seq < 50)
        oldest = receive(message(fix, history), PLANE, 0).path_history()[:1]
        if 40 <= fix.seq < 50:
            assert not oldest
        elif fix.seq > 50:
            assert oldest[0][0] == driven[50].measured_at


@pytest.mark.parametrize("certain", [True, False])
def test_positions_by_dead_reckoning_stand_in_for_missing_fixes(certain: bool) -> None:
    """The car drives on for 3 s without fixes, and then sends where it was."""
    driven = list(fixes(clothoid(200.0, 0.02), np.arange(0.0, 100.0, 1.0)))
    sender = Sender(path=PathHistory(PLANE, 300.0, 23))
    own: list[Fix | None] = [None]
    for fix in driven:
        has_fix = not 20 <= fix.seq < 80
        own[0] = replace(fix, seq=0) if certain else None
        sender.send(fix.measured_at, fix if has_fix else None, lambda _: own[0])
    assert sender.path is not None
    pose = receive(message(driven[-1], sender.path), PLANE, 0)
    first = driven[0] if certain else driven[80]
    assert pose.path_history()[0][0] == first.measured_at
    every_fourth = driven[:20] + driven[20:80:4] + driven[80:]
    assert not certain or worst_distance(pose, every_fourth) < 0.05


def last(driven: Sequence[Fix], **limits: float) -> ReceivedPose:
    *_, pose = sent(driven, **limits)  # type: ignore[arg-type]
    return pose


@given(st.integers(1, 22))
def test_each_position_costs_few_bytes(extra: int) -> None:
    circle = path_from_segments([Segment(600.0, 1 / 100.0)])
    driven = list(fixes(circle, np.arange(0.0, 590.0, 1.0)))
    sizes = [len(encode(last(driven[-400:], points=n).message)) for n in (1, 1 + extra)]
    assert 0 < sizes[1] - sizes[0] <= 9 * extra


def test_noise_of_half_a_metre_is_bounded_by_the_number_of_positions() -> None:
    for pose in sent(list(fixes(STRAIGHT, np.arange(0.0, 300.0, 0.5), 0.5))):
        assert len(pose.path_history()) <= 23
