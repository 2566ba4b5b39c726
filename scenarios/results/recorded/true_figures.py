"""True errors and gaps of a recorded run, a value for each true pose."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.events.bodies import BodySize
from scenarios.results.recorded.body_columns import Bodies, body_distances
from scenarios.results.recorded.column_messages import messages_of
from scenarios.results.stream import FigureStream
from transport.columns import Columns
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import TruePose

Floats = NDArray[np.float64]


class PathErrors(NamedTuple):
    """Foot points of one vehicle on the lead's driven path at its true poses (N), NaN if unknown.

    `error_m` is the offset to the left of that path, and `station_m` the place along it from the
    lead's first pose.
    """

    error_m: Floats
    station_m: Floats


def path_errors(scenario: Scenario, truth: Mapping[str, Columns]) -> dict[str, PathErrors]:
    """Foot points of all vehicles, from the columns of their true poses."""
    poses = [truth[name] for name in truth if name in scenario.vehicle_names]
    stream = FigureStream.of(scenario)
    feet: list[CrossTrack] = []
    stream.on_error(feet.append)
    sources = [_passed(stream, columns) for columns in poses]
    numbers = np.repeat(np.arange(len(poses)), [len(columns) for columns in poses])
    at = np.concatenate([np.zeros(0, np.int64), *(columns.at_ns for columns in poses)])
    for number in numbers[np.argsort(at, kind="stable")].tolist():
        next(sources[number])
    return {columns.vehicle: _errors_of(columns, feet) for columns in poses}


def _passed(stream: FigureStream, truth: Columns) -> Iterator[None]:
    """Pass one true pose to `stream` at each step; of followers only the place is needed."""
    if truth.vehicle not in stream.followers:
        for pose in messages_of(truth, TruePose):
            stream.add_truth(pose)
            yield
        return
    places = (truth.at_ns, truth["east_m"], truth["north_m"])
    for at, east, north in zip(*(column.tolist() for column in places), strict=True):
        stream.add_place(truth.vehicle, at, east, north)
        yield


def _errors_of(truth: Columns, feet: Sequence[CrossTrack]) -> PathErrors:
    """Arrange the foot points of a vehicle by its true poses; the last one of an instant counts."""
    own = [foot for foot in feet if foot.vehicle == truth.vehicle]
    errors = PathErrors(np.full(len(truth), np.nan), np.full(len(truth), np.nan))
    order = np.argsort(truth.at_ns, kind="stable")
    at = np.array([foot.at_ns for foot in own], np.int64)
    rows = order[np.searchsorted(truth.at_ns[order], at, side="right") - 1]
    errors.error_m[rows] = [foot.lateral for foot in own]
    errors.station_m[rows] = [foot.station for foot in own]
    return errors


def true_gaps(sizes: Mapping[str, BodySize], ahead: Columns, behind: Columns) -> Floats:
    """Distances (m) between the bodies of two vehicles at the true poses of the one `behind`.

    NaN where the one ahead has no pose at the same instant. `sizes` are the bodies by name.
    """
    gaps = np.full(len(behind), np.nan)
    _, rows_ahead, rows = np.intersect1d(ahead.at_ns, behind.at_ns, return_indices=True)
    gaps[rows] = body_distances(
        Bodies.of(ahead, rows_ahead, sizes[ahead.vehicle]),
        Bodies.of(behind, rows, sizes[behind.vehicle]),
    )
    return gaps
