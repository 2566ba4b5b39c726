"""The comparison of several runs as one recording of Rerun."""

from collections.abc import Callable, Sequence
from zlib import crc32

import numpy as np

from scenarios.results.run_drawing import scene_of
from scenarios.results.true_motion import BodySize, sizes_of
from scenarios.studies.comparison.run_comparison import (
    ComparedRun,
    OffsetDifference,
    PlacedVehicle,
    RunComparison,
)
from transport.picture.option import RerunOption
from transport.picture.view import OpenRecording
from vehicles.car.parameters import LINCOLN_MKZ


def show_comparison(
    comparison: RunComparison, option: RerunOption, *, wait: Callable[[str], None]
) -> None:
    """Draw the runs into one recording; raises ViewerError.

    A served picture is shown until `wait`, called with its address, returns.
    """
    paths = " ".join(str(run.record.log.resolve()) for run in comparison.runs)
    title = " · ".join(run.title for run in comparison.runs)
    identifier = f"compare-{crc32(paths.encode()):08x}"
    with OpenRecording(option, identifier, title) as picture:
        if not picture.enabled:
            return
        _draw(comparison, picture)
        if option.sink == "serve":
            wait(picture.destination)


def _draw(comparison: RunComparison, picture: OpenRecording) -> None:
    from transport.picture.comparison import Placed, VehicleTrack, draw_tracks  # noqa: PLC0415

    differences = {(one.label, one.vehicle): one for one in comparison.differences}

    def track(run: ComparedRun, place: int, vehicle: PlacedVehicle) -> VehicleTrack:
        true, station = vehicle.true, vehicle.station_m
        curves = {
            "error": Placed(true.t_s, station, true.error_m),
            "gap": Placed(true.t_s, station, true.gap_m),
        }
        difference: OffsetDifference | None = differences.get((run.label, vehicle.name))
        if difference is not None:
            curves["difference"] = Placed(
                difference.at_s, difference.station_m, difference.offset_m
            )
        known = run.record.known_scenario
        starts = np.array([change.at_s for change in vehicle.modes])
        places = vehicle.station_at(np.maximum(starts, true.t_s[0]))
        modes = np.array([change.mode for change in vehicle.modes], object)
        poses = np.column_stack((vehicle.east_m, vehicle.north_m, true.yaw_rad))
        return VehicleTrack(
            run=run.label,
            vehicle=vehicle.name,
            place=place,
            body=sizes_of(known)[vehicle.name] if known else BodySize.of(LINCOLN_MKZ),
            poses=Placed(true.t_s, station, poses),
            curves=curves,
            modes=Placed(starts, places, modes),
        )

    tracks = [
        track(run, place, vehicle)
        for run in comparison.runs
        for place, vehicle in enumerate(run.vehicles.values())
    ]
    first = comparison.first
    divergence = None
    if first is not None:
        of_first = next(run for run in comparison.runs if run.label == first.label)
        vehicle = of_first.vehicles[first.vehicle]
        row = [int(np.abs(vehicle.true.t_s - first.at_s).argmin())]
        place = np.column_stack((vehicle.east_m, vehicle.north_m))[row]
        divergence = Placed(np.array([first.at_s]), np.array([first.station_m]), place)
    reference = comparison.runs[0]
    scene = scene_of(reference.record.scenario, list(reference.vehicles))
    draw_tracks(picture.recording, scene, tracks, divergence, description(comparison))


def description(comparison: RunComparison) -> str:
    """Runs, first divergence, and errors along the string, in Markdown."""
    lines = [f"- {run.title}" for run in comparison.runs]
    first = comparison.first
    lines += ["", first.sentence if first else f"No vehicle differs by {comparison.tolerance_m} m."]
    lines += [
        "",
        "Choose the timeline `path_m` to see all values over the distance along the path.",
    ]
    lines += ["", *_string_table(comparison.runs)]
    return "\n".join(lines)


def _string_table(runs: Sequence[ComparedRun]) -> list[str]:
    known = [(run.label, run.string_errors) for run in runs if run.string_errors]
    if not known:
        return []
    rows = ["| error, largest / rms, cm | " + " | ".join(label for label, _ in known) + " |"]
    rows.append("|---" * (len(known) + 1) + "|")
    for place, first in enumerate(known[0][1]):
        cells = []
        for _, errors in known:
            one = errors[place] if place < len(errors) else None
            if one is None or one.error_m_max is None or one.error_m_rms is None:
                cells.append("-")
            else:
                cells.append(f"{100 * one.error_m_max:.1f} / {100 * one.error_m_rms:.1f}")
        rows.append(f"| {first.vehicle} | " + " | ".join(cells) + " |")
    return rows
