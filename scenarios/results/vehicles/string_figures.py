"""String stability figures: gains of the errors from vehicle to vehicle, and from head to tail."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal, NamedTuple

from scenarios.results.vehicles.string_norms import Norm, VehicleNorms

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

    def has_gain(self, figures: StringFigures) -> bool:
        gains = (*self.gains(figures), *self.gains_from_head(figures))
        return any(gain is not None for gain in gains)

    def _pair(self, figures: StringFigures, reach: str) -> tuple[float | None, float | None]:
        name = f"{self.name}_gain"
        return getattr(figures, f"{name}_l2{reach}"), getattr(figures, f"{name}_linf{reach}")


LATERAL = StringSignal("lateral", "lateral error", "error_m", "first")
SPACING = StringSignal("spacing", "spacing error", "error_m", "first")
ACCELERATION = StringSignal("acceleration", "acceleration", "mps2", "lead")
STRING_SIGNALS = (LATERAL, SPACING, ACCELERATION)


class Excitation(NamedTuple):
    """A norm, and the noise below which it is no denominator of a gain.

    rms      least root mean square of the L2 gain
    largest  least largest magnitude of the L-infinity gain
    """

    norm: Norm
    rms: float
    largest: float


def string_figures(
    norms: Mapping[str, VehicleNorms], deviations_m: Mapping[str, float]
) -> dict[str, StringFigures]:
    """Compute the figures of all vehicles; `norms` has the lead first.

    `deviations_m` are standard deviations (m) of the vehicles' positions. Noise alone explains
    lateral errors with a root mean square of one and a largest value of three of them, and √2 times
    as much in the spacing, which has two positions.
    """
    lateral, spacing, acceleration = [], [], []
    for name, row in norms.items():
        noise = max(deviations_m.get(name, 0.0), LEAST_ERROR_M)
        lateral.append(Excitation(row.lateral, noise, SIGMAS * noise))
        noise *= sqrt(2.0)
        spacing.append(Excitation(row.spacing, noise, SIGMAS * noise))
        least = LEAST_ACCELERATION_MPS2
        acceleration.append(Excitation(row.acceleration, least, SIGMAS * least))
    signals = {
        **_values_of(LATERAL, lateral[1:]),
        **_values_of(SPACING, spacing[1:]),
    }
    followers = _rows(signals, len(norms) - 1)
    motions = _rows(_values_of(ACCELERATION, acceleration), len(norms))
    rows = [motion | error for motion, error in zip(motions, [{}, *followers], strict=True)]
    return {name: StringFigures(**row) for name, row in zip(norms, rows, strict=True)}


Values = Sequence[float | None]


def _rows(signals: Mapping[str, Values], count: int) -> list[dict[str, float | None]]:
    return [{name: values[place] for name, values in signals.items()} for place in range(count)]


def _values_of(signal: StringSignal, chain: Sequence[Excitation]) -> dict[str, Values]:
    """Return the figures of a signal by field, each with a value per vehicle of the chain."""
    known = [one.norm if one.norm.is_known else None for one in chain]
    rms = [None if norm is None else norm.rms for norm in known]
    largest = [None if norm is None else norm.largest for norm in known]
    of_rms = _gains(rms, [one.rms for one in chain])
    of_largest = _gains(largest, [one.largest for one in chain])
    growth = [
        gain ** (1.0 / steps) if steps and gain is not None else None
        for steps, gain in enumerate(of_rms.from_head)
    ]
    name, unit, head = signal.name, signal.unit, signal.head
    return {
        f"{name}_{unit}_rms": rms,
        f"{name}_{unit}_max": largest,
        f"{name}_gain_l2": of_rms.from_ahead,
        f"{name}_gain_linf": of_largest.from_ahead,
        f"{name}_gain_l2_from_{head}": of_rms.from_head,
        f"{name}_gain_linf_from_{head}": of_largest.from_head,
        f"{name}_growth_l2": growth,
    }


class SignalGains(NamedTuple):
    """SignalGains of each vehicle from the vehicle ahead, and from the head of the chain."""

    from_ahead: list[float | None]
    from_head: list[float | None]


def _gains(values: Values, least: Sequence[float]) -> SignalGains:
    """Divide each value by the one before and by the first, where these are at least `least`."""
    if not values:
        return SignalGains([], [])
    excited = [
        value if value is not None and value >= floor else None
        for value, floor in zip(values, least, strict=True)
    ]
    ahead = [None, *excited[:-1]]
    head = [None, *[excited[0]] * (len(values) - 1)]
    return SignalGains(
        [_ratio(value, other) for value, other in zip(values, ahead, strict=True)],
        [_ratio(value, other) for value, other in zip(values, head, strict=True)],
    )


def _ratio(value: float | None, reference: float | None) -> float | None:
    return value / reference if value is not None and reference is not None else None
