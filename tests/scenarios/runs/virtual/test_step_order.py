"""The order of the steps of several vehicles, each with a schedule of its own."""

from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from scenarios.runs.virtual import Stepper, steps_in_order
from transport.clock import Tick, ticks

END = 200_000_000


@given(st.lists(st.sampled_from([10.0, 20.0, 50.0, 33.3]), min_size=1, max_size=4))
def test_all_ticks_come_in_order_and_those_of_one_instant_from_the_first_stepper_on(
    rates: list[float],
) -> None:
    results: list[tuple[int, int]] = []

    def report(place: int, tick: Tick) -> None:
        results.append((tick.at, place))

    steppers = [
        Stepper(rate, partial(ticks, 0, END, rate), partial(report, place))
        for place, rate in enumerate(rates)
    ]
    for tick, step in steps_in_order(steppers):
        step(tick)
    every = [(tick.at, place) for place, rate in enumerate(rates) for tick in ticks(0, END, rate)]
    assert results == sorted(every)
