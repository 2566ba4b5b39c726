"""The comparison of several runs as one recording of Rerun, an extra."""

from collections.abc import Callable
from dataclasses import replace
from itertools import zip_longest
from zlib import crc32

import numpy as np

from scenarios.results.review import batches, scene_of
from scenarios.studies.comparison.runs import RunComparison, RunGroup
from transport.columns import Columns
from transport.log.reader import LogReader
from transport.picture.batch import Batch, Mark, RunScene, VehicleValues
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from transport.picture.viewer_process import ViewerError
from transport.topics import TOPICS
from vehicles.schedule import nanoseconds


def show_comparison(
    comparison: RunComparison, option: RerunOption, *, wait: Callable[[str], None]
) -> None:
    """Draw the first runs of the groups into one recording; raises ViewerError.

    Their vehicles are those of one convoy with the names "v2_A", "v2_B" and so on. A served picture
    is shown until `wait`, called with its address, returns.
    """
    groups = comparison.groups
    paths = " ".join(str(group.record.log.resolve()) for group in groups)
    identifier = f"compare-{crc32(paths.encode()):08x}"
    title = " · ".join(group.title for group in groups)
    view = RerunView(option, recording_id=identifier, scene=_scene(groups), title=title)
    runs = [batches(LogReader(group.record.log), group.record.scenario) for group in groups]
    start = 0
    with view:
        for parts in zip_longest(*runs):
            for group, part in zip(groups, parts, strict=True):
                if part is not None:
                    start = start or part[0].start_ns
                    view.draw(_renamed(part[0], group.label, start))
        view.draw(Batch(start_ns=start, tables={}, marks=_divergence(comparison, start)))
        view.finish()
        if option.sink == "serve":
            wait(view.destination)


def _scene(groups: tuple[RunGroup, ...]) -> RunScene:
    """The road of the first run with the vehicles of all runs, side by side."""
    first = groups[0].record.scenario
    for group in groups:
        if group.record.scenario.origin != first.origin:
            raise ViewerError(
                f"{group.record.log}: has another origin than {groups[0].record.log}, so that both "
                "cannot be drawn in one picture; show them one by one with `convoy review`"
            )
    names = dict.fromkeys(name for group in groups for name in group.record.scenario.vehicle_names)
    vehicles = [
        f"{name}_{group.label}"
        for name in names
        for group in groups
        if name in group.record.scenario.vehicle_names
    ]
    scene = scene_of(first, vehicles)
    return replace(
        scene,
        convoy=vehicles,
        spacing_m=scene.spacing_m / len(groups),
        cars={
            f"{name}_{group.label}": car
            for group in groups
            for name, car in scene_of(group.record.scenario, vehicles).cars.items()
        },
    )


def _renamed(batch: Batch, label: str, start: int) -> Batch:
    """The batch of run `label` as that of a run which began at `start` (ns)."""
    shift = start - batch.start_ns

    def columns_of(columns: Columns, name: str) -> Columns:
        instant = TOPICS[columns.topic].instant
        fields = {**columns.fields, instant: columns.at_ns + shift}
        return replace(columns, vehicle=name, fields=fields)

    def values_of(values: VehicleValues) -> VehicleValues:
        return values._replace(at_ns=values.at_ns + shift)

    return Batch(
        start_ns=start,
        tables={
            (f"{name}_{label}", topic): columns_of(columns, f"{name}_{label}")
            for (name, topic), columns in batch.tables.items()
        },
        errors={f"{name}_{label}": values_of(values) for name, values in batch.errors.items()},
        gaps={f"{name}_{label}": values_of(values) for name, values in batch.gaps.items()},
        marks=[
            mark._replace(
                at_ns=mark.at_ns + shift,
                vehicles=tuple(f"{name}_{label}" for name in mark.vehicles),
            )
            for mark in batch.marks
        ],
    )


def _divergence(comparison: RunComparison, start: int) -> list[Mark]:
    """Mark where a vehicle leaves that of the first run, if one does."""
    first = comparison.first
    if first is None or (row := first.parts) is None:
        return []
    at_s = float(first.at_s[row])
    group = next(group for group in comparison.groups if group.label == first.label)
    vehicle = group.vehicles[first.vehicle]
    pose = int(np.abs(vehicle.true.t_s - at_s).argmin())
    place = float(vehicle.east_m[pose]), float(vehicle.north_m[pose])
    name = f"{first.vehicle}_{first.label}"
    return [Mark("change", start + nanoseconds(at_s), place, (name,), "first divergence")]
