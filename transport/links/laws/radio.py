"""Base of radio laws, whose losses follow from the true distance between both antennas.

The message carries the position of the sender; the receiving node knows its own. A message without
a position is out of range.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import pairwise
from math import ceil, erfc, exp, floor, hypot, isfinite, log10, sqrt
from statistics import NormalDist
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from transport.links.laws.correlated_normals import CorrelatedNormals
from transport.links.laws.link_law import (
    Draw,
    LawTable,
    LinkLaw,
    Losses,
    Problem,
    TransmissionContext,
    VehiclesBetween,
)
from transport.topics import DropReason

PURPOSE = "radio"  # Purpose of the draws of deliveries


class Radio(LinkLaw):
    """Base of radio laws; the loss in the long run is a function of the distance."""

    key = "radio"
    reason = "range"


def distance_of(context: TransmissionContext) -> float:
    """Distance (m) between sender and receiver when a message was sent."""
    sender, receiver = context.sender, context.receiver
    return hypot(sender.east - receiver.east, sender.north - receiver.north)


def curve_problems(
    within: str, x: tuple[str, Sequence[float]], y: tuple[str, Sequence[float]]
) -> Iterator[Problem]:
    """Yield different lengths of the lists `x` and `y` (key, values), and an `x` not increasing."""
    (x_key, xs), (y_key, ys) = x, y
    if len(xs) != len(ys):
        yield f"{within}{y_key}", f"given {len(ys)} numbers, allowed {len(xs)} as {within}{x_key}"
    for index, (before, after) in enumerate(pairwise(xs), 1):
        if after <= before:
            why = f"given {after}, allowed more than {before}, the previous entry"
            yield f"{within}{x_key}[{index}]", why


# ---- Shadowing: slow variation of the signal strength along the receiver's path


STEPS = 20  # Number of nodes per decorrelation distance

_RHO = exp(-1.0 / STEPS)

Deviation = Annotated[float, Field(ge=0, le=60)]


class Shadowing(LawTable):
    """Log-normal shadowing with an exponential autocorrelation over the distance travelled.

    deviation_db             standard deviation with line of sight
    obstructed_deviation_db  standard deviation behind vehicles
    decorrelation_m          distance travelled by the receiver over which the autocorrelation falls
                             to 1/e

    Defaults: ETSI TR 103 257, highways.
    """

    deviation_db: Deviation = 3.0
    obstructed_deviation_db: Deviation = 4.0
    decorrelation_m: Annotated[float, Field(ge=1, le=10_000)] = 25.0

    def deviation(self, is_obstructed: bool) -> float:
        return self.obstructed_deviation_db if is_obstructed else self.deviation_db


@dataclass(frozen=True, slots=True)
class ShadowField:
    """A standard normal process over the distance travelled by the receiver, one per link.

    Its autocorrelation is e^(−Δd/D) with the decorrelation distance D = `decorrelation` (m), by
    the recursion of ETSI TR 103 257, S' = e^(−Δd/D) S + √(1 − e^(−2Δd/D)) N, on nodes D/20 apart.
    Between nodes it is interpolated linearly and scaled to variance 1. N is drawn by link,
    `purpose` and node, so each value can be computed alone. The distribution is exact at the
    nodes; between them the autocorrelation is too large by at most 0.026.

    A receiver at a standstill keeps its value. The two directions between two vehicles are
    independent.
    """

    decorrelation: float
    purpose: str = "shadowing"
    _nodes: CorrelatedNormals = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_nodes", CorrelatedNormals(self.purpose, _RHO))

    def at(self, draw: Draw, travelled: float) -> float:
        position = travelled * STEPS / self.decorrelation
        node = floor(position)
        share = position - node
        rest = 1.0 - share
        here, ahead = self._nodes.at(draw, node), self._nodes.at(draw, node + 1)
        spread = sqrt(rest * rest + share * share + 2.0 * rest * share * _RHO)
        return (rest * here + share * ahead) / spread


# ---- Obstruction of a radio link by the vehicles between sender and receiver


Floats = NDArray[np.float64]
Radius = Annotated[float, Field(ge=0, le=10)]

MAX_LOSS = 150.0  # Loss (dB) with which no radio receives anything


class Obstruction(LawTable):
    """Base of the loss caused by vehicles in between; `varies` if it is random along the road.

    A vehicle obstructs the link if its circle of `radius_m` cuts the line of sight.
    """

    varies: ClassVar[bool] = False

    def loss(
        self,
        between: VehiclesBetween,
        variation: ShadowField,
        draw: Draw,
        context: TransmissionContext,
        distance: float,
    ) -> tuple[float, bool]:
        """Loss (dB) over `distance` (m), and whether a vehicle obstructs the link."""
        raise NotImplementedError

    def losses(
        self, count: int, distance: float, normals: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        """Losses (dB) over `distance` (m) behind `count` vehicles, and their weights.

        `normals` and `weights` are those of a quadrature over a standard normal number.
        """
        raise NotImplementedError


class LossPerVehicle(Obstruction):
    """The same loss for each vehicle in the line of sight (ETSI TR 103 257).

    loss_db   loss per vehicle
    radius_m  radius of a vehicle's circle
    """

    kind: Literal["etsi"] = "etsi"
    loss_db: Annotated[float, Field(ge=0.1, le=100)] = 6.9
    radius_m: Radius = 1.5

    def loss(
        self,
        between: VehiclesBetween,
        variation: ShadowField,
        draw: Draw,
        context: TransmissionContext,
        distance: float,
    ) -> tuple[float, bool]:
        count = between.count_obstructing(context, ceil(MAX_LOSS / self.loss_db))
        return self.loss_db * count, count > 0

    def losses(
        self, count: int, distance: float, normals: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        most = ceil(MAX_LOSS / self.loss_db)
        return np.array([self.loss_db * min(count, most)]), np.ones(1)


class SingleLoss(Obstruction):
    """One random loss max(0, N(mean, deviation)) for any number of vehicles (3GPP TR 37.885).

    mean_db       mean; it grows by max(0, 15 log₁₀ d − 41) dB over d metres
    deviation_db  standard deviation
    radius_m      radius of a vehicle's circle

    9 and 4.5 dB are for trucks higher than both antennas, 5 and 4 dB for cars. The report does not
    specify the autocorrelation; here it is that of the shadowing.
    """

    varies = True

    kind: Literal["3gpp"] = "3gpp"
    mean_db: Annotated[float, Field(ge=-300, le=300)] = 9.0
    deviation_db: Deviation = 4.5
    radius_m: Radius = 1.5

    def loss(
        self,
        between: VehiclesBetween,
        variation: ShadowField,
        draw: Draw,
        context: TransmissionContext,
        distance: float,
    ) -> tuple[float, bool]:
        if not between.count_obstructing(context, 1):
            return 0.0, False
        normal = variation.at(draw, context.receiver.travelled)
        return max(0.0, self._mean(distance) + self.deviation_db * normal), True

    def losses(
        self, count: int, distance: float, normals: Floats, weights: Floats
    ) -> tuple[Floats, Floats]:
        return np.maximum(0.0, self._mean(distance) + self.deviation_db * normals), weights

    def _mean(self, distance: float) -> float:
        return self.mean_db + max(0.0, 15.0 * log10(distance) - 41.0)


ObstructionLaw = Annotated[LossPerVehicle | SingleLoss, Field(discriminator="kind")]


# ---- Delivery by the signal-to-noise ratio over the distance


THERMAL_NOISE = -174.0  # Power density of thermal noise at room temperature (dBm/Hz)
MIN_DISTANCE = 1.0  # Loss is constant below (m): path loss is for the far field
NODES = 32  # Number of nodes of the quadrature over a normal number

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
            return Losses(loss)
        return Losses.independent(loss)

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
