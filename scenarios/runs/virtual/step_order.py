"""The order of steps in virtual time: by instant, and at one instant from the lead backwards."""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from heapq import merge

from transport.clock import Tick

Step = Callable[[Tick], None]


@dataclass(frozen=True, slots=True)
class Stepper:
    """Makes a `step` at each of its `ticks`; equal `schedule`s have equal ticks."""

    schedule: Hashable
    ticks: Callable[[], Iterator[Tick]]
    step: Step


def steps_in_order(steppers: Sequence[Stepper]) -> Iterator[tuple[Tick, Step]]:
    """Yield all steps in order of time, at equal instants in the order of `steppers`."""
    if len({stepper.schedule for stepper in steppers}) == 1:
        # The usual case: what follows gives the same, but more slowly.
        steps = [stepper.step for stepper in steppers]
        for tick in steppers[0].ticks():
            for step in steps:
                yield tick, step
        return

    def of_one(place: int) -> Iterator[tuple[int, int, Tick]]:
        return ((tick.at, place, tick) for tick in steppers[place].ticks())

    for _, place, tick in merge(*map(of_one, range(len(steppers)))):
        yield tick, steppers[place].step
