"""The share of messages that is delivered over a distance, by a table."""

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from math import inf
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import Problem, Ratio
from transport.links.laws.moments import Losses
from transport.links.laws.radio.radio_law import (
    PURPOSE,
    Radio,
    curve_problems,
    distance_of,
)
from transport.links.laws.radio.reservations import Reservations
from transport.reasons import DropReason

Metres = Annotated[float, Field(ge=0)]


class TableRadio(Radio):
    """The share of messages that is delivered over the true distance.

    `delivery_ratio` has a number for each of `distance_m`: linear between two, constant before the
    first, 0 beyond the last. With `burst` each message is lost on its own, or all are lost together
    that are sent with one reservation, as where another sender has chosen the same resources: for
    as many messages as the limits say, all numbers equally likely, and kept on with `keep_ratio`
    (3GPP TS 36.321: 5 to 15 at 10 Hz, 0 to 0.8). The share is the same, the bursts are not.
    """

    kind: Literal["table"] = "table"
    distance_m: Annotated[tuple[Metres, ...], Field(strict=False, min_length=1)]
    delivery_ratio: Annotated[tuple[Ratio, ...], Field(strict=False, min_length=1)]
    burst: Literal["independent", "reservation"] = "independent"
    keep_ratio: Annotated[float, Field(ge=0, le=0.99)] = 0.0
    reselection_messages_min: Annotated[int, Field(ge=1, le=1000)] = 5
    reselection_messages_max: Annotated[int, Field(ge=1, le=1000)] = 15

    def problems(self) -> Iterator[Problem]:
        over = ("distance_m", self.distance_m)
        yield from curve_problems("", over, ("delivery_ratio", self.delivery_ratio))
        least, most = self.reselection_messages_min, self.reselection_messages_max
        if most < least:
            allowed = f"at least reselection_messages_min, {least}"
            yield "reselection_messages_max", f"given {most}, allowed {allowed}"

    @cached_property
    def reservations(self) -> Reservations | None:
        if self.burst == "independent":
            return None
        least, most = self.reselection_messages_min, self.reselection_messages_max
        return Reservations(least, most, self.keep_ratio)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        drawn_for = context.seq
        if self.reservations is not None:
            drawn_for = self.reservations.selected_at(draw, drawn_for)
        return 0 if draw(PURPOSE, drawn_for) < self.ratio(distance_of(context)) else "range"

    def ratio(self, distance: float) -> float:
        """Share of messages delivered over `distance` (m)."""
        distances, ratios = self.distance_m, self.delivery_ratio
        if not distance <= distances[-1]:  # so that no place is out of range
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
        return Losses.of_bursts(loss, messages / (1.0 - loss) if loss < 1.0 else inf)

    @property
    def range_m(self) -> float:
        return self.distance_m[-1]

    def describe(self) -> str:
        distances, ratios, held = self.distance_m, self.delivery_ratio, self.reservations
        share = f"{ratios[0]:g} received at {distances[0]:g} m"
        if len(ratios) > 1:
            share += f" to {ratios[-1]:g} at {distances[-1]:g} m"
        if held is None:
            return f"{share}, each message on its own"
        return f"{share}, decided for {held.mean_messages:.3g} messages in a row on average"
