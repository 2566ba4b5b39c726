"""One table of all vehicles, and one of all links: each row is an observation."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.results.recorded.data_table import Array, DataTable
from transport.columns import Columns

TRUE_COLUMNS = {
    "east_m": "east_m",
    "north_m": "north_m",
    "yaw_rad": "yaw_rad",
    "speed_mps": "speed_mps",
    "error_m": "true_error_m",
    "station_m": "station_m",
    "gap_m": "true_gap_m",
}
"""Columns of the table of vehicles from true poses, by their names there."""
OWN_COLUMNS = (
    "lateral_error_m",
    "heading_error_rad",
    "estimated_gap_m",
    "measured_gap_m",
    "mode",
)
"""Columns from the vehicle's decisions: what it estimates and does."""


def vehicle_rows(
    name: str, truth: DataTable | None, tracking: Columns | None
) -> Mapping[str, Array]:
    """Columns of one vehicle: a row for each instant of a true pose or of a decision."""
    instants = [table.at_ns for table in (truth, tracking) if table is not None]
    at_ns: NDArray[np.int64] = np.unique(np.concatenate([np.zeros(0, np.int64), *instants]))
    columns: dict[str, Array] = {"at_ns": at_ns, "vehicle": np.full(len(at_ns), name, object)}
    for source, column in TRUE_COLUMNS.items():
        columns[column] = _at(at_ns, truth, source)
    for column in OWN_COLUMNS:
        columns[column] = _at(at_ns, tracking, column)
    return columns


def _at(at_ns: NDArray[np.int64], table: DataTable | Columns | None, name: str) -> Array:
    """Values of a column at instants, unknown at others."""
    values: Array = np.zeros(0) if table is None else table[name]
    is_text = name == "mode"
    column: Array = np.full(len(at_ns), None if is_text else np.nan, object if is_text else float)
    if table is not None:
        column[np.searchsorted(at_ns, table.at_ns)] = values
    return column


def joined(tables: Sequence[Mapping[str, Any]]) -> dict[str, Array]:
    """Join tables of the same columns, one below the other."""
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
