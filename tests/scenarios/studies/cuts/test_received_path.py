"""The received path of a follower, and departures from the lane that it could have avoided."""

from collections.abc import Callable

import numpy as np
import pytest

from scenarios.studies.cuts.received_path import (
    Delivery,
    ReceivedPath,
    StationTrack,
    judge_departures,
)
from vehicles.schedule import nanoseconds

SPEED, PERIOD_S, STEP_S = 20.0, 0.05, 0.02
TIMES = np.arange(0.0, 20.0, STEP_S)


def track(
    station: Callable[[float], float], lateral: Callable[[float], float] = lambda _: 0.0
) -> StationTrack:
    """A car at stations and lateral errors (m) by time (s)."""
    stations = np.array([station(time) for time in TIMES])
    return StationTrack(
        np.array([float(nanoseconds(time)) for time in TIMES]),
        stations,
        np.array([lateral(time) for time in TIMES]),
        np.gradient(stations, STEP_S),
    )


LEAD = track(lambda time: SPEED * time)


def deliveries(until_s: float, from_s: float = 0.0, history_s: float = 0.0) -> list[Delivery]:
    instants = [nanoseconds(time) for time in np.arange(from_s, until_s, PERIOD_S)]
    return [Delivery(at, "v1", at, at - nanoseconds(history_s)) for at in instants]


def judge(gap: float, departs_s: float, received: list[Delivery], **motion: StationTrack) -> bool:
    follower = motion.get("follower") or track(
        lambda time: SPEED * time - gap, lambda time: float(time >= departs_s)
    )
    (verdict,) = judge_departures(
        [nanoseconds(departs_s)], follower, {"v1": LEAD, "v2": follower}, received
    )
    return verdict


def path_of(received: list[Delivery]) -> ReceivedPath:
    path = ReceivedPath(LEAD)
    for pose in received:
        path.add(LEAD.on_path(pose.since, pose.measured_at))
    return path


def test_known_path_ends_at_the_first_hole() -> None:
    """Half a second of the lead's drive, 10 m, is not a hole."""
    path = path_of(deliveries(5.0) + deliveries(8.0, from_s=5.4) + deliveries(12.0, from_s=9.0))
    assert path.ahead(50.0) == pytest.approx(8.0 * SPEED - 50.0, abs=1.5)
    assert path.ahead(-40.0) == pytest.approx(8.0 * SPEED + 40.0, abs=1.5)
    assert path.ahead(175.0) == pytest.approx(8.0 * SPEED - 175.0, abs=1.5)
    assert path.ahead(190.0) == pytest.approx(12.0 * SPEED - 190.0, abs=1.5)


@pytest.mark.parametrize(("history_s", "end_s"), [(0.9, 8.0), (1.1, 12.0)])
def test_path_history_closes_a_hole_that_it_covers(history_s: float, end_s: float) -> None:
    path = path_of(deliveries(8.0) + deliveries(12.0, from_s=9.5, history_s=history_s))
    assert path.ahead(100.0) == pytest.approx(end_s * SPEED - 100.0, abs=1.5)


def test_positions_of_a_predecessor_beside_the_path_do_not_count() -> None:
    beside = track(lambda time: SPEED * time, lambda time: 0.5 * (time > 5.0))
    at = [nanoseconds(time) for time in (4.0, 6.0)]
    assert [beside.on_path(one, one).size for one in at] == [1, 0]


def test_a_departure_is_avoidable_while_the_path_is_known() -> None:
    assert judge(40.0, 6.0, deliveries(20.0))


def test_a_departure_beyond_the_path_is_avoidable_if_the_car_could_have_stopped() -> None:
    """Data ends at 5 s; the car notices it at 5.5 s and needs 38 m from 20 m/s."""
    assert judge(60.0, 10.0, deliveries(5.0))
    assert not judge(40.0, 10.0, deliveries(5.0))


def test_a_car_that_returns_from_an_inevitable_departure_is_excused_until_it_is_back() -> None:
    received = deliveries(5.0) + deliveries(20.0, from_s=8.0)

    def away(time: float) -> float:
        return 1.0 if 6.5 <= time < 12.0 or time >= 15.0 else 0.0

    follower = track(lambda time: SPEED * time - 20.0, away)
    tracks = {"v1": LEAD, "v2": follower}
    departures = [nanoseconds(time) for time in (7.0, 11.0, 15.0)]
    assert judge_departures(departures, follower, tracks, received) == [False, False, True]
