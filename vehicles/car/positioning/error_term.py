"""Position errors that are added to those of the fix state, each a table of its own."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol

from numpy.random import Generator

from vehicles.car.dynamics import Body

Streams = Callable[[str], Generator]
"""Returns the stream of random numbers of a purpose, always the same one for the same purpose."""


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
    """An error over one run, in order of time."""

    def at(self, body: Body, now: int) -> tuple[float, float]:
        """East and north (m) of the error at `now` (ns) of the car there."""
        ...


class ErrorTerm(ABC):
    """Settings of an error of positions: each subclass is a table of `[gnss]`.

    A field of `GnssSettings` makes it available.
    """

    __slots__ = ()

    shared: ClassVar[bool] = False
    """Whether all receivers have the same error, which cancels between vehicles."""

    @property
    @abstractmethod
    def variance(self) -> float:
        """Variance (m²) per axis, as far as it is random."""

    @abstractmethod
    def begin(self, context: ReceiverContext) -> ErrorProcess:
        """Draw what is random about a run."""

    @abstractmethod
    def describe(self) -> str:
        """Short description for tables."""
