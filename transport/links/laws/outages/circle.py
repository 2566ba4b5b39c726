"""An outage within a circle."""

from collections.abc import Iterator
from functools import cached_property
from math import hypot, nan
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Draw, Position, TransmissionContext
from transport.links.laws.law import Problem
from transport.links.laws.outages.span import PlacedOutage
from transport.reasons import DropReason
from vehicles.geometry.geodesy import REACH, LocalPlane

Metres = Annotated[float, Field(ge=-200_000, le=200_000)]


class CircleOutage(PlacedOutage):
    """A place, such as a tunnel, in the plane or on the earth (WGS84)."""

    kind: Literal["circle"] = "circle"
    east_m: Metres | None = None
    north_m: Metres | None = None
    latitude_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    radius_m: Annotated[float, Field(gt=0, le=100_000)]

    def problems(self) -> Iterator[Problem]:
        """Return keys of a place that is given twice, in part or not at all."""
        pairs = (("east_m", "north_m"), ("latitude_deg", "longitude_deg"))
        given = [[key for key in pair if getattr(self, key) is not None] for pair in pairs]
        if given[0] and given[1]:
            yield given[1][0], f"given together with {given[0][0]}, allowed one of them"
        elif not given[0] and not given[1]:
            yield "east_m", "missing, needed with north_m, or latitude_deg and longitude_deg"
        for pair, found in zip(pairs, given, strict=True):
            if len(found) == 1:
                (missing,) = set(pair) - set(found)
                yield missing, f"missing, needed with {found[0]}"

    def problems_in(self, plane: LocalPlane) -> Iterator[Problem]:
        """Return the latitude of a place that is not near the plane's origin."""
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
        """Centre in the plane (m), which reaches it; NaN, where nobody is, without a plane."""
        plane = self.setting.plane
        if self.east_m is not None and self.north_m is not None:
            return self.east_m, self.north_m
        if plane is None or self.latitude_deg is None or self.longitude_deg is None:
            return nan, nan
        altitude_m = plane.origin.altitude_m
        return plane.to_plane(self.latitude_deg, self.longitude_deg, altitude_m)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002 - no chance
        """Drop by the ends' places."""
        sender, receiver = self._holds(context.sender), self._holds(context.receiver)
        return "outage" if self.inside(sender, receiver) else 0

    def _holds(self, place: Position) -> bool:
        east, north = self.centre
        return hypot(place.east - east, place.north - north) < self.radius_m

    def describe(self) -> str:
        """Give circle and ends."""
        east, north = self.centre
        where = f"{self.radius_m:g} m of east {east:g} m, north {north:g} m"
        return f"outage with {self.who} within {where}"
