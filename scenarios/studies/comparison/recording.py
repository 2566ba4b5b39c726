"""The comparison of several runs as one recording of Rerun."""

from collections.abc import Callable
from zlib import crc32

import numpy as np

from scenarios.results.encounters import BodySize
from scenarios.results.run_drawing import widest_spacing
from scenarios.results.stream import sizes_of
from scenarios.studies.comparison.road import OffsetDifference, PlacedVehicle
from scenarios.studies.comparison.runs import RunComparison, RunGroup
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
    """Draw the first runs of the groups into one recording; raises ViewerError.

    A served picture is shown until `wait`, called with its address, returns.
    """
    paths = " ".join(str(group.record.log.resolve()) for group in comparison.groups)
    title = " · ".join(group.title for group in comparison.groups)
    identifier = f"compare-{crc32(paths.encode()):08x}"
    with OpenRecording(option, identifier, title) as picture:
        from transport.picture.comparison import draw_tracks  # noqa: PLC0415 - an extra

        draw_tracks(picture.recording, tracks_of(comparison))
        if option.sink == "serve":
            wait(picture.destination)


def tracks_of(comparison: RunComparison) -> ComparedTracks:
    reference = comparison.groups[0].record.scenario
    path = reference.route.path
    differences = {(one.label, one.vehicle): one for one in comparison.positions}
    runs = [f"- {group.title}" for group in comparison.groups]
    hint = "Choose the timeline `path_m` to see all values over the distance along the path."
    return ComparedTracks(
        vehicles=list(comparison.groups[0].vehicles),
        tracks=[
            _track(group, place, vehicle, differences.get((group.label, vehicle.name)))
            for group in comparison.groups
            for place, vehicle in enumerate(group.vehicles.values())
        ],
        path=(path.east.tolist(), path.north.tolist()),
        lane_m=reference.tables.events.lane_width_m,
        spacing_m=widest_spacing(reference),
        divergence=_divergence_point(comparison),
        text="\n".join([*runs, "", comparison.sentence, "", hint]),
    )


def _track(
    group: RunGroup, place: int, vehicle: PlacedVehicle, difference: OffsetDifference | None
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
    known = group.record.known_scenario
    starts = np.array([change.at_s for change in vehicle.modes])
    stations = vehicle.station_at(np.maximum(starts, true.t_s[0])).tolist()
    return VehicleTrack(
        run=group.label,
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
    if first is None or (row := first.parts) is None:
        return None
    group = next(group for group in comparison.groups if group.label == first.label)
    vehicle = group.vehicles[first.vehicle]
    pose = int(np.abs(vehicle.true.t_s - first.at_s[row]).argmin())
    return DivergencePoint(
        vehicle=first.vehicle,
        at_s=float(first.at_s[row]),
        station_m=float(first.station_m[row]),
        east_m=float(vehicle.east_m[pose]),
        north_m=float(vehicle.north_m[pose]),
        text=first.sentence,
    )
