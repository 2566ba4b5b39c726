"""Times and places without a fix, as in a tunnel: state 0 of NMEA 0183."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import hypot
from typing import Annotated

from vehicles.car.dynamics import Body
from vehicles.car.positioning.error_term import ReceiverContext
from vehicles.schedule import SECOND
from vehicles.setting import Problem, Setting, must_exceed

MAX_COORDINATE = 1_000_000  # Limit (m) of coordinates and distances in scenario files


class FixOutage(ABC):
    """A time or place without a fix."""

    __slots__ = ()

    @abstractmethod
    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        """Whether the receiver has no fix at `now` (ns), with the car in state `body`."""

    def problems(self) -> Iterator[Problem]:
        yield from ()


@dataclass(frozen=True, slots=True)
class FixOutageWindow(FixOutage):
    """No fix between two times after the start of the run."""

    begin: Annotated[
        int, Setting("start of the outage, inclusive", "s", 0, 86_400, name="from", example=20.0)
    ]
    end: Annotated[
        int, Setting("end of the outage, exclusive", "s", 0, 86_400, name="to", example=25.0)
    ]

    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        return self.begin <= now - context.start_at < self.end

    def problems(self) -> Iterator[Problem]:
        yield from must_exceed("to_s", self.end / SECOND, self.begin / SECOND)


@dataclass(frozen=True, slots=True)
class FixOutageStretch(FixOutage):
    """No fix on a stretch of road, by arc length from the lead's start; it continues over laps.

    Outages of [links] are by arc length from the first point of the path instead.
    """

    begin: Annotated[
        float,
        Setting(
            "start of the stretch, inclusive",
            unit="m",
            minimum=-MAX_COORDINATE,
            maximum=MAX_COORDINATE,
            name="from",
            example=300.0,
        ),
    ]
    end: Annotated[
        float,
        Setting(
            "end of the stretch, exclusive",
            unit="m",
            minimum=-MAX_COORDINATE,
            maximum=MAX_COORDINATE,
            name="to",
            example=400.0,
        ),
    ]

    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        return self.begin <= body.distance - context.distance_behind_lead < self.end

    def problems(self) -> Iterator[Problem]:
        yield from must_exceed("to_m", self.end, self.begin)


@dataclass(frozen=True, slots=True)
class FixOutageCircle(FixOutage):
    """No fix within a circle in the plane."""

    east: Annotated[
        float, Setting("centre, east", "m", -MAX_COORDINATE, MAX_COORDINATE, example=500.0)
    ]
    north: Annotated[
        float, Setting("centre, north", "m", -MAX_COORDINATE, MAX_COORDINATE, example=0.0)
    ]
    radius: Annotated[float, Setting("radius", "m", above=0, maximum=MAX_COORDINATE, example=40.0)]

    def covers(self, body: Body, now: int, context: ReceiverContext) -> bool:
        return hypot(body.east - self.east, body.north - self.north) <= self.radius


OUTAGES: Mapping[str, type[FixOutage]] = {
    "time": FixOutageWindow,
    "road": FixOutageStretch,
    "circle": FixOutageCircle,
}
