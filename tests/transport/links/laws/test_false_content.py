"""False contents: altered fields, intervals, and unchanged fields."""

from dataclasses import asdict, replace
from math import cos, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from tests.made.channels.false_content import drift, frozen, ghost, offset, replayed
from tests.made.scenarios.messages import START, gps
from transport.links.laws.content import FalseInterval, Recall, Shift
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND

PLANE = LocalPlane(Origin(30.638, -96.481, 80.0))
ALWAYS = FalseInterval()
EARTH = Geod(ellps="WGS84")
ELSEWHERE = {"latitude_deg", "longitude_deg", "altitude_m"}
metres = st.floats(-200.0, 200.0)


def nothing(_until: int) -> GpsPose | None:
    return None


def recall(*poses: GpsPose) -> Recall:
    def newest(until: int) -> GpsPose | None:
        sent = [one for one in poses if one.sent_at_ns <= until]
        return max(sent, key=lambda one: one.sent_at_ns, default=None)

    return newest


def differing(one: GpsPose, other: GpsPose) -> set[str]:
    here, there = asdict(one), asdict(other)
    return {key for key in here if here[key] != there[key]}


@given(heading=st.floats(0.0, 360.0), ahead=metres, left=metres)
def test_ahead_and_left_are_those_of_the_sender_s_own_course(
    heading: float, ahead: float, left: float
) -> None:
    """Against the geodesic, whose azimuths are compass courses."""
    pose = gps("v1", 0, heading_deg=heading)
    altered = offset(ALWAYS, Shift(ahead=ahead, left=left)).falsify(pose, PLANE, nothing)
    assert differing(pose, altered) <= ELSEWHERE
    azimuth, _, far = EARTH.inv(
        pose.longitude_deg, pose.latitude_deg, altered.longitude_deg, altered.latitude_deg
    )
    course, turn = azimuth * pi / 180.0, heading * pi / 180.0
    assert far * cos(course - turn) == pytest.approx(ahead, abs=0.01)
    assert -far * sin(course - turn) == pytest.approx(left, abs=0.01)


@given(east=metres, north=metres)
def test_east_and_north_are_those_of_the_plane(east: float, north: float) -> None:
    altered = offset(ALWAYS, Shift(east, north)).falsify(gps("v1", 0), PLANE, nothing)
    place = PLANE.to_plane(altered.latitude_deg, altered.longitude_deg, altered.altitude_m)
    assert place == pytest.approx((east, north), abs=1e-6)


def test_a_drift_starts_at_the_true_place_and_grows_with_time() -> None:
    law = drift(FalseInterval(START + SECOND), Shift(east=0.5, north=-0.25))
    for seq in (20, 21, 60):
        altered = law.falsify(gps("v1", seq), PLANE, nothing)
        seconds = seq / 20 - 1.0
        place = PLANE.to_plane(altered.latitude_deg, altered.longitude_deg, altered.altitude_m)
        assert place == pytest.approx((0.5 * seconds, -0.25 * seconds), abs=1e-6)


def test_frozen_content_is_that_of_the_last_message_before() -> None:
    sent = [gps("v1", k, latitude_deg=30.638 + k * 1e-5, speed_mps=float(k)) for k in range(40)]
    law = frozen(FalseInterval(START + SECOND, START + 2 * SECOND))
    for pose in sent[20:]:
        altered = law.falsify(pose, PLANE, recall(*sent))
        assert altered is not None
        assert altered == replace(
            sent[19], seq=pose.seq, measured_at_ns=pose.measured_at_ns, sent_at_ns=pose.sent_at_ns
        )
    assert law.falsify(sent[20], PLANE, recall(*sent[20:])) is None


def test_replayed_content_has_the_requested_age() -> None:
    sent = [gps("v1", k, speed_mps=float(k)) for k in range(40)]
    law = replayed(ALWAYS, SECOND // 2)
    altered = law.falsify(sent[30], PLANE, recall(*sent))
    holed = law.falsify(sent[30], PLANE, recall(*sent[:18]))
    assert altered is not None
    assert holed is not None
    assert (altered.speed_mps, altered.seq, altered.sent_at_ns) == (20.0, 30, sent[30].sent_at_ns)
    assert holed.speed_mps == 17.0
    assert law.falsify(sent[9], PLANE, recall(*sent)) is None


def test_a_ghost_drives_beside_the_sender_half_an_interval_later() -> None:
    pose = gps("v1", 7, heading_deg=90.0, speed_mps=20.0)
    law = ghost(ALWAYS, Shift(ahead=-3.0, left=0.5), 25_000_000)
    assert law.falsify(pose, PLANE, nothing) == pose
    ghost_pose = law.extra_message(pose, PLANE)
    assert differing(pose, ghost_pose) <= ELSEWHERE | {"measured_at_ns", "sent_at_ns"}
    assert ghost_pose.measured_at_ns - pose.measured_at_ns == 25_000_000
    place = PLANE.to_plane(ghost_pose.latitude_deg, ghost_pose.longitude_deg, ghost_pose.altitude_m)
    assert place == pytest.approx((-3.0 + 0.5, 0.5), abs=1e-6)  # half a metre in 25 ms
