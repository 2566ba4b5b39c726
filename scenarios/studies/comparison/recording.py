"""The comparison of several runs as one recording of Rerun, an extra."""

from collections.abc import Callable
from zlib import crc32

import numpy as np

from scenarios.results.run_drawing import scene_of
from scenarios.results.true_motion import BodySize, sizes_of
from scenarios.studies.comparison.road import OffsetDifference, PlacedVehicle
from scenarios.studies.comparison.runs import RunComparison, RunGroup
from transport.picture.comparison import Placed, VehicleTrack, draw_tracks
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
        _draw(comparison, picture)
        if option.sink == "serve":
            wait(picture.destination)


def _draw(comparison: RunComparison, picture: OpenRecording) -> None:
    first = comparison.groups[0]
    scene = scene_of(first.record.scenario, list(first.vehicles))
    differences = {(one.label, one.vehicle): one for one in comparison.positions}
    tracks = [
        _track(group, place, vehicle, differences.get((group.label, vehicle.name)))
        for group in comparison.groups
        for place, vehicle in enumerate(group.vehicles.values())
    ]
    hint = "Choose the timeline `path_m` to see all values over the distance along the path."
    runs = [f"- {group.title}" for group in comparison.groups]
    text = "\n".join([*runs, "", comparison.sentence, "", hint])
    draw_tracks(picture.recording, scene, tracks, _divergence(comparison), text)


def _track(
    group: RunGroup, place: int, vehicle: PlacedVehicle, difference: OffsetDifference | None
) -> VehicleTrack:
    true, station = vehicle.true, vehicle.station_m
    curves = {
        "error": Placed.known(true.t_s, station, true.error_m),
        "gap": Placed.known(true.t_s, station, true.gap_m),
    }
    if difference is not None:
        curves["difference"] = Placed.known(
            difference.at_s, difference.station_m, difference.offset_m
        )
    known = group.record.known_scenario
    starts = np.array([change.at_s for change in vehicle.modes])
    places = vehicle.station_at(np.maximum(starts, true.t_s[0]))
    modes = np.array([change.mode for change in vehicle.modes], object)
    poses = np.column_stack((vehicle.east_m, vehicle.north_m, true.yaw_rad))
    return VehicleTrack(
        run=group.label,
        vehicle=vehicle.name,
        place=place,
        body=sizes_of(known)[vehicle.name] if known else BodySize.of(LINCOLN_MKZ),
        path=poses[:, :2],
        poses=Placed.known(true.t_s, station, poses),
        curves=curves,
        modes=Placed.known(starts, places, modes),
    )


def _divergence(comparison: RunComparison) -> Placed | None:
    """Time, station and place where a vehicle of the first group parts; None if none does."""
    first = comparison.first
    if first is None or (row := first.parts) is None:
        return None
    group = next(group for group in comparison.groups if group.label == first.label)
    vehicle = group.vehicles[first.vehicle]
    pose = int(np.abs(vehicle.true.t_s - first.at_s[row]).argmin())
    place = np.column_stack((vehicle.east_m, vehicle.north_m))[[pose]]
    return Placed.known(first.at_s[[row]], first.station_m[[row]], place)
