"""Clocks and schedules: exact instants, punctual waking, no steps of the wall clock."""

import time
from itertools import pairwise
from threading import Event, Timer

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transport.clock import SystemTime, VirtualClock, WallClock, late_threshold, ticks
from vehicles.schedule import SECOND, instants

START = 1_790_000_000 * SECOND + 123_456_789
MS = 1_000_000

rates = st.one_of(st.integers(1, 500).map(float), st.floats(0.5, 200.0))


@given(each=st.lists(rates, min_size=1, max_size=3), duration=st.integers(1, 2 * SECOND))
def test_ticks_are_the_union_in_order_without_gap(each: list[float], duration: int) -> None:
    end = START + duration
    run = list(ticks(START, end, *each))
    assert [tick.at for tick in run] == sorted(
        {at for rate_hz in each for at in instants(START, end, rate_hz)}
    )
    assert all(before.at < after.at for before, after in pairwise(run))
    assert sum(round(tick.span_s * SECOND) for tick in run) == duration


def test_virtual_clock_never_goes_back() -> None:
    clock = VirtualClock(START)
    assert clock.wait_until(START - 5) == 5
    assert clock.now() == START


def test_wall_clock_is_unix_time() -> None:
    assert abs(WallClock().now() - time.time_ns()) < 50 * MS


def test_a_clock_goes_on_from_another_one_s_setting() -> None:
    """Even if the system clock was set in between."""
    clock = WallClock()
    later = WallClock(setting=clock.setting, system=SystemTime(unix=lambda: 0))
    assert abs(later.now() - clock.now()) < 50 * MS


def clock_at(reading: list[int]) -> WallClock:
    """A clock over a monotonic clock that shows the only entry of `reading` (ns)."""
    return WallClock(system=SystemTime(lambda: reading[0], lambda: START))


def test_a_correction_is_spread_over_a_second_or_a_tenth_of_the_time() -> None:
    reading = [0]
    clock = clock_at(reading)
    clock.slew(-10 * MS, 0.0)  # behind
    assert clock.now() == START
    reading[0] = SECOND // 2
    assert clock.now() == START + SECOND // 2 + 5 * MS
    reading[0] = 3 * SECOND
    assert clock.now() == START + 3 * SECOND + 10 * MS
    clock.slew(SECOND, 0.0)  # ahead
    reading[0] = 8 * SECOND
    assert clock.now() == START + 8 * SECOND + 10 * MS - SECOND // 2
    reading[0] = 20 * SECOND
    assert clock.now() == START + 20 * SECOND + 10 * MS - SECOND
    assert clock.corrected == 10 * MS - SECOND


def test_a_drift_is_removed_from_then_on() -> None:
    reading = [100 * SECOND]
    clock = clock_at(reading)
    clock.slew(0, 500e-6)
    reading[0] += 1000 * SECOND
    assert clock.now() == START + 1000 * SECOND - SECOND // 2


def test_a_step_of_the_system_clock_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = WallClock()
    before = clock.now()
    monkeypatch.setattr(time, "time_ns", lambda: before + 3600 * SECOND)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert 0 <= clock.now() - before < SECOND


def test_wall_clock_wakes_after_the_instant_and_soon() -> None:
    clock = WallClock()
    start = clock.now()
    lateness = [clock.wait_until(tick.at) for tick in ticks(start, start + 400 * MS, 50.0)]
    assert min(lateness) >= 0
    assert sorted(lateness)[len(lateness) // 2] < late_threshold(50.0)


def test_wall_clock_does_not_drift() -> None:
    # Each wait ends at its own instant: lateness does not accumulate.
    clock = WallClock()
    start = clock.now()
    for tick in ticks(start, start + 300 * MS, 100.0):
        clock.wait_until(tick.at)
    assert 290 * MS <= clock.now() - start < 390 * MS


def test_waiting_ends_when_stopped() -> None:
    stop = Event()
    clock = WallClock(stop.is_set)
    Timer(0.05, stop.set).start()
    began = time.monotonic()
    assert clock.wait_until(clock.now() + 60 * SECOND) < -50 * SECOND
    assert time.monotonic() - began < 5.0


def test_virtual_clock_jumps() -> None:
    clock = VirtualClock(START)
    began = time.monotonic()
    assert clock.now() == START
    assert clock.wait_until(START + 3600 * SECOND) == 0
    assert clock.now() == START + 3600 * SECOND
    assert time.monotonic() - began < 1.0
