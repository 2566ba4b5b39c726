"""Tables of the path: segments, a recorded trace, or points."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from scenarios.definition.schema.base_table import Table


class SegmentTable(Table):
    """A straight or an arc.

    length_m         arc length
    curvature_per_m  curvature, positive to the left; without it a straight
    radius_m         radius instead of a curvature, with `turn`
    turn             direction of an arc with a radius
    """

    length_m: float = Field(ge=0.1, le=100_000)
    curvature_per_m: float | None = Field(default=None, ge=-1, le=1)
    radius_m: float | None = Field(default=None, ge=1, le=1_000_000)
    turn: Literal["left", "right"] | None = None


Laps = Annotated[int, Field(ge=1, le=1000)]


class SegmentsPath(Table):
    """Straights and arcs joined tangentially.

    segments     the straights and arcs in order
    heading_deg  initial compass course
    laps         repetitions of all segments
    """

    kind: Literal["segments"]
    segments: Annotated[tuple[SegmentTable, ...], Field(strict=False, min_length=1)]
    heading_deg: float = Field(default=90.0, ge=0, lt=360)
    laps: Laps = 1


class SmoothedPathTable(Table):
    """A path through points.

    smoothing_m  half width of the smoothing window; about half the smallest radius, more for noise
    closed       whether the path ends where it begins
    laps         laps of a closed path
    """

    smoothing_m: float = Field(default=8.0, gt=0, le=500)
    closed: bool = False
    laps: Laps = 1


class TracePath(SmoothedPathTable):
    """A recorded drive.

    Jumps are removed, a standstill becomes one point, and the drive starts with its first movement.
    A step longer than 5 m and than four times the usual step is a hole: a gap in the recording,
    bridged by a smooth curve. `convoy check` lists removed points and holes.

    file         CSV (x_m, y_m or latitude_deg, longitude_deg; optional t_s, speed_mps), GPX,
                 NMEA 0183 (GGA, RMC), or run.mcap; relative to the scenario, or a shipped drive
    vehicle      vehicle of a run.mcap; without it the lead
    smoothing_m  half width of the smoothing window; if omitted, more where the noise requires it
    closed       whether the drive ends where it begins
    laps         laps of a closed drive
    """

    kind: Literal["trace"]
    file: Annotated[str, StringConstraints(min_length=1)]
    vehicle: str | None = None


Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Widths = Annotated[tuple[Annotated[float, Field(gt=0, le=500)], ...], Field(strict=False)]
Counts = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(strict=False)]
Texts = Annotated[tuple[str, ...], Field(strict=False)]


class PointsPath(SmoothedPathTable):
    """Points in the plane; a trace is converted into them, so that a log needs no other file.

    The program writes `narrower_m` and the keys from `source` to `skipped_first`; do not set them.

    east_m           coordinates
    north_m          coordinates
    time_s           times, one per point, or none
    speed_mps        speeds, one per point, or none
    smoothing_m      half width of the smoothing window
    narrower_m       half widths tried in this order where a car cannot drive smoothing_m
    closed           whether the path ends where it begins
    laps             laps of a closed path
    source           file that the points are from
    geodetic         whether the source has latitudes
    east_offset_m    added to the points to get the coordinates of the source
    north_offset_m   likewise
    clock            clock of absolute times: Unix time, or seconds since midnight
    epoch_s          time on that clock of time_s = 0
    source_unit      unit of source_numbers: line, point or message
    source_numbers   place of each point in the source
    noise_m          smallest noise of the points (standard deviation per axis)
    jumping_points   number of points removed as outliers
    standing_points  number of points removed at standstills
    remarks          changes made while reading the source
    skipped_lines    number of invalid lines in the source
    skipped_first    the first of them
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
    narrower_m: Widths = ()
    east_m: Numbers
    north_m: Numbers
    time_s: Numbers = ()
    speed_mps: Numbers = ()


PathTable = Annotated[SegmentsPath | TracePath | PointsPath, Field(discriminator="kind")]
