"""Random cuts of links: followers neither collide nor leave the lane if they could have stopped.

`pytest --campaign` simulates 2000 cuts on six roads, and 1000 during a double lane change.
"""

from collections.abc import Iterator
from itertools import pairwise, takewhile
from math import inf

import numpy as np
import pytest

from scenarios.definition.scenario import Scenario
from tests.made.convoys.cuts import (
    FOR_GOOD_S,
    NO_SOURCE,
    STANDING,
    CarRecord,
    LinkCut,
    draw_cuts,
    simulated,
)
from vehicles.schedule import SECOND, nanoseconds

CASES = sorted(draw_cuts(2000), key=lambda cut: cut.vehicles > 3)
"""First the cheapest convoys."""
FEW, ALL = 2, 1000
INSIDE_M = 0.3
LANE_CHANGE_AT_S = 6.5
STEERING_RATE, CONTROL_S = 1.18, 0.02
PROBATION_S = 1.0
SETTLED_S = 5.0
"""Time at the speed of the convoy that a follower has to return to the lead's path."""
RESUMED = 0.5
"""A car has resumed once it reaches this share of its speed before the cut."""
ROUNDING = 1e-9
HISTORY_M = 150.0
"""At least this much of its path a car sends at these speeds."""
EXTRAPOLATED = LinkCut(
    reaction="extrapolate", speed_mps=20.0, at_s=6.5, for_s=None, seed=1, vehicles=2
)


@pytest.mark.campaign(2, len(CASES))
def test_a_convoy_survives_a_cut(case: int) -> None:
    """No collision, no departure from the lane that was avoidable, no mispredicted blind drive."""
    cut = CASES[case]
    _, *followers = simulated(cut.scenario()).values()
    assert [car.collisions for car in followers] == [0] * len(followers), cut
    assert [car.blind_deviation() for car in followers] == [0.0] * len(followers), cut
    if not cut.fix:  # a car with a failed receiver does not know its own position
        assert [car.departures_avoidable() for car in followers] == [0] * len(followers), cut


def lane_change_cuts(count: int) -> Iterator[LinkCut]:
    """Cuts of all links in a double lane change; half of them last until all cars have stopped."""
    random = np.random.Generator(np.random.PCG64(1))
    for number in range(count):
        yield LinkCut(
            speed_mps=round(float(random.uniform(8.0, 30.0)), 2),
            at_s=round(float(random.uniform(3.0, 17.0)), 3),
            for_s=FOR_GOOD_S if number % 2 else round(float(random.uniform(0.3, 4.0)), 3),
            seed=number + 1,
        )


LANE_CHANGES = sorted(lane_change_cuts(ALL), key=lambda cut: abs(cut.at_s - LANE_CHANGE_AT_S))


@pytest.mark.campaign(FEW, ALL)
def test_followers_stop_within_the_known_path_or_the_predicted_blind_distance(
    case: int,
) -> None:
    cut = LANE_CHANGES[case]
    scenario = cut.scenario()
    lead, *followers = simulated(scenario).values()
    begin, end = (scenario.start_at_ns + nanoseconds(at) for at in (cut.at_s, cut.ends_at_s))
    last = [pose for at, pose in lead.truth.items() if at <= end][-1]
    reached_from = last.distance_m + SETTLED_S * last.speed_mps
    for car in followers:
        during = [row for row in car.tracking if begin <= row.decided_at_ns < end]
        on_known_path = takewhile(lambda row: not row.known_m < 0.0, during)
        assert all(abs(car.errors.get(row.decided_at_ns, 0.0)) <= INSIDE_M for row in on_known_path)
        recovered = [at for at, station in car.stations.items() if station > reached_from]
        assert all(abs(car.errors[at]) <= INSIDE_M for at in recovered)
        assert all(pose.friction_ratio <= 1.0 + ROUNDING for pose in car.truth.values())
        steps = [abs(after - before) for before, after in pairwise([0.0, *car.steering])]
        assert max(steps) <= STEERING_RATE * CONTROL_S + ROUNDING
        assert 0 <= ticks_late(car, scenario, begin, end) <= 1
        if cut.speed_mps * (cut.for_s or inf) < HISTORY_M:  # the lead's history closes the hole
            assert has_resumed(car, end, cut.speed_mps)
        check_modes(car, scenario.start_at_ns)
        if cut.for_s == FOR_GOOD_S:
            assert any(begin <= at < end for at in standing(car))
            assert car.blind_stop() is not None
            assert car.blind_deviation() == 0.0


def check_modes(car: CarRecord, start_at_ns: int) -> None:
    """Each mode has a reason, and lasts before it comes again."""
    changes = [after for before, after in pairwise(car.tracking) if after.mode != before.mode]
    assert all(change.reason for change in changes if change.mode in NO_SOURCE), changes
    for mode in ("coast", "stop", "lead", "predecessor", "composite"):
        at_s = [(row.decided_at_ns - start_at_ns) / SECOND for row in changes if row.mode == mode]
        assert all(b - a >= PROBATION_S for a, b in pairwise(at_s)), changes


def ticks_late(car: CarRecord, scenario: Scenario, begin: int, end: int) -> int:
    """Control periods between the threshold for losing the last source and the change of mode."""
    lost = next(
        (
            row.decided_at_ns
            for row in car.tracking
            if begin <= row.decided_at_ns < end and row.mode in NO_SOURCE
        ),
        None,
    )
    received = [row.received_at_ns for row in car.deliveries if row.sent_at_ns < begin]
    if lost is None or not received:
        return 0
    degradation = scenario.tables.control.degradation.value
    period = 1.0 / scenario.tables.gnss.value.rate
    threshold = max(received) + nanoseconds(degradation.lost_after_silence(period))
    return (lost - threshold) // nanoseconds(1.0 / scenario.control_rate_hz)


def has_resumed(car: CarRecord, end: int, speed_mps: float) -> bool:
    """Whether the car drives on by its sources after the cut."""
    lost = NO_SOURCE | {"straight"}
    return any(
        row.decided_at_ns >= end and row.mode not in lost and pose.speed_mps >= RESUMED * speed_mps
        for row, pose in car.known()
    )


def standing(car: CarRecord) -> Iterator[int]:
    return (at for at, pose in car.truth.items() if pose.speed_mps < STANDING)


def test_an_extrapolating_follower_leaves_the_road() -> None:
    _, follower = simulated(EXTRAPOLATED.scenario()).values()
    assert max(map(abs, follower.errors.values())) > 3.0
    assert follower.departures
    assert not list(standing(follower))
