"""True errors and gaps for plots: of equal instants, whoever was recorded first."""

from math import isnan

import pytest

from scenarios.results.deviations import PERIOD_NS, Deviations, TrueDeviation

TICK = 20_000_000


def steps(ticks: int) -> list[tuple[str, int, float]]:
    return [
        step
        for tick in range(ticks)
        for step in (("error", tick * TICK, 0.1 * tick), ("gap", tick * TICK, 20.0 - tick))
    ]


def found(given: list[tuple[str, int, float]]) -> list[TrueDeviation]:
    deviations = Deviations(["v2"])
    for kind, at, value in given:
        (deviations.add_error if kind == "error" else deviations.add_gap)("v2", at, value)
    return deviations.take_new()


def test_error_and_gap_are_of_one_instant_ten_times_a_second() -> None:
    told = found(steps(100))
    assert [one.at_ns for one in told] == list(range(0, 100 * TICK, PERIOD_NS))
    for one in told:
        tick = one.at_ns // TICK
        assert one.error == pytest.approx(0.1 * tick)
        assert one.gap == 20.0 - tick


@pytest.mark.parametrize("late_one", ["error", "gap"])
def test_what_comes_late_changes_nothing(late_one: str) -> None:
    """The pose of the vehicle ahead may come up to a second after one's own."""
    late = [(at + (35 * TICK if kind == late_one else 0), kind, at, value)
            for kind, at, value in steps(100)]  # fmt: skip
    reordered = [(kind, at, value) for _, kind, at, value in sorted(late, key=lambda row: row[0])]
    assert sorted(found(reordered)) == found(steps(100))


def test_without_a_vehicle_ahead_the_error_is_told_alone() -> None:
    told = found([step for step in steps(100) if step[0] == "error"])
    assert len(told) >= 9
    told_late = found([step for step in steps(100) if step[0] == "gap"])
    assert (told_late[0].at_ns, told_late[0].gap) == (0, 20.0)
    assert all(isnan(one.gap) for one in told)


def test_nothing_is_told_twice() -> None:
    deviations = Deviations(["v2"])
    deviations.add_error("v2", 0, 0.1)
    deviations.add_gap("v2", 0, 5.0)
    assert deviations.take_new() == [TrueDeviation("v2", 0, 0.1, 5.0)]
    assert deviations.take_new() == []
