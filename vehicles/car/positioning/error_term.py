"""Position errors that are added to those of the fix state, one table of `[gnss]` each."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

from numpy.random import Generator

from vehicles.car.dynamics import Body

Streams = Callable[[str], Generator]
"""Returns the random stream for a purpose; the same purpose always has the same stream."""


@dataclass(frozen=True, slots=True)
class ReceiverContext:
    """What the errors of one receiver need at the start of a run.

    Start (ns), initial distance behind the lead (m), and random streams: those of this receiver,
    and those that all receivers share.
    """

    start_at: int
    distance_behind_lead: float
    own_streams: Streams
    shared_streams: Streams


class ErrorProcess(Protocol):
    """A position error over one run; calls must be in order of time."""

    def at(self, body: Body, now: int) -> tuple[float, float]:
        """East and north (m) of the error at `now` (ns), for the car in state `body`."""
        ...


class ErrorTerm(ABC):
    """Settings of a position error: each subclass is a table of `[gnss]`.

    A field of `GnssSettings` makes it available.
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

    @abstractmethod
    def describe(self) -> str:
        """Short description for tables."""
