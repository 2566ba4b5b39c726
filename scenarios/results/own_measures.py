"""Events and metrics of the user's classes, from the true poses of each vehicle."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.definition.schema.plug_ins.points import EventDetector, RunFigure
from scenarios.definition.schema.plug_ins.table import PlugInTable
from scenarios.results.events import QUIET_NS, Event, place_at, seconds_between, spans
from scenarios.results.tables import RunTables, once
from transport.columns import Columns
from vehicles.messages import TruePose


def true_poses(columns: Columns) -> Iterator[TruePose]:
    """Yield the true poses of a table."""
    names = list(columns.fields)
    for values in zip(*(columns[name].tolist() for name in names), strict=True):
        yield TruePose(vehicle=columns.vehicle, **dict(zip(names, values, strict=True)))


@dataclass(slots=True)
class OwnMeasures:
    """Results of the user's classes; a class that fails is left out, with a line in `faults`.

    `figures` are values by vehicle and class. A class that measures does not end a run.
    """

    figures: dict[str, dict[str, float | None]] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


Measure = TypeVar("Measure")


@once
def own_measures(run: RunTables) -> OwnMeasures:
    """Measure with all classes of the scenario; nothing if they are not here."""
    found = OwnMeasures()
    tables = run.scenario.tables
    if not tables.event and not tables.figure:
        return found
    for name in run.names:
        truth = run.table(name, "truth")
        try:
            figures: Mapping[str, RunFigure] = _built(tables.figure)
            detectors: Mapping[str, EventDetector] = _built(tables.event)
        except PlugInError:  # of a recorded run
            return OwnMeasures()
        poses = list(true_poses(truth))
        found.figures[name] = {}
        for word, figure in figures.items():
            try:
                found.figures[name][word] = _value(figure, poses)
            except PlugInError as error:
                found.faults.append(f"{name}: {error}; left out")
        for word, detector in detectors.items():
            try:
                found.events += _detected(truth, word, [detector.holds(pose) for pose in poses])
            except PlugInError as error:
                found.faults.append(f"{name}: {error}; left out")
    return found


def _built(tables: Sequence[PlugInTable]) -> dict[str, Measure]:
    return {table.class_name: table.build() for table in tables}


def _value(figure: RunFigure, poses: Sequence[TruePose]) -> float | None:
    for pose in poses:
        figure.add(pose)
    return figure.value()


def _detected(truth: Columns, name: str, holds: Sequence[bool]) -> Iterator[Event]:
    at = truth.at_ns
    for first, last in spans(at, np.array(holds, bool), QUIET_NS):
        figures = {"duration_s": seconds_between(at, first, last)}
        place = place_at(truth, int(at[first]))
        yield Event("own", (truth.vehicle,), int(at[first]), figures, place, name)


def own_events(run: RunTables) -> Sequence[Event]:
    return own_measures(run).events
