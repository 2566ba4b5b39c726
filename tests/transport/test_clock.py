"""Clocks and schedules: exact instants, punctual waking, no steps of the wall clock."""

import time
from fractions import Fraction
from itertools import pairwise
from threading import Event, Timer

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transport.clock import SystemTime, Tick, VirtualClock, WallClock, late_threshold, poll, ticks
from vehicles.schedule import SECOND, instant, instants

START = 1_790_000_000 * SECOND + 123_456_789
MS = 1_000_000

rates = st.one_of(st.integers(1, 500).map(float), st.floats(0.5, 200.0))


def test_control_and_gnss_instants_interleave() -> None:
    found = [(tick.at - START) // MS for tick in ticks(START, START + 200 * MS, 50.0, 20.0)]
    assert found == [0, 20, 40, 50, 60, 80, 100, 120, 140, 150, 160, 180]


def test_spans_reach_to_the_next_tick_and_the_last_one_to_the_end() -> None:
    run = list(ticks(START, START + 95 * MS, 50.0, 20.0))
    assert [tick.span_s for tick in run] == [0.020, 0.020, 0.010, 0.010, 0.020, 0.015]


def test_a_single_instant() -> None:
    assert list(ticks(START, START + 1, 50.0, 20.0)) == [Tick(START, 1e-9)]


def test_nothing_is_due_in_no_time() -> None:
    assert list(ticks(START, START, 50.0, 20.0)) == []


@given(rate_hz=st.integers(1, 200), seconds=st.integers(1, 20))
def test_a_duration_has_rate_times_seconds_instants(rate_hz: int, seconds: int) -> None:
    assert len(list(instants(START, START + seconds * SECOND, rate_hz))) == rate_hz * seconds


@given(k=st.integers(0, 500 * 7200), rate_hz=st.integers(1, 500))
def test_instants_are_the_nearest_nanosecond(k: int, rate_hz: int) -> None:
    assert instant(START, k, rate_hz) - START == round(Fraction(k * SECOND, rate_hz))


@given(each=st.lists(rates, min_size=1, max_size=3), duration=st.integers(1, 2 * SECOND))
def test_ticks_are_the_union_in_order_without_gap(each: list[float], duration: int) -> None:
    end = START + duration
    run = list(ticks(START, end, *each))
    assert [tick.at for tick in run] == sorted(
        {at for rate_hz in each for at in instants(START, end, rate_hz)}
    )
    assert all(before.at < after.at for before, after in pairwise(run))
    assert sum(round(tick.span_s * SECOND) for tick in run) == duration


def test_instants_without_a_rate_are_ticks_too() -> None:
    """Instants of several lists, each once, with the span to the next one."""
    more = [[START + 3 * MS, START + 20 * MS, START + 31 * MS], [START + 3 * MS]]
    found = list(ticks(START, START + 40 * MS, 50.0, more=more))
    assert [(one.at - START) / MS for one in found] == [0, 3, 20, 31]
    assert [one.span_s for one in found] == pytest.approx([0.003, 0.017, 0.011, 0.009])


def test_virtual_clock_jumps() -> None:
    clock = VirtualClock(START)
    began = time.monotonic()
    assert clock.now() == START
    assert clock.wait_until(START + 3600 * SECOND) == 0
    assert clock.now() == START + 3600 * SECOND
    assert time.monotonic() - began < 1.0


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


def test_a_clock_is_set_back_at_once() -> None:
    clock = clock_at([7 * SECOND])
    clock.set_back(3 * SECOND)
    assert clock.now() == START - 3 * SECOND
    assert clock.corrected == -3 * SECOND


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


def test_an_instant_that_has_passed_is_not_waited_for() -> None:
    clock = WallClock()
    assert clock.wait_until(clock.now() - 7 * MS) >= 7 * MS


def test_waiting_ends_when_stopped() -> None:
    stop = Event()
    clock = WallClock(stop.is_set)
    Timer(0.05, stop.set).start()
    began = time.monotonic()
    assert clock.wait_until(clock.now() + 60 * SECOND) < -50 * SECOND
    assert time.monotonic() - began < 5.0


def test_half_a_control_period_is_late() -> None:
    assert late_threshold(50.0) == 10 * MS


def test_polling_ends_as_soon_as_the_condition_holds() -> None:
    looked, slept = [False, False, True], list[float]()
    assert poll(lambda: looked.pop(0), every_s=0.25, system=SystemTime(sleep=slept.append))
    assert slept == [0.25, 0.25]
    assert poll(lambda: True, every_s=9.0, system=SystemTime(sleep=slept.append))
    assert len(slept) == 2


def test_polling_gives_up_after_its_time() -> None:
    began = time.monotonic()
    assert not poll(lambda: False, every_s=0.01, at_most_s=0.05)
    assert time.monotonic() - began >= 0.05
    assert poll(lambda: True, every_s=0.01, at_most_s=0.0)
