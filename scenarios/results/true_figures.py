"""True errors and gaps of a recorded run, a value for each true pose."""

from collections.abc import Iterator, Mapping
from math import nan
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.stream import FigureStream
from transport.columns import Columns
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Message, TruePose

# ---- Messages made from columns, for figures that take messages


Kind = TypeVar("Kind", bound=Message)


def messages_of(columns: Columns, kind: type[Kind]) -> Iterator[Kind]:
    """Yield the messages of `columns`, without their lists."""
    names = list(columns.fields)
    for values in zip(*(columns[name].tolist() for name in names), strict=True):
        yield kind(vehicle=columns.vehicle, **dict(zip(names, values, strict=True)))


# ---- True figures


Floats = NDArray[np.float64]


class TrueFigures(NamedTuple):
    """Figures of one vehicle at its true poses (N), NaN if unknown.

    `error_m` is the offset to the left of the lead's driven path and the straight before it,
    `station_m` the place along it, 0 at the lead's first pose, and `gap_m` the distance between the
    bodies of the vehicle and of the one ahead. The figures of the summary begin at `station_m` 0.
    """

    error_m: Floats
    station_m: Floats
    gap_m: Floats

    @classmethod
    def unknown(cls, count: int) -> "TrueFigures":
        none = np.full(count, np.nan)
        return cls(none, none, none)


def true_figures(scenario: Scenario, truth: Mapping[str, Columns]) -> dict[str, TrueFigures]:
    """Figures of all vehicles, from the columns of their true poses."""
    poses = [truth[name] for name in truth if name in scenario.vehicle_names]
    stream = FigureStream.of(scenario)
    feet: dict[tuple[str, int], CrossTrack] = {}
    gaps: dict[tuple[str, int], float] = {}
    stream.on_foot(lambda foot: feet.update({(foot.vehicle, foot.at_ns): foot}))
    stream.on_gap(lambda gap: gaps.update({(gap.vehicle, gap.now_at_ns): gap.now_m}))
    messages = [message for columns in poses for message in messages_of(columns, TruePose)]
    for pose in sorted(messages, key=lambda pose: pose.true_at_ns):
        stream.add_truth(pose)
    figures = {}
    for columns in poses:
        keys = [(columns.vehicle, at) for at in columns.at_ns.tolist()]
        figures[columns.vehicle] = TrueFigures(
            np.array([feet[key].lateral if key in feet else nan for key in keys]),
            np.array([feet[key].station if key in feet else nan for key in keys]),
            np.array([gaps.get(key, nan) for key in keys]),
        )
    return figures
