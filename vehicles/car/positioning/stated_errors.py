"""The error model that a receiver states: what an estimator may know of its errors.

It is that of the settings, scaled by the ratio of the reported accuracy to the true one. A receiver
that reports a wrong accuracy therefore misleads its estimator.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, expm1, hypot, inf, isinf, sqrt

from vehicles.car.positioning.common_drift import CommonDrift
from vehicles.car.positioning.gnss_settings import (
    NO_DRIFT,
    STATES_WITH_FIX,
    GnssSettings,
    StateErrors,
)
from vehicles.messages import FixState
from vehicles.schedule import SECOND

LEAST_NOISE = 0.001  # Least white noise (m) of a position: receivers report millimetres


@dataclass(frozen=True, slots=True)
class LastingError:
    """An error per axis that lasts from fix to fix: a stationary Gauss–Markov process.

    Standard deviation (m), time constant (s, infinite for a constant error). It is part of the
    fixes in `states`, and restarts with the deviation `entry_deviation` (m) whenever such a state
    is entered, if given.
    """

    deviation: float
    time_constant: float
    states: frozenset[FixState]
    entry_deviation: float | None = None

    def kept(self, span: float) -> float:
        """Share of the error that is left after `span` (s): exp(-t / time constant)."""
        return exp(-span / self.time_constant)

    def growth(self, span: float) -> float:
        """Variance (m²) that is added in `span` (s); the stationary variance remains."""
        return -(self.deviation**2) * expm1(-2.0 * span / self.time_constant)


@dataclass(frozen=True, slots=True)
class StatedErrors:
    """Errors of a receiver's positions, per axis.

    `white` is the variance (m²) of the white noise by fix state, `period` (ns) that of fixes.
    `common` is shared by all receivers, so it does not change relative positions.
    """

    white: Mapping[FixState, float]
    lasting: tuple[LastingError, ...]
    common: LastingError | None
    period: int

    def is_white(self, state: FixState) -> bool:
        return self.common is None and not any(state in error.states for error in self.lasting)

    @property
    def common_variance(self) -> float:
        return self.common.deviation**2 if self.common else 0.0

    @property
    def common_density(self) -> float:
        """Random walk (m²/s) per axis of the shared error, 2 σ²/τ of a Gauss–Markov process."""
        return 2.0 * self.common_variance / self.common.time_constant if self.common else 0.0


def stated_errors(settings: GnssSettings) -> StatedErrors:
    """Error model that a receiver with these settings states.

    A configured bias counts with its size, not its direction, as in a data sheet.
    """
    lasting = [error for state in STATES_WITH_FIX for error in _drift(settings, state)]
    bias = settings.bias
    if bias is not None:
        size = hypot(bias.deviation, hypot(bias.east, bias.north) / sqrt(2.0))
        everywhere = frozenset(STATES_WITH_FIX)
        lasting.append(LastingError(settings.accuracy * size, inf, everywhere))
    return StatedErrors(
        white={state: _white(settings, state) for state in STATES_WITH_FIX},
        lasting=tuple(error for error in lasting if error.deviation > 0.0),
        common=_common(settings.common_drift, settings.accuracy),
        period=round(SECOND / settings.rate),
    )


def _white(settings: GnssSettings, state: FixState) -> float:
    """Variance of the white noise in a state; rounding to a step q has q²/12."""
    errors = settings.errors_in(state)
    noise = hypot(errors.position_noise, settings.quantisation / sqrt(12.0))
    return max(errors.accuracy * noise, LEAST_NOISE) ** 2


def _drift(settings: GnssSettings, state: FixState) -> list[LastingError]:
    errors = settings.errors_in(state)
    drift = errors.drift or NO_DRIFT
    if drift.deviation <= 0.0:
        return []
    entry = _entry_deviation(errors, drift.deviation)
    deviation = errors.accuracy * drift.deviation
    return [LastingError(deviation, drift.time_constant, frozenset({state}), entry)]


def _entry_deviation(errors: StateErrors, deviation: float) -> float | None:
    """Stated deviation (m) per axis of a drift that restarts within `entry_jump` (m) of 0.

    The distance has Rayleigh's distribution, truncated: half its mean square is
    σ² (1 - u / (e^u - 1)) with u = r² / 2σ².
    """
    radius = errors.entry_jump
    if radius is None:
        return None
    u = 0.5 * (radius / deviation) ** 2
    share = 1.0 - u / expm1(u) if 0.0 < u < 700.0 else float(u > 0.0)
    return errors.accuracy * deviation * sqrt(share)


def _common(drift: CommonDrift | None, accuracy: float) -> LastingError | None:
    if drift is None or drift.deviation <= 0.0 or isinf(drift.time_constant):
        return None
    states = frozenset(STATES_WITH_FIX)
    return LastingError(accuracy * drift.deviation, drift.time_constant, states)
