"""What a follower did when messages failed, against what is worked out by hand."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.results.reaction import ReactionSummary, reaction
from tests.made.scenarios.messages import tracking, truth
from tests.made.scenarios.tables import run_of
from vehicles.messages import Tracking, TruePose

TICK = 0.02
Given = dict[str, object]


def figures(*messages: Tracking | TruePose) -> ReactionSummary:
    return reaction(run_of(*messages), "v2")


def states(*spans: tuple[int, Given]) -> list[Tracking]:
    """Tracking messages of a follower that has each state for a number of ticks."""
    results = [given for count, given in spans for _ in range(count)]
    return [tracking("v2", seq, **given) for seq, given in enumerate(results)]


def stop(speed: float, known: float, deceleration: float) -> list[tuple[Tracking, TruePose]]:
    """A car that brakes evenly to a standstill, with a known length (m) of path at first."""
    found, driven, seq = [], 0.0, 0
    while speed > 0.0:
        seq += 1
        next_speed = max(speed - deceleration * TICK, 0.0)
        driven, speed = driven + 0.5 * (speed + next_speed) * TICK, next_speed
        here = tracking("v2", seq, mode="stop", known_m=known - driven, blind_m=3.5)
        found.append((here, replace(truth("v2", seq, driven, 0.0), distance_m=100.0 + driven)))
    return found


def test_changes_of_mode_recoveries_stops_and_hazards_are_counted() -> None:
    lost: Given = {"lead_status": "lost", "mode": "predecessor"}
    braking: Given = {"mode": "stop", "hazard": True, "blind_m": 2.0, "predecessor_status": "lost"}
    found = figures(
        *states(
            (10, {}), (25, lost), (5, lost | {"lead_status": "probation"}), (10, {}),
            (20, lost), (20, lost | {"mode": "coast"}), (30, lost | braking),
            (1, lost | braking | {"blind_m": 9.0}), (9, lost), (50, {}), (10, lost),
        )
    )  # fmt: skip
    assert found.mode_changes == 8
    assert found.recoveries == 2
    assert found.recovery_s_max == pytest.approx(80 * TICK)
    assert found.recovery_s_mean == pytest.approx(55 * TICK)
    assert (found.stops, found.hazards) == (1, 1)
    assert found.predicted_blind_m_max == 2.0  # that of the instant at which the stop began


@given(
    st.floats(3.0, 30.0),
    st.floats(0.0, 120.0),
    st.floats(1.0, 8.0),
    st.randoms(use_true_random=False),
)
def test_blind_metres_are_those_beyond_the_known_path(
    speed: float, known: float, deceleration: float, random: Any
) -> None:
    """In any order of messages: the distance to a standstill less the known path."""
    drive = stop(speed, known, deceleration)
    start = truth("v2", 0, 0.0, 0.0, distance=100.0)
    messages = [tracking("v2", 0, known_m=known), start, *(one for pair in drive for one in pair)]
    random.shuffle(messages)
    driven = drive[-1][1].distance_m - 100.0
    found = figures(*messages).blind_m
    assert found == pytest.approx(max(driven - known, 0.0), abs=1e-6 * len(drive))


@pytest.mark.parametrize("mode", ["lead", "stop"])
def test_blind_distance_is_predicted_when_it_begins(mode: str) -> None:
    blind = {"known_m": -1.0, "mode": mode, "blind_m": 7.0}
    rows = states((5, {"known_m": 1.0}), (5, blind))
    assert figures(*rows).predicted_blind_m_max == 7.0
