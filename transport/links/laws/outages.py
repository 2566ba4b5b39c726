"""Base of outages, and outages by time.

Outages are judged by the instant of sending and the true positions of both ends at that instant.
Intervals are half open: their end is outside.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import exp, hypot, inf, nan
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from transport.links.laws.link_law import (
    Draw,
    LinkLaw,
    Losses,
    Position,
    Problem,
    TransmissionContext,
)
from transport.topics import DropReason
from vehicles.geometry.geodesy import REACH, LocalPlane
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
        return Losses(length / every) if every else None


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


# ---- Outages on a stretch of the road, or within a circle


AffectedVehicle = Literal["sender", "receiver", "either", "both"]  # Must be inside
Station = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]
Metres = Annotated[float, Field(ge=-200_000, le=200_000)]


class PlacedOutage(Outage):
    """Base of outages by place.

    vehicle  which end of the link must be inside: sender, receiver, either or both
    """

    vehicle: AffectedVehicle = "either"

    @property
    def ends(self) -> str:
        if self.vehicle == "both":
            return "both ends are"
        return "either end is" if self.vehicle == "either" else f"the {self.vehicle} is"

    def inside(self, sender: bool, receiver: bool) -> bool:
        if self.vehicle == "either":
            return sender or receiver
        if self.vehicle == "both":
            return sender and receiver
        return sender if self.vehicle == "sender" else receiver


class StretchOutage(PlacedOutage):
    """Outage on a stretch of the road.

    from_m   arc length from the first point of the path, inclusive
    to_m     end of the stretch, exclusive
    every_m  period after which the stretch repeats; default: never

    The arc length continues over the laps of a closed path. The position of a vehicle along the
    path is its initial arc length plus the distance driven. Outages of [gnss] are by arc length
    from the lead's start instead.
    """

    kind: Literal["stretch"] = "stretch"
    from_m: Station
    to_m: Station
    every_m: Annotated[float, Field(gt=0, le=1_000_000)] | None = None

    @cached_property
    def interval(self) -> Interval:
        return Interval(self.from_m, self.to_m, inf if self.every_m is None else self.every_m)

    def problems(self) -> Iterator[Problem]:
        return self.interval.problems("m")

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        setting, contains = self.setting, self.interval.contains
        sender = contains(setting.sender_station + context.sender.travelled)
        receiver = contains(setting.receiver_station + context.receiver.travelled)
        return "outage" if self.inside(sender, receiver) else 0


class CircleOutage(PlacedOutage):
    """Outage within a circle.

    east_m         centre, east, in the plane of the scenario
    north_m        centre, north, in the plane of the scenario
    latitude_deg   latitude of the centre, in place of east_m and north_m
    longitude_deg  longitude of the centre
    radius_m       radius of the circle
    """

    kind: Literal["circle"] = "circle"
    east_m: Metres | None = None
    north_m: Metres | None = None
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    radius_m: Annotated[float, Field(gt=0, le=100_000)]

    def problems(self) -> Iterator[Problem]:
        pairs = (("east_m", "north_m"), ("latitude_deg", "longitude_deg"))
        given = [[key for key in pair if getattr(self, key) is not None] for pair in pairs]
        if given[0] and given[1]:
            yield given[1][0], f"given together with {given[0][0]}, allowed one of them"
        elif not given[0] and not given[1]:
            yield "east_m", "missing, needed with north_m, or latitude_deg and longitude_deg"
        for pair, keys in zip(pairs, given, strict=True):
            if len(keys) == 1:
                (missing,) = set(pair) - set(keys)
                yield missing, f"missing, needed with {keys[0]}"

    def plane_problems(self, plane: LocalPlane) -> Iterator[Problem]:
        latitude, longitude = self.latitude_deg, self.longitude_deg
        if latitude is None or longitude is None:
            return
        try:
            plane.to_plane(latitude, longitude, plane.origin.altitude_m)
        except ValueError:
            yield (
                "latitude_deg",
                f"given {latitude:g} with longitude_deg {longitude:g}, allowed up to "
                f"{REACH / 1000.0:g} km from the origin of the plane",
            )

    @cached_property
    def centre(self) -> tuple[float, float]:
        """Centre in the plane (m); NaN without a plane, where no vehicle is inside."""
        plane = self.setting.plane
        if self.east_m is not None and self.north_m is not None:
            return self.east_m, self.north_m
        if plane is None or self.latitude_deg is None or self.longitude_deg is None:
            return nan, nan
        altitude_m = plane.origin.altitude_m
        return plane.to_plane(self.latitude_deg, self.longitude_deg, altitude_m)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        sender, receiver = self._contains(context.sender), self._contains(context.receiver)
        return "outage" if self.inside(sender, receiver) else 0

    def _contains(self, position: Position) -> bool:
        east, north = self.centre
        return hypot(position.east - east, position.north - north) < self.radius_m


# ---- Outage of random duration


MeanTime = Annotated[float, Field(ge=0.001, le=86_400)]
CACHED_CELLS = 8  # Number of cells whose draws are cached


class RandomOutage(Outage):
    """Random outages with exponentially distributed durations.

    mean_on_s   mean time between outages
    mean_off_s  mean duration of an outage

    The two-state Markov process is computed without its history (uniformisation, Jensen 1953): at
    the events of a Poisson process of rate 1/mean_on + 1/mean_off the state is drawn again, off
    with its stationary probability. The state is that of the last event. Time is divided into
    cells of about one event; the number, instants and states of the events are drawn per cell.
    """

    kind: Literal["random"] = "random"
    mean_on_s: MeanTime
    mean_off_s: MeanTime

    @cached_property
    def _means(self) -> tuple[int, int]:
        return round(self.mean_on_s * SECOND), round(self.mean_off_s * SECOND)

    @cached_property
    def cell(self) -> int:
        """Length of a cell (ns): the mean time between events."""
        on, off = self._means
        return max(round(on * off / (on + off)), 1)

    @cached_property
    def _cells(self) -> dict[tuple[Draw, int], tuple[tuple[int, bool], ...]]:
        return {}

    @property
    def off_ratio(self) -> float:
        on, off = self._means
        return off / (on + off)

    def losses(self, distance_m: float | None) -> Losses:
        return Losses(self.off_ratio)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "outage" if self.is_off(draw, context.sent_at - self.setting.start_at) else 0

    def is_off(self, draw: Draw, since: int) -> bool:
        """Whether the link is off `since` ns after the start."""
        cell = since // self.cell
        while True:
            before = [event for event in self._events(draw, cell) if event[0] <= since]
            if before:
                return max(before)[1]
            cell -= 1

    def _events(self, draw: Draw, cell: int) -> tuple[tuple[int, bool], ...]:
        """Events of a cell: instants (ns) and whether the link is off from then on.

        The index of the law is part of the draws, so that appended outages do not change it.
        """
        known = self._cells.get((draw, cell))
        if known is None:
            length, (on, off), share = self.cell, self._means, self.off_ratio
            purpose = f"outage {self.setting.place}"
            mean = length * (1.0 / on + 1.0 / off)
            known = tuple(
                (
                    cell * length + int(draw(f"{purpose} at {k}", cell) * length),
                    draw(f"{purpose} off {k}", cell) < share,
                )
                for k in range(_poisson(draw(f"{purpose} count", cell), mean))
            )
            self._cells[draw, cell] = known
            if len(self._cells) > CACHED_CELLS:
                del self._cells[next(iter(self._cells))]
        return known


def _poisson(probability: float, mean: float) -> int:
    count, term = 0, exp(-mean)
    total = term
    while probability >= total and term > 0.0:
        count += 1
        term *= mean / count
        total += term
    return count
