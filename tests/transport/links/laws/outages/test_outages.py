"""Outages: exact bounds; random ones exponential, stationary and computable alone."""

from itertools import groupby
from math import exp, nan, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tests.made.channels.laws import circle, long_run, random_outage, stretch, window
from transport.links.laws.link_law import Effect, Position, TransmissionContext
from transport.links.laws.outages import CACHED_CELLS, AffectedVehicle, RandomOutage
from transport.links.link import keyed_draw
from vehicles.schedule import SECOND

START = 1_700_000_000 * SECOND
KS_LIMIT = 1.9495
"""0.1 % point of Kolmogorov's distribution, for D √n."""


def answer(effect: Effect, context: TransmissionContext) -> object:
    return effect.judge(keyed_draw(1, "a", "b"), context)


@pytest.mark.parametrize(
    ("since", "dropped"),
    [(-1, False), (0, False), (99, False), (100, True), (149, True), (150, False), (1100, False)],
)
def test_a_window_holds_from_its_first_nanosecond_to_before_its_last(
    since: int, dropped: bool
) -> None:
    effect = window(100, 150, START)
    assert answer(effect, TransmissionContext(0, START + since)) == ("outage" if dropped else 0)


INSIDE = {
    # (sender inside, receiver inside): values of `vehicle` with an outage
    (False, False): (),
    (True, False): ("sender", "either"),
    (False, True): ("receiver", "either"),
    (True, True): ("sender", "receiver", "either", "both"),
}


@pytest.mark.parametrize("vehicle", ["sender", "receiver", "either", "both"])
@pytest.mark.parametrize(("sender", "receiver"), INSIDE)
def test_which_end_has_to_be_inside(vehicle: AffectedVehicle, sender: bool, receiver: bool) -> None:
    wanted = "outage" if vehicle in INSIDE[sender, receiver] else 0
    here, there = Position(10.0, 0.0, 60.0), Position(50.0, 0.0, 0.0)
    context = TransmissionContext(
        0, START, sender=here if sender else there, receiver=here if receiver else there
    )
    assert answer(circle(10.0, 5.0, 6.0, vehicle), context) == wanted
    # Both start 40 m ahead of the first point of the path.
    assert answer(stretch((100.0, 101.0), vehicle, 40.0, 40.0), context) == wanted


def test_a_stretch_counts_from_the_start_of_each_vehicle() -> None:
    effect = stretch((100.0, 200.0), "sender", -15.0, 0.0)

    def at(travelled: float) -> object:
        return answer(effect, TransmissionContext(0, START, sender=Position(travelled=travelled)))

    assert [at(travelled) for travelled in (114.9, 115.0, 214.9, 215.0)] == [
        0,
        "outage",
        "outage",
        0,
    ]
    assert at(nan) == 0  # unknown position
    laps = stretch((100.0, 200.0), "sender", 0.0, 0.0, 1000.0)
    for travelled, wanted in ((2099.9, 0), (2100.0, "outage"), (2199.9, "outage"), (2200.0, 0)):
        context = TransmissionContext(0, START, sender=Position(travelled=travelled))
        assert answer(laps, context) == wanted


def test_a_circle_ends_at_its_radius() -> None:
    effect = circle(3.0, -4.0, 5.0, "sender")
    for east, wanted in ((7.999, "outage"), (8.0, 0), (-1.999, "outage"), (-2.0, 0)):
        context = TransmissionContext(0, START, sender=Position(east, -4.0, 0.0))
        assert answer(effect, context) == wanted
    assert answer(effect, TransmissionContext(0, START)) == 0


# ---- Random outages

ON, OFF = 4 * SECOND, SECOND


def jumps(effect: RandomOutage, seed: int, cells: int) -> list[tuple[int, bool]]:
    """Events of the first cells in order: instant and state after it."""
    draw = keyed_draw(seed, "a", "b")
    return sorted(event for cell in range(cells) for event in effect._events(draw, cell))


@pytest.mark.parametrize(("on", "off"), [(ON, OFF), (SECOND // 10, 3 * SECOND)])
@pytest.mark.campaign(6_000, 100_000)
def test_on_and_off_last_exponential_times(on: int, off: int, campaign: int) -> None:
    effect = random_outage(on, off, START)
    states = [
        next(group) for _, group in groupby(jumps(effect, 1, campaign), lambda event: event[1])
    ]
    changes = np.array([at for at, _ in states], dtype=float)
    times = np.diff(changes)
    for state, mean in ((False, on), (True, off)):
        own = times[[event is state for _, event in states[:-1]]]
        distance = stats.kstest(own, stats.expon(scale=mean).cdf).statistic
        assert distance * sqrt(own.size) < KS_LIMIT
        assert abs(own.mean() / mean - 1.0) < 4.0 / sqrt(own.size)
    # Successive durations are independent.
    scaled = times / np.where([event for _, event in states[:-1]], off, on) - 1.0
    assert abs(np.mean(scaled[1:] * scaled[:-1])) < 4.0 / sqrt(times.size)


def test_it_is_stationary_from_the_first_message() -> None:
    """Over many links: the stationary share, and its correlation over time."""
    effect, links = random_outage(ON, OFF, START), 4000
    draws = [keyed_draw(seed, "a", "b") for seed in range(links)]
    share = OFF / (ON + OFF)
    error = sqrt(share * (1 - share) / links)
    first = np.array([effect.is_off(draw, 0) for draw in draws])
    assert abs(first.mean() - share) < 3.0 * error
    lag = SECOND // 2
    then = np.array([effect.is_off(draw, lag) for draw in draws])
    assert abs(then.mean() - share) < 3.0 * error
    # The correlation of a two-state process is exp(-(1/on + 1/off) t).
    wanted = exp(-(1 / ON + 1 / OFF) * lag)
    found = np.mean((first - share) * (then - share)) / (share * (1 - share))
    assert abs(found - wanted) < 4.0 / sqrt(links)
    assert long_run(effect)[0] == share


@given(
    on=st.integers(10**6, 10**10),
    off=st.integers(10**6, 10**10),
    requested=st.lists(st.integers(0, 300), min_size=1, max_size=10),
)
def test_a_verdict_alone_is_the_one_in_the_stream(on: int, off: int, requested: list[int]) -> None:
    draw, step = keyed_draw(3, "a", "b"), 50 * 10**6
    effect = random_outage(on, off, START)
    stream = {seq: effect.is_off(draw, seq * step) for seq in range(max(requested) + 1)}
    for seq in requested:
        alone = random_outage(on, off, START)
        context = TransmissionContext(seq, START + seq * step)
        assert alone.judge(draw, context) == ("outage" if stream[seq] else 0)
        assert effect.judge(draw, context) == alone.judge(draw, context)


def test_links_and_outages_of_one_link_have_their_own_times() -> None:
    effect, other = (random_outage(ON, OFF, START, k) for k in (0, 1))
    draw, elsewhere = keyed_draw(1, "a", "b"), keyed_draw(1, "a", "c")
    instants = range(0, 400 * SECOND, SECOND // 2)
    here = [effect.is_off(draw, at) for at in instants]
    assert here != [other.is_off(draw, at) for at in instants]
    assert here != [effect.is_off(elsewhere, at) for at in instants]
    assert here == [effect.is_off(draw, at) for at in instants]
    assert len(effect._cells) <= CACHED_CELLS
