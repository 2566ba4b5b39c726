"""String stability metrics: gains of the errors from vehicle to vehicle, and from head to tail.

Three signals: the lateral error of each follower at equal arc length along the lead's path, the
spacing error of each follower over time, and the acceleration of each vehicle over time. Norms are
over the same places and times for all vehicles, so that ratios of root mean squares are ratios of
L2 norms, and ratios of largest magnitudes are ratios of L-infinity norms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np

from scenarios.results.tables import RunTables, common
from scenarios.results.true_motion import path_feet
from transport.columns import Floats, Integers
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


@dataclass(frozen=True, slots=True, kw_only=True)
class StringFigures:
    """Errors of one vehicle along the string, and their gains; None where they are not defined.

    All vehicles are compared over the same places (lateral error) or times (spacing error and
    acceleration). A gain of norms L2 or L∞ (`linf`) is the norm of the vehicle over that of the
    vehicle ahead, of the first follower, or of the lead. It is None if the denominator is at the
    level of the noise. See `convoy reference string-stability`.
    """

    lateral_error_m_rms: float | None = None
    """Root mean square of the true lateral error, over the path that all followers drove."""
    lateral_error_m_max: float | None = None
    """Largest lateral error on that path."""
    lateral_gain_l2: float | None = None
    """L2 gain of the lateral error from the vehicle ahead."""
    lateral_gain_linf: float | None = None
    """L∞ gain of the lateral error from the vehicle ahead."""
    lateral_gain_l2_from_first: float | None = None
    """L2 gain of the lateral error from the first follower; of the last vehicle: head to tail."""
    lateral_gain_linf_from_first: float | None = None
    """L∞ gain of the lateral error from the first follower."""
    lateral_growth_l2: float | None = None
    """Mean gain per vehicle: lateral_gain_l2_from_first to the power of 1 / vehicles between."""
    spacing_error_m_rms: float | None = None
    """Root mean square of the true spacing error, of followers that keep a gap."""
    spacing_error_m_max: float | None = None
    """Largest spacing error."""
    spacing_gain_l2: float | None = None
    """L2 gain of the spacing error from the vehicle ahead."""
    spacing_gain_linf: float | None = None
    """L∞ gain of the spacing error from the vehicle ahead."""
    spacing_gain_l2_from_first: float | None = None
    """L2 gain of the spacing error from the first follower; of the last vehicle: head to tail."""
    spacing_gain_linf_from_first: float | None = None
    """L∞ gain of the spacing error from the first follower."""
    spacing_growth_l2: float | None = None
    """Mean gain per vehicle: spacing_gain_l2_from_first to the power of 1 / vehicles between."""
    acceleration_mps2_rms: float | None = None
    """Root mean square of the true longitudinal acceleration."""
    acceleration_mps2_max: float | None = None
    """Largest magnitude of the acceleration."""
    acceleration_gain_l2: float | None = None
    """L2 gain of the acceleration from the vehicle ahead."""
    acceleration_gain_linf: float | None = None
    """L∞ gain of the acceleration from the vehicle ahead."""
    acceleration_gain_l2_from_lead: float | None = None
    """L2 gain of the acceleration from the lead; of the last vehicle: head to tail."""
    acceleration_gain_linf_from_lead: float | None = None
    """L∞ gain of the acceleration from the lead."""
    acceleration_growth_l2: float | None = None
    """Mean gain per vehicle: acceleration_gain_l2_from_lead to the power of 1 / vehicles."""


NO_STRING = StringFigures()
"""Of runs whose summary has none."""


@dataclass(frozen=True, slots=True)
class StringSignal:
    """A signal along the string, and its figures by their names.

    name      first part of the names of its fields
    quantity  what the signal is, in words
    unit      end of the names of its norms
    head      what gains from the head of the string refer to: the first follower, or the lead
    """

    name: str
    quantity: str
    unit: str
    head: Literal["first", "lead"]

    def rms(self, figures: StringFigures) -> float | None:
        value: float | None = getattr(figures, f"{self.name}_{self.unit}_rms")
        return value

    def gains(self, figures: StringFigures) -> tuple[float | None, float | None]:
        """L2 and L∞ gain from the vehicle ahead."""
        return self._pair(figures, "")

    def gains_from_head(self, figures: StringFigures) -> tuple[float | None, float | None]:
        """L2 and L∞ gain from the head of the string."""
        return self._pair(figures, f"_from_{self.head}")

    def _pair(self, figures: StringFigures, reach: str) -> tuple[float | None, float | None]:
        name = f"{self.name}_gain"
        return getattr(figures, f"{name}_l2{reach}"), getattr(figures, f"{name}_linf{reach}")


LATERAL = StringSignal("lateral", "lateral error", "error_m", "first")
SPACING = StringSignal("spacing", "spacing error", "error_m", "first")
ACCELERATION = StringSignal("acceleration", "acceleration", "mps2", "lead")
STRING_SIGNALS = (LATERAL, SPACING, ACCELERATION)


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


class _Frames(NamedTuple):
    """Stations (m) and speeds (m/s) of all vehicles, shapes (vehicles, N), at instants (ns)."""

    at_ns: Integers
    stations: Floats
    speeds: Floats


def _frames(run: RunTables) -> _Frames:
    """Instants at which all vehicles and the feet of all followers are known."""
    truths = [run.table(name, "truth") for name in run.names]
    stations = [path_feet(run, name).station for name in run.followers]
    distance = truths[0]["distance_m"]
    stations = [distance - distance[:1], *stations]
    known = [np.flatnonzero(~np.isnan(station)) for station in stations]
    instants = [truth.at_ns[rows] for truth, rows in zip(truths, known, strict=True)]
    at, places = common(*instants)
    rows = [of[place] for of, place in zip(known, places, strict=True)]
    return _Frames(
        at,
        np.array([station[row] for station, row in zip(stations, rows, strict=True)]),
        np.array([truth["speed_mps"][row] for truth, row in zip(truths, rows, strict=True)]),
    )


def _acceleration_norms(frames: _Frames) -> Norms | None:
    step = np.diff(frames.at_ns)
    near = step <= LONGEST_STEP_NS
    return _norms_over_time(np.diff(frames.speeds)[:, near] * SECOND / step[near])


def _spacing_norms(run: RunTables, frames: _Frames) -> Norms | None:
    """Norms of the spacing errors: positive if the gap is too wide.

    The spacing is arc length to the predecessor along the lead's path, minus standstill spacing and
    headway times own speed.
    """
    if run.scenario.tables.speed.followers != "gap" or not run.followers:
        return None
    policies = [run.scenario.spacing_policy(place) for place in range(1, len(run.names))]
    standstill = np.array([[policy.standstill] for policy in policies])
    headway = np.array([[policy.headway] for policy in policies])
    desired = standstill + headway * frames.speeds[1:]
    return _norms_over_time(-np.diff(frames.stations, axis=0) - desired)


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
    frames = _frames(run)
    noise = [max(deviations_m[name], LEAST_ERROR_M) for name in run.followers]
    of_followers = _values_of(LATERAL, _lateral_norms(run), noise) | _values_of(
        SPACING, _spacing_norms(run, frames), [sqrt(2.0) * one for one in noise]
    )
    least = [LEAST_ACCELERATION_MPS2] * len(run.names)
    of_all = _values_of(ACCELERATION, _acceleration_norms(frames), least)
    figures = {}
    for place, name in enumerate(run.names):
        values = {key: column[place] for key, column in of_all.items()}
        if place:
            values |= {key: column[place - 1] for key, column in of_followers.items()}
        figures[name] = StringFigures(**values)
    return figures


Values = Sequence[float | None]


def _values_of(
    signal: StringSignal, norms: Norms | None, noise: Sequence[float]
) -> dict[str, Values]:
    """Metrics of a signal by field, each with a value per vehicle of the chain."""
    if norms is None:
        return {}
    of_rms = _gains(norms.rms, noise)
    of_largest = _gains(norms.largest, [SIGMAS * one for one in noise])
    growth = [
        gain ** (1.0 / steps) if steps and gain is not None else None
        for steps, gain in enumerate(of_rms.from_head)
    ]
    name, unit, head = signal.name, signal.unit, signal.head
    return {
        f"{name}_{unit}_rms": norms.rms,
        f"{name}_{unit}_max": norms.largest,
        f"{name}_gain_l2": of_rms.from_ahead,
        f"{name}_gain_linf": of_largest.from_ahead,
        f"{name}_gain_l2_from_{head}": of_rms.from_head,
        f"{name}_gain_linf_from_{head}": of_largest.from_head,
        f"{name}_growth_l2": growth,
    }


class SignalGains(NamedTuple):
    """Gains of each vehicle from the vehicle ahead, and from the head of the chain."""

    from_ahead: list[float | None]
    from_head: list[float | None]


def _gains(values: Sequence[float], least: Sequence[float]) -> SignalGains:
    """Divide each value by the one before and by the first, where these are at least `least`."""
    excited = [
        value if value >= floor else None for value, floor in zip(values, least, strict=True)
    ]
    ahead, head = [None, *excited[:-1]], [None, *[excited[0]] * (len(values) - 1)]
    return SignalGains(
        [
            None if other is None else value / other
            for value, other in zip(values, ahead, strict=True)
        ],
        [
            None if other is None else value / other
            for value, other in zip(values, head, strict=True)
        ],
    )
