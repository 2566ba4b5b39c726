"""Fix states by schedule and by Markov chain, and outages."""

from itertools import islice

import numpy as np
import pytest
from scipy import stats

from vehicles.car.dynamics import Body
from vehicles.car.gnss_error_terms import (
    ChainOfStates,
    FixOutageCircle,
    FixOutageStretch,
    FixOutageWindow,
    ReceiverContext,
    ReceiverState,
    ScheduledStates,
    StateEntry,
    Transition,
)
from vehicles.schedule import SECOND

START = 1_700_000_000_000_000_000


def context(seed: int = 1) -> ReceiverContext:
    """Start of a run, 30 m behind the lead."""

    def stream(_purpose: str) -> np.random.Generator:
        return np.random.default_rng(seed)

    return ReceiverContext(START, 30.0, stream, stream)


def chain(*transitions: tuple[ReceiverState, ReceiverState, float]) -> ChainOfStates:
    return ChainOfStates(tuple(Transition(*one) for one in transitions))


def stays(chain: ChainOfStates, count: int, seed: int) -> list[tuple[ReceiverState, float]]:
    """States and durations (s) of the first state intervals."""
    intervals = list(islice(chain.intervals("fixed", context(seed)), count))
    assert [stay.since for stay in intervals] == [START, *(stay.until for stay in intervals[:-1])]
    return [(stay.state, (stay.until - stay.since) / SECOND) for stay in intervals]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_times_in_a_state_of_a_chain_are_exponential(seed: int) -> None:
    """Kolmogorov–Smirnov test at 0.1 %."""
    result = stays(chain(("fixed", "float", 890.0), ("float", "fixed", 14.0)), 4000, seed)
    for state, mean in (("fixed", 890.0), ("float", 14.0)):
        lengths = [length for entered, length in result if entered == state]
        assert len(lengths) == 2000
        assert stats.kstest(lengths, "expon", args=(0.0, mean)).pvalue > 0.001


def test_competing_transitions_have_their_rates() -> None:
    lost_or_float = chain(
        ("fixed", "float", 10.0),
        ("fixed", "none", 30.0),
        ("float", "fixed", 1.0),
        ("none", "fixed", 2.0),
    )
    result = stays(lost_or_float, 8000, 4)
    fixed = [length for state, length in result if state == "fixed"]
    assert stats.kstest(fixed, "expon", args=(0.0, 7.5)).pvalue > 0.001  # 1/10 + 1/30
    lost = sum(state == "none" for state, _ in result)
    assert lost == pytest.approx(1000, abs=5 * (4000 * 0.25 * 0.75) ** 0.5)  # a quarter of 4000


def scheduled(*entries: tuple[float, ReceiverState]) -> list[tuple[ReceiverState, float]]:
    """States and their starts (s)."""
    law = ScheduledStates(tuple(StateEntry(*entry) for entry in entries))
    return [(at.state, (at.since - START) / SECOND) for at in law.intervals("fixed", context())]


def test_a_schedule_is_followed() -> None:
    later: list[tuple[ReceiverState, float]] = [("float", 2.0), ("none", 5.0), ("fixed", 5.5)]
    assert scheduled(*((at, state) for state, at in later)) == [("fixed", 0.0), *later]
    assert scheduled((0.0, "single")) == [("single", 0.0)]


def test_outages_cover_their_time_stretch_or_circle() -> None:
    def car(driven: float = 0.0, east: float = 0.0, north: float = 0.0) -> Body:
        return Body(east=east, north=north, yaw=0.0, speed=20.0, distance=driven)

    start = context()
    time = FixOutageWindow(0, SECOND)
    assert [time.covers(car(), START + k, start) for k in (-1, 0, SECOND - 1, SECOND)] == [
        *(False, True, True, False)
    ]
    road = FixOutageStretch(100.0, 200.0)
    assert [
        road.covers(car(distance), START, start) for distance in (129.0, 130.0, 229.0, 230.0)
    ] == [*(False, True, True, False)]
    circle = FixOutageCircle(10.0, -5.0, 3.0)
    assert circle.covers(car(east=12.0, north=-5.0), START, start)
    assert not circle.covers(car(east=12.5, north=-7.5), START, start)
