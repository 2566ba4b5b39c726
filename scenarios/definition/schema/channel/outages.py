"""What a scenario file may say of when and where a link carries nothing."""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.table import Table

Seconds = Annotated[float, Field(ge=0, le=86_400)]
Station = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]
Metres = Annotated[float, Field(ge=-200_000, le=200_000)]
MeanTime = Annotated[float, Field(ge=0.001, le=86_400)]


class SpanTable(Table):
    """A time from the start of the run on, once or again and again."""

    from_s: Seconds
    to_s: Seconds
    every_s: float | None = Field(default=None, gt=0, le=86_400)


class WindowTable(SpanTable):
    """An outage for a time."""

    kind: Literal["window"]


class WhereTable(Table):
    """What outages by place have: who has to be there."""

    who: Literal["sender", "receiver", "either", "both"] = "either"


class StretchTable(WhereTable):
    """A stretch of the road, by the arc length from the path's first point on.

    Laps of a path go on counting; `every_m` lets the stretch come again.
    """

    kind: Literal["stretch"]
    from_m: Station
    to_m: Station
    every_m: float | None = Field(default=None, gt=0, le=1_000_000)


class CircleTable(WhereTable):
    """A place, such as a tunnel, in the plane or on the earth (WGS84)."""

    kind: Literal["circle"]
    east_m: Metres | None = None
    north_m: Metres | None = None
    latitude_deg: float | None = Field(default=None, ge=-90, le=90)
    longitude_deg: float | None = Field(default=None, ge=-180, le=180)
    radius_m: float = Field(gt=0, le=100_000)


class RandomOutageTable(Table):
    """On and off by chance, for exponential times of these means."""

    kind: Literal["random"]
    mean_on_s: MeanTime
    mean_off_s: MeanTime


OutageTable = Annotated[
    WindowTable | StretchTable | CircleTable | RandomOutageTable, Field(discriminator="kind")
]
Outages = Annotated[tuple[OutageTable, ...], Field(strict=False)]
Spans = Annotated[tuple[SpanTable, ...], Field(strict=False)]
