"""Delivery ratio over distance by a table."""

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from math import inf
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import Problem, Ratio
from transport.links.laws.moments import Losses
from transport.links.laws.radio.radio_law import PURPOSE, Radio, curve_problems, distance_of
from transport.links.laws.radio.reservations import Reservations, reselection_problems
from transport.reasons import DropReason

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
        return Losses.of_bursts(loss, messages / (1.0 - loss) if loss < 1.0 else inf)

    @property
    def range_m(self) -> float:
        return self.distance_m[-1]

    def describe(self) -> str:
        distances, ratios, held = self.distance_m, self.delivery_ratio, self.reservations
        ratio = f"delivery ratio {ratios[0]:g} at {distances[0]:g} m"
        if len(ratios) > 1:
            ratio += f" to {ratios[-1]:g} at {distances[-1]:g} m"
        if held is None:
            return f"{ratio}, messages independent"
        return f"{ratio}, drawn for {held.mean_messages:.3g} messages in a row on average"
