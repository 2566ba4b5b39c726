"""Delivery by the signal-to-noise ratio over the distance."""

from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import pairwise
from math import erfc, inf, isfinite, log10, sqrt
from statistics import NormalDist
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import LawTable, Problem
from transport.links.laws.moments import Losses
from transport.links.laws.radio.obstruction import ObstructionLaw
from transport.links.laws.radio.radio_law import PURPOSE, Radio, curve_problems, distance_of
from transport.links.laws.radio.shadowing import ShadowField, Shadowing
from transport.links.laws.vehicles_between import VehiclesBetween
from transport.reasons import DropReason

THERMAL_NOISE = -174.0  # Power density of thermal noise at room temperature (dBm/Hz)
MIN_DISTANCE = 1.0  # Loss is constant below (m): path loss is for the far field
NODES = 32  # Number of nodes of the quadrature over a normal number
OUT_OF_RANGE_LOSS = 0.99  # Loss from which a radio is out of range
MAX_DISTANCE_M, STEP_M = 20_000.0, 50.0

Decibels = Annotated[float, Field(ge=-300, le=300)]
Curve = Annotated[tuple[Decibels, ...], Field(strict=False, min_length=2)]
Errors = Annotated[
    tuple[Annotated[float, Field(gt=0, lt=1)], ...], Field(strict=False, min_length=2)
]


class PacketErrors(LawTable):
    """Packet error ratio over the signal-to-noise ratio (SNR).

    snr_db                  increasing SNR values, with line of sight
    error_ratio             packet error ratio at each value of snr_db, decreasing
    obstructed_snr_db       the same behind vehicles
    obstructed_error_ratio  the same behind vehicles

    Between the points, and beyond both ends, the curves are straight lines on normal probability
    paper. Defaults: IEEE 802.11p, 350 bytes, highway.
    """

    snr_db: Curve = (1.0, 3.1, 5.2)
    error_ratio: Errors = (0.5, 0.1, 0.01)
    obstructed_snr_db: Curve = (4.7, 6.8, 8.6)
    obstructed_error_ratio: Errors = (0.5, 0.1, 0.01)

    def problems(self) -> Iterator[Problem]:
        for prefix, snr_db, error_ratio in (
            ("", self.snr_db, self.error_ratio),
            ("obstructed_", self.obstructed_snr_db, self.obstructed_error_ratio),
        ):
            key = f"{prefix}error_ratio"
            yield from curve_problems("errors.", (f"{prefix}snr_db", snr_db), (key, error_ratio))
            for index, (before, after) in enumerate(pairwise(error_ratio), 1):
                if after >= before:
                    why = f"given {after}, allowed less than {before}, the previous entry"
                    yield f"errors.{key}[{index}]", why


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """Packet delivery ratio over the signal-to-noise ratio (dB).

    `errors`, decreasing and strictly between 0 and 1, belong to the increasing `snrs`. Between the
    points and beyond both ends, the normal quantile of the ratio is linear in dB.
    """

    snrs: tuple[float, ...]
    errors: tuple[float, ...]
    _scores: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 2 <= len(self.snrs) == len(self.errors):
            raise ValueError("a curve needs two points or more")
        score = NormalDist().inv_cdf
        object.__setattr__(self, "_scores", tuple(-score(error) for error in self.errors))

    def received(self, snr: float) -> float:
        """Packet delivery ratio at `snr` (dB)."""
        after = min(max(bisect_right(self.snrs, snr), 1), len(self.snrs) - 1)
        below, above = self.snrs[after - 1], self.snrs[after]
        low, high = self._scores[after - 1], self._scores[after]
        score = low + (snr - below) / (above - below) * (high - low)
        return 0.5 * erfc(-score / sqrt(2.0))


class PathLossRadio(Radio):
    """Packet errors by the signal-to-noise ratio over the true distance between the antennas.

    power_dbm          transmit power plus the gains of both antennas
    frequency_hz       carrier frequency
    bandwidth_hz       bandwidth of the receiver
    noise_figure_db    noise figure of the receiver
    propagation        "3gpp_highway": 32.4 + 20 log₁₀ d + 20 log₁₀ f dB, d in m, f in GHz (3GPP TR
                       37.885); "log_distance": reference_loss_db + 10 exponent log₁₀ d
    reference_loss_db  path loss at 1 m, for "log_distance"
    exponent           path loss exponent, for "log_distance"
    errors             packet error curves
    shadowing          variation of the signal strength, by default none
    obstruction        loss caused by vehicles in between, by default none

    There is no interference, and no fading besides what the error curves contain.
    """

    kind: Literal["path_loss"] = "path_loss"
    power_dbm: Decibels = 23.0
    frequency_hz: Annotated[float, Field(ge=1e8, le=1e12)] = 5.9e9
    bandwidth_hz: Annotated[float, Field(ge=1e3, le=1e10)] = 10e6
    noise_figure_db: Annotated[float, Field(ge=0, le=60)] = 9.0
    propagation: Literal["3gpp_highway", "log_distance"] = "3gpp_highway"
    reference_loss_db: Annotated[float, Field(ge=0, le=200)] = 47.8
    exponent: Annotated[float, Field(ge=0.5, le=10)] = 2.0
    errors: PacketErrors = PacketErrors()
    shadowing: Shadowing | None = None
    obstruction: ObstructionLaw | None = None

    def problems(self) -> Iterator[Problem]:
        return self.errors.problems()

    @cached_property
    def _budget(self) -> tuple[float, float, float]:
        """Loss at 1 m (dB), path loss exponent and receiver noise (dBm)."""
        noise = noise_power(self.bandwidth_hz, self.noise_figure_db)
        if self.propagation == "log_distance":
            return self.reference_loss_db, self.exponent, noise
        return highway_loss(self.frequency_hz), 2.0, noise

    @cached_property
    def _curves(self) -> tuple[ErrorCurve, ErrorCurve]:
        """Error curves with line of sight, and behind vehicles."""
        errors = self.errors
        return (
            ErrorCurve(errors.snr_db, errors.error_ratio),
            ErrorCurve(errors.obstructed_snr_db, errors.obstructed_error_ratio),
        )

    @cached_property
    def _shadow(self) -> Shadowing:
        return self.shadowing or Shadowing()

    @cached_property
    def _field(self) -> ShadowField:
        return ShadowField(self._shadow.decorrelation_m)

    @cached_property
    def _variation(self) -> ShadowField:
        """Variation of the loss behind vehicles, with the decorrelation of the shadowing."""
        return ShadowField(self._shadow.decorrelation_m, "obstruction")

    @cached_property
    def between(self) -> VehiclesBetween | None:
        """Vehicles between sender and receiver that may obstruct the link; None without any."""
        if self.obstruction is None:
            return None
        others = self.setting.between()
        return replace(others, radius=self.obstruction.radius_m) if others.count else None

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        distance = distance_of(context)
        if not isfinite(distance + context.sender.travelled):
            return "range"
        is_obstructed, loss_db = False, 0.0
        distance = max(distance, MIN_DISTANCE)
        if self.obstruction is not None and self.between is not None:
            loss_db, is_obstructed = self.obstruction.loss(
                self.between, self._variation, draw, context, distance
            )
        if self.shadowing is not None:
            deviation = self.shadowing.deviation(is_obstructed)
            loss_db += deviation * self._field.at(draw, context.receiver.travelled)
        received = self._curves[is_obstructed].received(self.snr(distance) - loss_db)
        return 0 if draw(PURPOSE, context.seq) < received else "range"

    def snr(self, distance: float) -> float:
        """Signal-to-noise ratio (dB) at `distance` (m) with line of sight."""
        reference, exponent, noise = self._budget
        path_loss = reference + 10.0 * exponent * log10(distance)
        return self.power_dbm - path_loss - noise

    def losses(self, distance_m: float | None) -> Losses | None:
        """Loss over a distance, obstructed by all vehicles in between; no burst if it varies."""
        if distance_m is None:
            return None
        loss = 1.0 - self._delivered(max(distance_m, MIN_DISTANCE))
        obstructed = self.obstruction is not None and self.between is not None
        varies = obstructed and self.obstruction is not None and self.obstruction.varies
        if loss and (varies or self.shadowing is not None):
            return Losses(loss, None, 0.0)
        return Losses.of_bursts(loss, 1.0 / (1.0 - loss) if loss < 1.0 else inf)

    @property
    def range_m(self) -> float:
        far = STEP_M
        while far < MAX_DISTANCE_M and 1.0 - self._delivered(far) < OUT_OF_RANGE_LOSS:
            far += STEP_M
        return far

    def _delivered(self, distance: float) -> float:
        """Delivery ratio, averaged over the shadowing and a random obstruction."""
        normals, weights = _normal_nodes()
        is_obstructed, obstruction, obstruction_weights = False, np.zeros(1), np.ones(1)
        if self.obstruction is not None and self.between is not None:
            is_obstructed, count = True, self.between.count
            obstruction, obstruction_weights = self.obstruction.losses(
                count, distance, normals, weights
            )
        shadow, shadow_weights = np.zeros(1), np.ones(1)
        if self.shadowing is not None:
            shadow, shadow_weights = self.shadowing.deviation(is_obstructed) * normals, weights
        snr, curve = self.snr(distance), self._curves[is_obstructed]
        received = [
            [curve.received(snr - loss - other) for other in shadow.tolist()]
            for loss in obstruction.tolist()
        ]
        return float(obstruction_weights @ np.array(received) @ shadow_weights)

    def describe(self) -> str:
        parts = [f"{self.power_dbm:g} dBm, {self.snr(100.0):.1f} dB above the noise at 100 m"]
        if self.shadowing is not None:
            parts.append(self.shadowing.describe())
        if self.obstruction is not None and self.between is not None:
            parts.append(self.obstruction.describe(self.between.count))
        return ", ".join(parts)


@cache
def _normal_nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights of the Gauss–Hermite quadrature over a standard normal number."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return nodes, weights / sqrt(2.0 * np.pi)


def noise_power(bandwidth: float, figure: float) -> float:
    """Noise power (dBm) in `bandwidth` (Hz) of a receiver with a noise `figure` (dB)."""
    return THERMAL_NOISE + 10.0 * log10(bandwidth) + figure


def highway_loss(frequency: float) -> float:
    """Path loss (dB) at 1 m on a highway: 32.4 + 20 log₁₀ f, f in GHz (3GPP TR 37.885)."""
    return 32.4 + 20.0 * log10(frequency / 1e9)
