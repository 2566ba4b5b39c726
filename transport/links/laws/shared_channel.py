"""Reservations of radio resources, each for several successive messages (LTE-V2X mode 4)."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from heapq import heapreplace
from math import inf
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.link_law import (
    Draw,
    LinkLaw,
    Losses,
    Problem,
    Ratio,
    TransmissionContext,
    problems_of,
)
from transport.links.laws.radio import PURPOSE, Radio, curve_problems, distance_of
from transport.topics import DropReason

CACHE_SIZE = 64  # Number of links whose last reservation is cached
LOOK_BACK = 8  # First distance, in longest reservations; doubled until enough


@dataclass(frozen=True, slots=True)
class Reservations:
    """A sender's reservations: each lasts `least` to `most` messages, all numbers equally likely.

    After a reservation the resource is kept with probability `kept`, otherwise the sender selects
    another one (3GPP TS 36.321, 5.14.1.1: 5 to 15 messages at 10 Hz, kept with 0 to 0.8). The
    sequence is stationary from the first message on. The reservation of a message can be computed
    alone: sequences that begin at different messages soon end a reservation at the same message and
    agree from there on (coupling from the past). Reservations of constant length never couple, so
    their first message is drawn.
    """

    least: int
    most: int
    kept: float = 0.0
    purpose: str = "reservation"
    _known: dict[Draw, tuple[int, int, int]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not 1 <= self.least <= self.most:
            raise ValueError(f"reservations for {self.least} to {self.most} messages")
        if not 0.0 <= self.kept < 1.0:
            raise ValueError(f"kept with probability {self.kept}")

    @property
    def mean_messages(self) -> float:
        return 0.5 * (self.least + self.most) / (1.0 - self.kept)

    def selected_at(self, draw: Draw, seq: int) -> int:
        """Number of the first message sent with the resource of message `seq`."""
        known = self._known.get(draw)
        if known is None or not known[1] <= seq < known[2] + LOOK_BACK * self.most:
            known = self._find(draw, seq)
        selected, begin, end = known
        while end <= seq:
            begin, end = end, end + self._length(draw, end)
            if not self._is_kept(draw, begin):
                selected = begin
        if len(self._known) >= CACHE_SIZE:
            self._known.clear()
        self._known[draw] = selected, begin, end
        return selected

    def _find(self, draw: Draw, seq: int) -> tuple[int, int, int]:
        """Find the last reservation up to `seq` whose resource was newly selected.

        Returns the message of the selection, and the begin and end of the reservation.
        """
        back = LOOK_BACK * self.most
        while True:
            begin = self._coupled(draw, seq - back)
            while begin <= seq:
                if not self._is_kept(draw, begin):
                    return begin, begin, begin + self._length(draw, begin)
                begin += self._length(draw, begin)
            back *= 2

    def _coupled(self, draw: Draw, start: int) -> int:
        """First message at which all sequences possible at `start` begin a reservation."""
        if self.least == self.most:
            begin = int(draw(f"{self.purpose} begin", 0) * self.most)
            return start + (begin - start) % self.most
        ends = list(range(start, start + self.most))  # ascending, and so a heap
        last = ends[-1]
        while ends[0] != last:
            following = ends[0] + self._length(draw, ends[0])
            heapreplace(ends, following)
            last = max(last, following)
        return last

    def _length(self, draw: Draw, begin: int) -> int:
        return self.least + int(draw(self.purpose, begin) * (self.most - self.least + 1))

    def _is_kept(self, draw: Draw, begin: int) -> bool:
        return draw(f"{self.purpose} kept", begin) < self.kept


def reselection_problems(least: int, most: int) -> Iterator[Problem]:
    """Yield a maximum number of messages per reservation that is below the minimum."""
    if most < least:
        allowed = f"at least reselection_messages_min, {least}"
        yield "reselection_messages_max", f"given {most}, allowed {allowed}"


# ---- Persistent collisions of LTE-V2X mode 4: two senders share a resource until one reselects


class Collisions(LinkLaw):
    """All messages of a reservation are lost if another sender selected the same resource.

    loss_ratio                mean loss; a reservation loses all of its messages or none
    keep_ratio                probability of keeping the resource at reselection: 0 to 0.8 in TS
                              36.321
    reselection_messages_min  minimum number of messages per reservation: 5 at 100 ms, 10 at 50 ms,
                              25 at 20 ms
    reselection_messages_max  maximum number, all numbers equally likely: 15 at 100 ms, 30 at 50 ms,
                              75 at 20 ms

    After a reservation the resource is kept with probability `keep_ratio`. Otherwise a new one is
    selected, which collides with probability `loss_ratio`. Source: sensing-based semi-persistent
    scheduling, 3GPP TS 36.321 (5.14.1.1) and TS 36.213 (14.1.1.6). Collisions are drawn per link:
    the other sender may be out of range of another receiver.
    """

    key = "collisions"
    reason = "collision"

    loss_ratio: Ratio | None = None
    keep_ratio: Annotated[float, Field(ge=0, le=0.99)] = 0.0
    reselection_messages_min: Annotated[int, Field(ge=1, le=1000)] = 5
    reselection_messages_max: Annotated[int, Field(ge=1, le=1000)] = 15

    @cached_property
    def _loss(self) -> float:
        loss: float = self.required("loss_ratio")
        return loss

    @cached_property
    def _held(self) -> Reservations:
        least, most = self.reselection_messages_min, self.reselection_messages_max
        return Reservations(least, most, self.keep_ratio, "collision")

    def problems(self) -> Iterator[Problem]:
        yield from problems_of(lambda: self._loss)
        least, most = self.reselection_messages_min, self.reselection_messages_max
        yield from reselection_problems(least, most)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        selected = self._held.selected_at(draw, context.seq)
        return "collision" if draw("collision resource", selected) < self._loss else 0

    def losses(self, distance_m: float | None) -> Losses:
        loss = self._loss
        if not loss:
            return Losses(0.0)
        burst = self._held.mean_messages / (1.0 - loss) if loss < 1.0 else inf
        return Losses(loss, burst)


# ---- Delivery ratio over distance by a table


Metres = Annotated[float, Field(ge=0)]


class TableRadio(Radio):
    """Delivery ratio over the true distance between the antennas, by a table.

    distance_m                increasing distances
    delivery_ratio            delivery ratio at each distance: linear in between, constant below the
                              first distance, 0 beyond the last
    burst                     "independent": each message is lost independently; "reservation": all
                              messages of a reservation are lost together, with the same mean loss
    keep_ratio                probability of keeping the resource at reselection: 0 to 0.8 in 3GPP
                              TS 36.321
    reselection_messages_min  minimum number of messages per reservation: 5 at 10 Hz
    reselection_messages_max  maximum number, all numbers equally likely: 15 at 10 Hz
    """

    kind: Literal["table"] = "table"
    distance_m: Annotated[tuple[Metres, ...], Field(strict=False, min_length=1)]
    delivery_ratio: Annotated[tuple[Ratio, ...], Field(strict=False, min_length=1)]
    burst: Literal["independent", "reservation"] = "independent"
    keep_ratio: Annotated[float, Field(ge=0, le=0.99)] = 0.0
    reselection_messages_min: Annotated[int, Field(ge=1, le=1000)] = 5
    reselection_messages_max: Annotated[int, Field(ge=1, le=1000)] = 15

    def problems(self) -> Iterator[Problem]:
        x, y = ("distance_m", self.distance_m), ("delivery_ratio", self.delivery_ratio)
        yield from curve_problems("", x, y)
        least, most = self.reselection_messages_min, self.reselection_messages_max
        yield from reselection_problems(least, most)

    @cached_property
    def reservations(self) -> Reservations | None:
        if self.burst == "independent":
            return None
        least, most = self.reselection_messages_min, self.reselection_messages_max
        return Reservations(least, most, self.keep_ratio)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        number = context.seq
        if self.reservations is not None:
            number = self.reservations.selected_at(draw, number)
        return 0 if draw(PURPOSE, number) < self.ratio(distance_of(context)) else "range"

    def ratio(self, distance: float) -> float:
        """Delivery ratio over `distance` (m); 0 for NaN."""
        distances, ratios = self.distance_m, self.delivery_ratio
        if not distance <= distances[-1]:
            return 0.0
        after = bisect_right(distances, distance)
        if after in {0, len(distances)}:
            return ratios[max(after - 1, 0)]
        near, far = distances[after - 1], distances[after]
        share = (distance - near) / (far - near)
        return ratios[after - 1] + share * (ratios[after] - ratios[after - 1])

    def losses(self, distance_m: float | None) -> Losses | None:
        if distance_m is None:
            return None
        loss, held = 1.0 - self.ratio(distance_m), self.reservations
        messages = 1.0 if held is None else held.mean_messages
        return Losses(loss, messages / (1.0 - loss) if loss < 1.0 else inf)
