"""Persistent collisions of LTE-V2X mode 4: two senders share a resource until one reselects."""

from collections.abc import Iterator
from functools import cached_property
from math import inf
from typing import Annotated

from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import LinkLaw, Problem, Ratio, problems_of
from transport.links.laws.moments import Losses
from transport.links.laws.radio.reservations import Reservations, reselection_problems
from transport.reasons import DropReason


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
            return Losses(0.0, None, 0.0)
        burst = self._held.mean_messages / (1.0 - loss) if loss < 1.0 else inf
        return Losses.of_bursts(loss, burst)

    def describe(self) -> str:
        return (
            f"persistent collisions: loss {self._loss:.4g} by reservations of "
            f"{self.reselection_messages_min} to {self.reselection_messages_max} messages, kept "
            f"with probability {self.keep_ratio:.4g}, {self.losses(None).burst or 0.0:.4g} "
            "messages in a row on average"
        )
