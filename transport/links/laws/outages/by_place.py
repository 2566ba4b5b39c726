"""Outages on a stretch of the road, or within a circle."""

from collections.abc import Iterator
from functools import cached_property
from math import hypot, inf, nan
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, Position, TransmissionContext
from transport.links.laws.link_law import Problem
from transport.links.laws.outages.by_time import Interval, Outage
from transport.reasons import DropReason
from vehicles.geometry.geodesy import REACH, LocalPlane

AffectedVehicle = Literal["sender", "receiver", "either", "both"]  # Must be inside
Station = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]
Metres = Annotated[float, Field(ge=-200_000, le=200_000)]


class PlacedOutage(Outage):
    """Base of outages by place.

    vehicle  which end of the link must be inside: sender, receiver, either or both
    """

    judged_by = "place"

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

    def describe(self) -> str:
        return f"outage while {self.ends} on the road {self.interval.describe('m')}"


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
        if not plane.reaches(latitude, longitude, plane.origin.altitude_m):
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

    def describe(self) -> str:
        east, north = self.centre
        circle = f"{self.radius_m:g} m of east {east:g} m, north {north:g} m"
        return f"outage while {self.ends} within {circle}"
