"""Persistent collisions, as in LTE-V2X mode 4: senders of one resource collide until one moves."""

from functools import cached_property
from math import inf
from typing import Annotated

from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import InvalidKeyError, LinkLaw, Ratio
from transport.links.laws.moments import Losses
from transport.links.laws.radio.reservations import Reservations
from transport.reasons import DropReason


class Collisions(LinkLaw):
    """Loses all messages of a reservation whose resource another sender has chosen, too.

    loss_ratio                  share of messages lost; all of a reservation or none
    keep_ratio                  chance of a resource to be kept at reselection: 0 to 0.8
    reselection_messages_min    messages of a reservation, uniform between these: 5 to 15 at
    reselection_messages_max    100 ms, 10 to 30 at 50 ms, 25 to 75 at 20 ms

    After a reservation the resource is kept with the chance `keep_ratio`; else a new one is chosen,
    which collides with the chance `loss_ratio`. That is the mean loss too, for the length does not
    depend on the resource. Source: sensing-based semi-persistent scheduling, 3GPP TS 36.321
    (5.14.1.1) and TS 36.213 (14.1.1.6): a counter of 5 to 15 at 100 ms, kept with 0 to 0.8.

    Each receiver has its own: a sender's resource collides on one link and not on another, as it
    does where the other sender is out of reach of the second receiver.
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

    def check(self) -> None:
        self.required("loss_ratio")
        least, most = self.reselection_messages_min, self.reselection_messages_max
        if most < least:
            allowed = f"at least reselection_messages_min, {least}"
            raise InvalidKeyError("reselection_messages_max", f"given {most}, allowed {allowed}")

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        selected = self._held.selected_at(draw, context.seq)
        return "collision" if draw("collision resource", selected) < self._loss else 0

    def losses(self, distance_m: float | None) -> Losses:
        """Loss in bursts of the reservations kept, and of those that choose badly again."""
        loss = self._loss
        if not loss:
            return Losses(0.0, None, 0.0)
        burst = self._held.mean_messages / (1.0 - loss) if loss < 1.0 else inf
        return Losses.of_bursts(loss, burst)

    def describe(self) -> str:
        return (
            f"persistent collisions: loss {self._loss:.4g} by reservations of "
            f"{self.reselection_messages_min} to {self.reselection_messages_max} messages, kept "
            f"with {self.keep_ratio:.4g}, {self.losses(None).burst or 0.0:.4g} messages in a row "
            "on average"
        )
