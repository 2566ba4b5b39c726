"""String stability metrics: gains of the errors from vehicle to vehicle, and from head to tail.

Three signals: the lateral error of each follower at equal arc length along the lead's path, the
spacing error of each follower over time, and the acceleration of each vehicle over time. Norms are
over the same places and times for all vehicles, so that ratios of root mean squares are ratios of
L2 norms, and ratios of largest magnitudes are ratios of L-infinity norms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, make_dataclass
from math import sqrt
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from scenarios.results.tables import RunTables, Signal, common, once
from scenarios.results.true_motion import path_feet
from transport.columns import Floats
from vehicles.schedule import SECOND

CELL_M = 2.0
"""Length of the parts of the path over which lateral errors are averaged; a step at 50 Hz and
100 m/s."""
LEAST_COUNT = 20
"""Parts of the path (40 m) or instants (0.4 s at 50 Hz) below which a norm is not known."""
LONGEST_STEP_NS = SECOND // 10
"""Longest time between two instants from which an acceleration is computed."""
LEAST_ERROR_M = 1e-3
"""Error below which there is no excitation, whatever the accuracy of the receivers."""
SIGMAS = 3.0
"""Largest error, in standard deviations, up to which noise alone explains it."""
LEAST_ACCELERATION_MPS2 = 0.1
"""Root mean square below which an acceleration is no excitation: noise and bends reach 0.06."""


class StringSignal(NamedTuple):
    """A signal along the string, and its metrics by their names.

    name      first part of the names of its fields
    quantity  what the signal is, in words
    unit      end of the names of its norms
    head      what gains from the head of the string refer to: the first follower, or the lead
    """

    name: str
    quantity: str
    unit: str
    head: Literal["first", "lead"]

    def rms(self, figures: "StringFigures") -> float | None:
        value: float | None = getattr(figures, f"{self.name}_{self.unit}_rms")
        return value

    def gains(self, figures: "StringFigures", reach: str = "") -> tuple[float | None, float | None]:
        """L2 and L∞ gain from the vehicle ahead, or with `reach` from the head of the string."""
        name = f"{self.name}_gain"
        return getattr(figures, f"{name}_l2{reach}"), getattr(figures, f"{name}_linf{reach}")

    def gains_from_head(self, figures: "StringFigures") -> tuple[float | None, float | None]:
        return self.gains(figures, f"_from_{self.head}")

    def docs(self) -> dict[str, str]:
        """Document each field by its name."""
        head = "lead" if self.head == "lead" else "first follower"
        from_head = f"gain of the {self.quantity} from the {head}"
        return {
            f"{self.name}_{self.unit}_rms": f"Root mean square of the true {self.quantity}.",
            f"{self.name}_{self.unit}_max": f"Largest magnitude of the true {self.quantity}.",
            f"{self.name}_gain_l2": f"L2 gain of the {self.quantity} from the vehicle ahead.",
            f"{self.name}_gain_linf": f"L∞ gain of the {self.quantity} from the vehicle ahead.",
            f"{self.name}_gain_l2_from_{self.head}": f"L2 {from_head}; of the last vehicle: head "
            "to tail.",
            f"{self.name}_gain_linf_from_{self.head}": f"L∞ {from_head}.",
            f"{self.name}_growth_l2": f"Mean gain per vehicle: {self.name}_gain_l2_from_{self.head}"
            " to the power of 1 / vehicles between.",
        }


LATERAL = StringSignal("lateral", "lateral error", "error_m", "first")
SPACING = StringSignal("spacing", "spacing error", "error_m", "first")
ACCELERATION = StringSignal("acceleration", "longitudinal acceleration", "mps2", "lead")
STRING_SIGNALS = (LATERAL, SPACING, ACCELERATION)
STRING_DOCS = {name: text for signal in STRING_SIGNALS for name, text in signal.docs().items()}
"""Documentation of the fields of StringFigures."""

if TYPE_CHECKING:

    class StringFigures:
        """Errors of one vehicle along the string, and their gains; None if not defined."""

        def __init__(self, **values: float | None) -> None: ...
        def __getattr__(self, name: str) -> float | None: ...

else:
    StringFigures = make_dataclass(
        "StringFigures",
        [(name, float | None, field(default=None)) for name in STRING_DOCS],
        frozen=True,
        slots=True,
        kw_only=True,
    )
    StringFigures.__module__ = __name__
    StringFigures.__doc__ = """Errors of one vehicle along the string, and their gains.

    All vehicles are compared over the same places (lateral error, over the path that all followers
    drove) or times (spacing error of followers that keep a gap, and acceleration). A gain of norms
    L2 or L∞ (`linf`) is the norm of the vehicle over that of the vehicle ahead, of the first
    follower, or of the lead. It is None if the denominator is at the level of the noise. See
    `convoy reference string-stability`.
    """

NO_STRING = StringFigures()
"""Of runs whose summary has none."""


# ---- Signals


@once
def stations(run: RunTables, name: str) -> Floats:
    """Place (m) of a vehicle along the lead's path at each true pose; NaN if unknown."""
    if name != run.lead:
        return path_feet(run, name).station
    distance = run.table(name, "truth")["distance_m"]
    return distance - distance[:1]


def spacing_errors(run: RunTables, follower: str) -> Signal:
    """Spacing errors (m) of a follower that keeps a gap: positive if the gap is too wide.

    The spacing is arc length to the predecessor along the lead's path, minus standstill spacing and
    headway times own speed.
    """
    ahead, truth = run.ahead(follower), run.table(follower, "truth")
    at, (rows, own) = common(run.table(ahead, "truth").at_ns, truth.at_ns)
    policy = run.scenario.spacing_policy(run.names.index(follower))
    desired = policy.standstill + policy.headway * truth["speed_mps"][own]
    return Signal(at, stations(run, ahead)[rows] - stations(run, follower)[own] - desired).known


# ---- Norms over the support that all vehicles have in common


class Norms(NamedTuple):
    """Root mean squares and largest magnitudes of a signal, one of each vehicle of the chain."""

    rms: Sequence[float]
    largest: Sequence[float]


def _norms(mean_squares: Floats, largest: Floats) -> Norms | None:
    """Norms of a signal over its support; shapes (vehicles, N), None if the support is short."""
    if mean_squares.shape[1] < LEAST_COUNT:
        return None
    return Norms(np.sqrt(mean_squares.mean(axis=1)).tolist(), largest.max(axis=1).tolist())


def _norms_over_time(values: Floats) -> Norms | None:
    return _norms(values * values, np.abs(values))


def _acceleration_norms(run: RunTables) -> Norms | None:
    """Norms of the accelerations between instants at which all vehicles and feet are known."""
    speeds = [
        Signal(truth.at_ns[rows], truth["speed_mps"][rows])
        for name in run.names
        for truth, rows in [(run.table(name, "truth"), ~np.isnan(stations(run, name)))]
    ]
    at, rows = common(*[speed.at_ns for speed in speeds])
    values = np.array([speed.values[own] for speed, own in zip(speeds, rows, strict=True)])
    step = np.diff(at)
    near = step <= LONGEST_STEP_NS
    return _norms_over_time(np.diff(values)[:, near] * SECOND / step[near])


def _spacing_norms(run: RunTables) -> Norms | None:
    if run.scenario.tables.speed.followers != "gap" or not run.followers:
        return None
    errors = [spacing_errors(run, name) for name in run.followers]
    _, rows = common(*[error.at_ns for error in errors])
    return _norms_over_time(
        np.array([error.values[own] for error, own in zip(errors, rows, strict=True)])
    )


def _lateral_norms(run: RunTables) -> Norms | None:
    """Norms of the lateral errors over the parts of the path that all followers have passed."""
    cells, errors = [], []
    for name in run.followers:
        station, lateral = path_feet(run, name)
        known = station >= 0.0
        cells.append((station[known] // CELL_M).astype(int))
        errors.append(lateral[known])
    if not cells or not all(map(len, cells)):
        return None
    end = min(int(cell.max()) for cell in cells)
    squares, largest, counts = (np.zeros((len(cells), end)) for _ in range(3))
    for row, (cell, error) in enumerate(zip(cells, errors, strict=True)):
        passed = cell < end
        np.add.at(squares[row], cell[passed], error[passed] ** 2)
        np.add.at(counts[row], cell[passed], 1.0)
        np.maximum.at(largest[row], cell[passed], np.abs(error[passed]))
    common_cells = (counts > 0.0).all(axis=0)
    means = squares[:, common_cells] / counts[:, common_cells]
    return _norms(means, largest[:, common_cells])


# ---- Gains


def string_figures(run: RunTables, deviations_m: Mapping[str, float]) -> dict[str, StringFigures]:
    """Compute the metrics of all vehicles.

    `deviations_m` are standard deviations (m) of the vehicles' positions. Noise alone explains
    lateral errors with a root mean square of one and a largest value of three of them, and √2 times
    as much in the spacing, which has two positions.
    """
    noise = [max(deviations_m[name], LEAST_ERROR_M) for name in run.followers]
    least = [LEAST_ACCELERATION_MPS2] * len(run.names)
    values: dict[str, dict[str, Any]] = {name: {} for name in run.names}
    for signal, norms, floor, names in (
        (LATERAL, _lateral_norms(run), noise, run.followers),
        (SPACING, _spacing_norms(run), [sqrt(2.0) * one for one in noise], run.followers),
        (ACCELERATION, _acceleration_norms(run), least, run.names),
    ):
        if norms is not None:
            columns = _columns(norms, floor)
            for place, name in enumerate(names):
                row = [column[place] for column in columns]
                values[name] |= zip(signal.docs(), row, strict=True)
    return {name: StringFigures(**row) for name, row in values.items()}


def _columns(norms: Norms, noise: Sequence[float]) -> list[Sequence[float | None]]:
    """Metrics of a signal in the order of their fields, each with a value per vehicle."""
    ahead_l2, head_l2 = _gains(norms.rms, noise)
    ahead_linf, head_linf = _gains(norms.largest, [SIGMAS * one for one in noise])
    growth = [
        gain ** (1.0 / steps) if steps and gain is not None else None
        for steps, gain in enumerate(head_l2)
    ]
    return [norms.rms, norms.largest, ahead_l2, ahead_linf, head_l2, head_linf, growth]


def _gains(values: Sequence[float], noise: Sequence[float]) -> tuple[list[float | None], ...]:
    """Divide each value by the one before, and by the first; None if that is at the noise."""
    excited = [
        value if value >= floor else None for value, floor in zip(values, noise, strict=True)
    ]
    ahead, head = [None, *excited[:-1]], [None, *[excited[0]] * (len(values) - 1)]
    return tuple(
        [
            None if other is None else value / other
            for value, other in zip(values, others, strict=True)
        ]
        for others in (ahead, head)
    )
