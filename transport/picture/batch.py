"""What a picture receives: the scene once, then tables and metrics batch by batch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from transport.columns import Columns, Integers
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]
Road = tuple[Sequence[float], Sequence[float]]  # East and north of the lead's path, m
BATCH_NS = SECOND // 2
"""Batches begin and end at multiples of this run time, except for the last end."""
DRAWN_TOPICS = ("truth", "trajectory", "tracking", "command", "verdict", "log", "change")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunScene:
    """What is known of a run before its messages.

    `vehicles` are in order, the lead first, and may be some of the `convoy`;
    `spacing_m` is their usual spacing; `cars` are their lengths and widths (m), and the distances
    of their middles ahead of their poses; `path` is the lead's, `lane_m` the width of its lane.
    """

    vehicles: Sequence[str]
    convoy: Sequence[str]
    spacing_m: float
    cars: Mapping[str, tuple[float, float, float]]
    path: Road
    lane_m: float
    duration_s: float


class VehicleValues(NamedTuple):
    """Values (N) of a metric of a vehicle at instants (ns) in order."""

    at_ns: Integers
    values: Floats


class Mark(NamedTuple):
    """An event or change at instant `at_ns` and place (east, north) in metres."""

    kind: str
    at_ns: int
    place: tuple[float, float]
    vehicles: tuple[str, ...]
    text: str = ""

    @property
    def label(self) -> str:
        title = self.text or self.kind.replace("_", " ")
        return f"{title} {' '.join(reversed(self.vehicles))}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """Consecutive messages of a run that began at `start_ns`, by (vehicle, topic).

    `errors` are the true cross-track errors (m) and `gaps` the true gaps (m) of the followers,
    `marks` the events that have become known. The picture draws nothing else.
    """

    start_ns: int
    tables: Mapping[tuple[str, str], Columns]
    errors: Mapping[str, VehicleValues] = field(default_factory=dict)
    gaps: Mapping[str, VehicleValues] = field(default_factory=dict)
    marks: Sequence[Mark] = ()

    def of_topic(self, topic: str) -> list[Columns]:
        """Tables of a topic that have rows."""
        return [one for (_, name), one in self.tables.items() if name == topic and len(one)]
