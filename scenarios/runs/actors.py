"""Whose turn it is in virtual time: all ticks in order, those of one instant from the lead back."""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from heapq import merge

from transport.clock import Tick

Step = Callable[[Tick], None]


@dataclass(frozen=True, slots=True)
class Actor:
    """Does its `step` at each of its `ticks`; actors of an equal `schedule` have equal ticks."""

    schedule: Hashable
    ticks: Callable[[], Iterator[Tick]]
    step: Step


def in_turn(actors: Sequence[Actor]) -> Iterator[tuple[Tick, Step]]:
    """All ticks of all actors in order of time, those of one instant in the order of `actors`."""
    if len({actor.schedule for actor in actors}) == 1:  # as usual; the rest would do, but slowly
        steps = [actor.step for actor in actors]
        for tick in actors[0].ticks():
            for step in steps:
                yield tick, step
        return

    def of_one(place: int) -> Iterator[tuple[int, int, Tick]]:
        return ((tick.at, place, tick) for tick in actors[place].ticks())

    for _, place, tick in merge(*map(of_one, range(len(actors)))):
        yield tick, actors[place].step
