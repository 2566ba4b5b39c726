"""Base of outages, and outages by time.

Outages are judged by the instant of sending and the true positions of both ends at that instant.
Intervals are half open: their end is outside.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import inf
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, JudgedBy, TransmissionContext
from transport.links.laws.link_law import LinkLaw, Problem
from transport.links.laws.moments import Losses
from transport.reasons import DropReason
from vehicles.schedule import SECOND

Seconds = Annotated[float, Field(ge=0, le=86_400)]


@dataclass(frozen=True, slots=True)
class Interval:
    """From `start` to before `end`, repeated every `every`, in any unit."""

    start: float
    end: float
    every: float = inf

    def contains(self, value: float) -> bool:
        if self.every < inf and value >= self.start:
            return (value - self.start) % self.every < self.end - self.start
        return self.start <= value < self.end

    def describe(self, unit: str) -> str:
        every = f", every {self.every:g} {unit}" if self.every < inf else ""
        return f"from {self.start:g} to {self.end:g} {unit}{every}"

    def problems(self, unit: str) -> Iterator[Problem]:
        length = self.end - self.start
        if length <= 0.0:
            allowed = f"allowed more than from_{unit}, {self.start:g}"
            yield f"to_{unit}", f"given {self.end:g}, {allowed}"
        elif self.every < length:
            allowed = f"allowed at least to_{unit} - from_{unit}, {length:g}"
            yield f"every_{unit}", f"given {self.every:g}, {allowed}"


class Outage(LinkLaw):
    """Base of outages; the loss ratio depends on when or where messages are sent."""

    key = "outages"
    reason: ClassVar[DropReason | None] = "outage"
    judged_by: ClassVar[JudgedBy] = "time"

    def losses(self, distance_m: float | None) -> Losses | None:
        return None


class SpanOutage(Outage):
    """A time window from the start of the run, once or repeated.

    from_s   start of the window, after the start of the run, inclusive
    to_s     end of the window, exclusive
    every_s  period after which the window repeats; default: never
    """

    from_s: Seconds
    to_s: Seconds
    every_s: Annotated[float, Field(gt=0, le=86_400)] | None = None

    @property
    def interval(self) -> Interval:
        return Interval(self.from_s, self.to_s, inf if self.every_s is None else self.every_s)

    def problems(self) -> Iterator[Problem]:
        return self.interval.problems("s")

    @cached_property
    def _bounds(self) -> tuple[int, int, int, DropReason]:
        """Start, length, period or 0 (whole ns, so that bounds are exact), and the reason."""
        start, end = round(self.from_s * SECOND), round(self.to_s * SECOND)
        every, reason = round((self.every_s or 0.0) * SECOND), self.reason or "outage"
        return self.setting.start_at + start, end - start, every, reason

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        start_at, length, every, reason = self._bounds
        since = context.sent_at - start_at
        if every and since >= 0:
            since %= every
        return reason if 0 <= since < length else 0

    def losses(self, distance_m: float | None) -> Losses | None:
        """Share of the time if the window repeats."""
        _, length, every, _ = self._bounds
        return Losses(length / every, None, 0.0) if every else None

    def describe(self) -> str:
        return f"{(self.reason or 'outage').replace('_', ' ')} {self.interval.describe('s')}"


class WindowOutage(SpanOutage):
    """Outage in a time window."""

    kind: Literal["window"] = "window"


class TransmitterOff(SpanOutage):
    """Time window in which a vehicle's transmitter is off."""

    key = "transmitter_off"
    reason = "transmitter_off"


class ReceiverOff(SpanOutage):
    """Time window in which a vehicle's receiver is off."""

    key = "receiver_off"
    reason = "receiver_off"
