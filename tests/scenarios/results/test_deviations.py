"""True errors and gaps for plots, of equal instants in any order of recording."""

from math import isnan

import pytest

from scenarios.results.stream import PERIOD_NS, Deviations, TrueDeviation

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
    results = found(steps(100))
    assert [one.at_ns for one in results] == list(range(0, 100 * TICK, PERIOD_NS))
    for one in results:
        tick = one.at_ns // TICK
        assert one.error == pytest.approx(0.1 * tick)
        assert one.gap == 20.0 - tick


@pytest.mark.parametrize("late_one", ["error", "gap"])
def test_late_messages_change_nothing(late_one: str) -> None:
    """The pose of the vehicle ahead may come up to a second after one's own."""
    late = [(at + (35 * TICK if kind == late_one else 0), kind, at, value)
            for kind, at, value in steps(100)]  # fmt: skip
    reordered = [(kind, at, value) for _, kind, at, value in sorted(late, key=lambda row: row[0])]
    assert sorted(found(reordered)) == found(steps(100))


def test_without_a_vehicle_ahead_the_error_is_passed_on_alone() -> None:
    results = found([step for step in steps(100) if step[0] == "error"])
    assert len(results) >= 9
    late_results = found([step for step in steps(100) if step[0] == "gap"])
    assert (late_results[0].at_ns, late_results[0].gap) == (0, 20.0)
    assert all(isnan(one.gap) for one in results)
