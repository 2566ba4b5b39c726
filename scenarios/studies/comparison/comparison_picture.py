"""The comparison of several runs as one recording of Rerun."""

from collections.abc import Callable, Sequence
from zlib import crc32

import numpy as np

from scenarios.results.encounters import BodySize
from scenarios.results.run_drawing import widest_spacing
from scenarios.results.stream import sizes_of
from scenarios.studies.comparison.run_comparison import (
    ComparedRun,
    OffsetDifference,
    PlacedVehicle,
    RunComparison,
)
from transport.picture.comparison import (
    ComparedTracks,
    DivergencePoint,
    ModeStart,
    PlottedCurve,
    VehicleTrack,
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
        from transport.picture.comparison import draw_tracks  # noqa: PLC0415 - an extra

        draw_tracks(picture.recording, tracks_of(comparison))
        if option.sink == "serve":
            wait(picture.destination)


def tracks_of(comparison: RunComparison) -> ComparedTracks:
    reference = comparison.runs[0].record.scenario
    path = reference.route.path
    differences = {(one.label, one.vehicle): one for one in comparison.differences}
    return ComparedTracks(
        vehicles=list(comparison.runs[0].vehicles),
        tracks=[
            _track(run, place, vehicle, differences.get((run.label, vehicle.name)))
            for run in comparison.runs
            for place, vehicle in enumerate(run.vehicles.values())
        ],
        path=(path.east.tolist(), path.north.tolist()),
        lane_m=reference.tables.events.lane_width_m,
        spacing_m=widest_spacing(reference),
        divergence=_divergence_point(comparison),
        text=description(comparison),
    )


def _track(
    run: ComparedRun, place: int, vehicle: PlacedVehicle, difference: OffsetDifference | None
) -> VehicleTrack:
    true, station = vehicle.true, vehicle.station_m
    curves = {
        "error": PlottedCurve(true.t_s, station, true.error_m),
        "gap": PlottedCurve(true.t_s, station, true.gap_m),
    }
    if difference is not None:
        curves["difference"] = PlottedCurve(
            difference.at_s, difference.station_m, difference.offset_m
        )
    known = run.record.known_scenario
    starts = np.array([change.at_s for change in vehicle.modes])
    stations = vehicle.station_at(np.maximum(starts, true.t_s[0])).tolist()
    return VehicleTrack(
        run=run.label,
        vehicle=vehicle.name,
        place=place,
        body=sizes_of(known)[vehicle.name] if known else BodySize.of(LINCOLN_MKZ),
        at_s=true.t_s,
        station_m=station,
        east_m=vehicle.east_m,
        north_m=vehicle.north_m,
        yaw_rad=true.yaw_rad,
        curves=curves,
        modes=[
            ModeStart(change.at_s, at_m, change.mode)
            for change, at_m in zip(vehicle.modes, stations, strict=True)
        ],
    )


def _divergence_point(comparison: RunComparison) -> DivergencePoint | None:
    first = comparison.first
    if first is None:
        return None
    run = next(run for run in comparison.runs if run.label == first.label)
    vehicle = run.vehicles[first.vehicle]
    row = int(np.abs(vehicle.true.t_s - first.at_s).argmin())
    return DivergencePoint(
        at_s=first.at_s,
        station_m=first.station_m,
        east_m=float(vehicle.east_m[row]),
        north_m=float(vehicle.north_m[row]),
    )


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
