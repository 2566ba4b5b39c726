"""What a scenario file may say of the path: segments, a recorded trace, or points."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from scenarios.definition.schema.base_table import Table


class SegmentTable(Table):
    """A straight, or an arc of `curvature_per_m`, or of `radius_m` towards `turn`."""

    length_m: float = Field(ge=0.1, le=100_000)
    curvature_per_m: float | None = Field(default=None, ge=-1, le=1)
    radius_m: float | None = Field(default=None, ge=1, le=1_000_000)
    turn: Literal["left", "right"] | None = None


Laps = Annotated[int, Field(ge=1, le=1000)]


class SegmentsPath(Table):
    """Straights and arcs joined tangentially, driven `laps` times one after the other."""

    kind: Literal["segments"]
    segments: Annotated[tuple[SegmentTable, ...], Field(strict=False, min_length=1)]
    heading_deg: float = Field(default=90.0, ge=0, lt=360)
    laps: Laps = 1


class SmoothedPathTable(Table):
    """How points become a drivable path: half the width of the smoothing window, and laps."""

    smoothing_m: float = Field(default=8.0, gt=0, le=500)
    closed: bool = False
    laps: Laps = 1


class TracePath(SmoothedPathTable):
    """A recorded drive: CSV, GPX, NMEA 0183, or an MCAP log of this project (one vehicle's)."""

    kind: Literal["trace"]
    file: Annotated[str, StringConstraints(min_length=1)]
    vehicle: str | None = None


Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Counts = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(strict=False)]
Texts = Annotated[tuple[str, ...], Field(strict=False)]


class PointsPath(SmoothedPathTable):
    """Points in the plane, which a trace becomes when it is read: a log needs no other file.

    `time_s` and `speed_mps`, where known, have an entry for each point. Coordinates of the source
    are those of the points plus the offset. `source_numbers` say where in the source each point
    stands, by its `source_unit` (line, point, message); `remarks` what was changed on reading it.
    It is `geodetic` if it has latitudes. Times count from `epoch_s` on the `clock` if they are
    absolute, or else on that of the source. The points' noise is at least `noise_m` (standard
    deviation, per axis).
    """

    kind: Literal["points"]
    source: str = ""
    geodetic: bool = False
    east_offset_m: float = 0.0
    north_offset_m: float = 0.0
    clock: Literal["unix", "day"] | None = None
    epoch_s: float = 0.0
    source_unit: str = "point"
    source_numbers: Counts = ()
    noise_m: float = Field(default=0.0, ge=0)
    jumping_points: int = Field(default=0, ge=0)
    standing_points: int = Field(default=0, ge=0)
    remarks: Texts = ()
    skipped_lines: int = Field(default=0, ge=0)
    skipped_first: str = ""
    east_m: Numbers
    north_m: Numbers
    time_s: Numbers = ()
    speed_mps: Numbers = ()


PathTable = Annotated[SegmentsPath | TracePath | PointsPath, Field(discriminator="kind")]
