"""True errors and gaps of a recorded run, a value for each true pose."""

from collections.abc import Mapping
from heapq import merge
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
    poses = {name: columns for name, columns in truth.items() if name in scenario.vehicle_names}
    errors = {
        name: PathErrors(np.full(len(columns), np.nan), np.full(len(columns), np.nan))
        for name, columns in poses.items()
    }
    rows = {name: _rows(columns) for name, columns in poses.items()}
    stream = FigureStream.of(scenario)

    def take(foot: CrossTrack) -> None:
        row = rows[foot.vehicle][foot.at_ns]
        errors[foot.vehicle].error_m[row] = foot.lateral
        errors[foot.vehicle].station_m[row] = foot.station

    stream.on_error(take)
    in_order = (messages_of(columns, TruePose) for columns in poses.values())
    for pose in merge(*in_order, key=lambda pose: pose.true_at_ns):
        stream.add_truth(pose)
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


def _rows(columns: Columns) -> dict[int, int]:
    """Row of each instant."""
    return {at: row for row, at in enumerate(columns.at_ns.tolist())}
