"""Position errors that are added to those of the fix state, one table of `[gnss]` each."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

from numpy.random import Generator

from vehicles.car.dynamics import Body

Streams = Callable[[str], Generator]  # Random stream of a purpose, always the same


@dataclass(frozen=True, slots=True)
class ReceiverContext:
    """What the errors of one receiver need at the start of a run.

    start_at              start of the run (ns)
    distance_behind_lead  initial distance behind the lead (m)
    own_streams           returns the NumPy generator of this receiver for a purpose
    shared_streams        returns the generator that all receivers share
    """

    start_at: int
    distance_behind_lead: float
    own_streams: Streams
    shared_streams: Streams

    def for_entry(self, index: int) -> "ReceiverContext":
        """Context of an entry of a list, with random streams of its own."""
        own, shared = self.own_streams, self.shared_streams
        return replace(
            self,
            own_streams=lambda purpose: own(f"errors {index} {purpose}"),
            shared_streams=lambda purpose: shared(f"errors {index} {purpose}"),
        )


class ErrorProcess(Protocol):
    """A position error over one run; calls must be in order of time."""

    def at(self, body: Body, now: int) -> tuple[float, float]:
        """East and north (m) of the error at `now` (ns).

        `body` is the true state of the car: `east`, `north` (m), `yaw` (rad), `speed` (m/s),
        `distance` driven (m).
        """
        ...


class ErrorTerm(ABC):
    """Settings of a position error: a frozen dataclass whose fields are its parameters.

    `begin(context)` draws the random numbers of a run and returns the error over time, an object
    with the method `at` of `ErrorProcess`. Random numbers come only from the streams of the
    context, so that the same seed gives the same run. Followers assume the `variance`; `describe`
    is for tables.
    """

    __slots__ = ()

    shared: ClassVar[bool] = False
    """Whether all receivers share the error, so that it cancels between vehicles."""

    @property
    @abstractmethod
    def variance(self) -> float:
        """Variance (m²) per axis of the random part."""

    @abstractmethod
    def begin(self, context: ReceiverContext) -> ErrorProcess:
        """Draw the random numbers of a run."""

    def describe(self) -> str:
        return type(self).__name__


def begin_term(term: ErrorTerm, context: ReceiverContext) -> ErrorProcess:
    return term.begin(context)
