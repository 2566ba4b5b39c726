"""Tables of the path: segments, a recorded trace, or points."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StringConstraints

from scenarios.definition.schema.settings_table import Table


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


VehicleName = Annotated[
    str | None, BeforeValidator(lambda name: str(name) if isinstance(name, int | float) else name)
]
"""Name of a vehicle of a file, which may be a number."""

Bound = Annotated[float | None, Field(ge=0, le=1e9)]


class TracePath(SmoothedPathTable):
    """A recorded drive.

    Jumps are removed, a standstill becomes one point, and the drive starts with its first movement.
    A step longer than 5 m and than four times the usual step is a hole: a gap in the recording,
    bridged by a smooth curve. `convoy check` lists removed points and holes.

    file         CSV, GPX, KML, GeoJSON, NMEA 0183, RTKLIB .pos, SUMO FCD, or MCAP with positions or
                 of a run; relative to the scenario, or a shipped drive
    vehicle      vehicle of a file with several; of a run.mcap the lead by default
    topic        topic of the positions in another MCAP file, where it has several
    from_s       start of the part that is driven, since the first point of the drive
    to_s         end of that part
    from_m       the same start as a distance along the points
    to_m         the same end
    pauses       "keep": the lead waits where the recorded car stood or the recording paused;
                 "cut": it drives on
    smoothing_m  half width of the smoothing window; if omitted, more where noise and speed require
                 it
    closed       whether the drive ends where it begins
    laps         laps of a closed drive
    """

    kind: Literal["trace"]
    file: Annotated[str, StringConstraints(min_length=1)]
    vehicle: VehicleName = None
    topic: str | None = None
    from_s: Bound = None
    to_s: Bound = None
    from_m: Bound = None
    to_m: Bound = None
    pauses: Literal["keep", "cut"] = "keep"


Numbers = Annotated[tuple[float, ...], Field(strict=False)]
Widths = Annotated[tuple[Annotated[float, Field(gt=0, le=500)], ...], Field(strict=False)]
Counts = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(strict=False)]
Texts = Annotated[tuple[str, ...], Field(strict=False)]


class PointsPath(SmoothedPathTable):
    """Points in the plane; a trace is converted into them, so that a log needs no other file.

    The program writes `narrower_m` and the keys from `source` to `left_out`; do not set them.

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
    begin_s          time of the first point since the start of the recorded drive
    begin_m          distance of the first point from there, along the recorded points
    pause_points     number, from 0, of the point before each pause
    pause_lasts_s    recorded duration of each pause
    pause_lost_s     the part of it that is more than its distance takes
    pauses           "cut" if time_s is without the lost times
    noise_m          smallest noise of the points (standard deviation per axis)
    jumping_points   number of points removed as outliers
    standing_points  number of points removed at standstills
    remarks          changes made while reading the source
    skipped_lines    number of records of the source left out or corrected, except jumps
    left_out         the first records left out or corrected, with the reason of each
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
    begin_s: float = Field(default=0.0, ge=0)
    begin_m: float = Field(default=0.0, ge=0)
    pause_points: Counts = ()
    pause_lasts_s: Numbers = ()
    pause_lost_s: Numbers = ()
    pauses: Literal["keep", "cut"] = "keep"
    noise_m: float = Field(default=0.0, ge=0)
    jumping_points: int = Field(default=0, ge=0)
    standing_points: int = Field(default=0, ge=0)
    remarks: Texts = ()
    skipped_lines: int = Field(default=0, ge=0)
    left_out: Texts = ()
    narrower_m: Widths = ()
    east_m: Numbers
    north_m: Numbers
    time_s: Numbers = ()
    speed_mps: Numbers = ()


PathTable = Annotated[SegmentsPath | TracePath | PointsPath, Field(discriminator="kind")]
