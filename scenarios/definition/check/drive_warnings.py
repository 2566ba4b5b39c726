"""Warnings of recorded drives: changes while reading, smoothing, holes, replayed vehicles."""

from collections.abc import Iterator

import numpy as np

from scenarios.definition.road.recorded_place import place_of
from scenarios.definition.road.replayed_drive import replay_warnings
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.path_tables import PointsPath, SmoothedPathTable
from scenarios.definition.traces.part import PATH_KEYS
from vehicles.geometry.smoothing import SmoothedPath

CUT_RATIO = 0.5
"""Half width of an automatic smoothing, in smallest radii, above which a warning is due."""

FAR_FROM_POINTS = 0.5
"""Distance (m) between path and recorded points above which a warning is due."""

MOST_HOLES = 5
"""Number of holes in a drive with their own warning."""

MOST_PAUSES = 5
"""The same for pauses."""

USUAL_SMOOTHING = SmoothedPathTable().smoothing_m
"""Half width (m) of the smoothing unless the noise of the points requires more."""


def drive_warnings(scenario: Scenario) -> Iterator[str]:
    """Warn of what is left out, assumed or inaccurate in the recorded drives of a scenario."""
    yield from _path_warnings(scenario)
    tables = scenario.tables
    for name, drive in scenario.replays.items():
        if (table := tables.vehicle[name].drive) is not None:
            yield from recording_warnings(table, drive.road, f"vehicle.{name}.replay_")
            yield from _width_warnings(table, drive.road, f"vehicle.{name}.replay_")
        yield from replay_warnings(tables, name, drive, scenario.route, scenario.duration_s)


def _path_warnings(scenario: Scenario) -> Iterator[str]:
    table, smoothed = scenario.tables.path, scenario.route.smoothed
    if not isinstance(table, PointsPath) or smoothed is None:
        return
    yield from recording_warnings(table, smoothed)
    yield from _width_warnings(table, smoothed, PATH_KEYS)
    if smoothed.deviation_max > FAR_FROM_POINTS:
        yield (
            f"the path lies up to {smoothed.deviation_max:.1f} m from the recorded points "
            f"(rms {smoothed.deviation_rms:.2f} m, noise of the points {smoothed.noise:.2f} m): "
            f"curves are cut. Lower path.smoothing_m = {smoothed.half_width:g}, unless the points "
            "are noisy."
        )


def recording_warnings(
    table: PointsPath, smoothed: SmoothedPath, keys: str = PATH_KEYS
) -> Iterator[str]:
    """Warn of faults of a recording, which a DriveReport lists as well."""
    yield from _left_out_warnings(table)
    yield from (f"{table.source or 'path'}: {remark}" for remark in table.remarks)
    yield from _pause_warnings(table, is_replay=keys != PATH_KEYS)
    yield from _hole_warnings(table, smoothed)


def _width_warnings(table: PointsPath, smoothed: SmoothedPath, keys: str) -> Iterator[str]:
    """Warn of an automatic half width that cuts curves, or that removes too little noise."""
    source, used, is_lead = table.source or "path", smoothed.half_width, keys == PATH_KEYS
    sharpest = float(np.max(np.abs(smoothed.path.curvature)))
    if used < table.smoothing_m:
        yield (
            f"{source}: the path is smoothed over a half width of {used:g} m, because a car cannot "
            f"drive the tight turns at the {table.smoothing_m:g} m for noise of "
            f"{smoothed.noise:.2g} m: the {'lead' if is_lead else 'vehicle'} steers after noise, "
            f"the smallest radius is {1.0 / sharpest:.1f} m. "
            f"{'Set path.smoothing_m, or leave' if is_lead else 'Leave'} the turns out with "
            f"{keys}from_s and {keys}to_s."
        )
    elif table.narrower_m and used > USUAL_SMOOTHING and used * sharpest > CUT_RATIO:
        yield (
            f"{source}: the points scatter by {table.noise_m:.2g} m, so the half width of the "
            f"smoothing is {used:g} m instead of {USUAL_SMOOTHING:g}: bends with a smaller radius "
            "are cut" + (". Set path.smoothing_m to change it" if is_lead else "")
        )


def _left_out_warnings(table: PointsPath) -> Iterator[str]:
    if count := table.skipped_lines + table.jumping_points:
        records = "1 record is" if count == 1 else f"{count} records are"
        yield f"{table.source}: {records} left out or corrected: {'; '.join(table.left_out)}"


def _pause_warnings(table: PointsPath, *, is_replay: bool) -> Iterator[str]:
    """Report pauses with place, duration, and the key that keeps or cuts them."""
    source = table.source or "path"
    if is_replay:
        result = "the vehicle waits there"
    elif table.pauses == "cut":
        result = 'the time is left out, path.pauses = "keep" waits there'
    else:
        result = 'the lead waits there, path.pauses = "cut" leaves the time out'
    rows = list(zip(table.pause_points, table.pause_lasts_s, strict=True))
    for point, lasts in rows[:MOST_PAUSES]:
        place = place_of(table, point)
        yield f"{source}: a pause of {lasts:.1f} s after {place}: {result}"
    if len(rows) > MOST_PAUSES:
        rest = sum(lasts for _, lasts in rows[MOST_PAUSES:])
        yield f"{source}: {len(rows) - MOST_PAUSES} more pauses, {rest:.0f} s in total"


def _hole_warnings(table: PointsPath, smoothed: SmoothedPath) -> Iterator[str]:
    for hole in smoothed.holes[:MOST_HOLES]:
        yield (
            f"{table.source or 'path'}: a hole of {hole.length:.1f} m after "
            f"{place_of(table, hole.point)} is bridged by a smooth curve: the road there is a guess"
        )
    if len(smoothed.holes) > MOST_HOLES:
        rest = smoothed.holes[MOST_HOLES:]
        longest = max(hole.length for hole in rest)
        yield f"{table.source or 'path'}: {len(rest)} more holes, up to {longest:.1f} m long"
