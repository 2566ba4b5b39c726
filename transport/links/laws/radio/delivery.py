"""The reach of a radio: what is received over a distance, by a table or by the loss on the way.

The distance is the true one between the two antennas: that of the sender comes with the message,
that of the receiver is known to the node that judges. A message that says no place is out of range.
"""

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cache
from math import erfc, hypot, inf, isfinite, log10, sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from transport.links.laws.effect import Draw, Effect, Passage
from transport.links.laws.moments import Losses
from transport.links.laws.radio.obstruction import Obstruction
from transport.links.laws.radio.reservations import Reservations
from transport.links.laws.radio.shadowing import ShadowField
from transport.reasons import DropReason

THERMAL_NOISE = -174.0
"""Power density of thermal noise at room temperature (dBm/Hz)."""
NEAREST = 1.0
"""The loss on the way is that at so many metres at least: the laws are for the far field."""

PURPOSE = "radio"
NODES = 32
"""Of the quadrature over a normal number; the curves of errors are smooth."""
ALL_BUT_ALL = 0.99
"""Loss from which on a radio is out of reach."""
MOST_M, STEP_M = 20_000.0, 50.0


def _distance(passage: Passage) -> float:
    sender, receiver = passage.sender, passage.receiver
    return hypot(sender.east - receiver.east, sender.north - receiver.north)


@dataclass(frozen=True, slots=True)
class DeliveryOverDistance(Effect):
    """Delivers the share of messages that a table gives for the distance.

    `ratios` belong to `distances` (m, increasing); between two it is linear, before the first as
    at the first, and beyond the last distance nothing is received: a table says how far it knows.

    Each message is lost on its own, or, with `reservations`, all those together that were sent with
    the same resources: as where somebody else has chosen them too and collides with each. The share
    is the same, the bursts are not.
    """

    distances: tuple[float, ...]
    ratios: tuple[float, ...]
    reservations: Reservations | None = None

    key = "radio"
    reason = "range"

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Drop when the draw of the message, or of its reservation, is not below the ratio."""
        drawn_for = passage.seq
        if self.reservations is not None:
            drawn_for = self.reservations.selected_at(draw, drawn_for)
        return 0 if draw(PURPOSE, drawn_for) < self.ratio(_distance(passage)) else "range"

    def ratio(self, distance: float) -> float:
        """Share of messages delivered over `distance` (m)."""
        if not distance <= self.distances[-1]:  # so that no place is out of range
            return 0.0
        after = bisect_right(self.distances, distance)
        if after in {0, len(self.distances)}:
            return self.ratios[max(after - 1, 0)]
        near, far = self.distances[after - 1], self.distances[after]
        share = (distance - near) / (far - near)
        return self.ratios[after - 1] + share * (self.ratios[after] - self.ratios[after - 1])

    @property
    def mean_loss_ratio(self) -> float | None:
        """None: it depends on the distance."""
        return None

    def losses(self, distance_m: float | None) -> Losses | None:
        """Loss over a distance."""
        if distance_m is None:
            return None
        loss, held = 1.0 - self.ratio(distance_m), self.reservations
        messages = 1.0 if held is None else held.mean_messages
        return Losses.of_bursts(loss, messages / (1.0 - loss) if loss < 1.0 else inf)

    @property
    def farthest_m(self) -> float:
        """The last distance of the table."""
        return self.distances[-1]

    def describe(self) -> str:
        """Give the law in one line."""
        held = self.reservations
        share = f"{self.ratios[0]:g} received at {self.distances[0]:g} m"
        if len(self.ratios) > 1:
            share += f" to {self.ratios[-1]:g} at {self.distances[-1]:g} m"
        if held is None:
            return f"{share}, each message on its own"
        return f"{share}, decided for {held.mean_messages:.3g} messages in a row on average"


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """Share of packets received over the ratio of signal to noise (dB).

    `errors`, decreasing and strictly between 0 and 1, belong to `snrs`, increasing. Between them,
    and on beyond both ends, the curve is a line on normal probability paper: the number of standard
    deviations that stands for the share is linear in dB.
    """

    snrs: tuple[float, ...]
    errors: tuple[float, ...]
    _scores: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Put the points on probability paper; raises ValueError unless there are two or more."""
        if not 2 <= len(self.snrs) == len(self.errors):
            raise ValueError("a curve needs two points or more")
        score = NormalDist().inv_cdf
        object.__setattr__(self, "_scores", tuple(-score(error) for error in self.errors))

    def received(self, snr: float) -> float:
        """Share of packets received at `snr` (dB)."""
        after = min(max(bisect_right(self.snrs, snr), 1), len(self.snrs) - 1)
        below, above = self.snrs[after - 1], self.snrs[after]
        low, high = self._scores[after - 1], self._scores[after]
        score = low + (snr - below) / (above - below) * (high - low)
        return 0.5 * erfc(-score / sqrt(2.0))


@dataclass(frozen=True, slots=True)
class Sight:
    """What holds in sight or behind vehicles: error curve, deviation of the shadowing (dB)."""

    errors: ErrorCurve
    deviation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Propagation(Effect):
    """Delivers by the ratio of signal to noise that is left after the way from sender to receiver.

    power       transmitted, with the gains of both antennas (dBm)
    noise       power of the noise in the receiver (dBm)
    reference   loss at 1 m (dB)
    exponent    by which the loss grows with distance: reference + 10 · exponent · log₁₀ d
    in_sight    errors and shadowing while no vehicle is in the way, `obstructed` while one is
    shadowing   how the shadowing wavers, None for none
    obstruction what vehicles in between cost, None for nothing

    There is no interference and no fading but what the error curves hold.
    """

    power: float
    noise: float
    reference: float
    exponent: float
    in_sight: Sight
    obstructed: Sight
    shadowing: ShadowField | None = None
    obstruction: Obstruction | None = None

    key = "radio"
    reason = "range"

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Drop when the message's draw is not below the share received at its ratio."""
        distance = _distance(passage)
        if not isfinite(distance + passage.sender.driven):
            return "range"
        sight, lost = self.in_sight, 0.0
        distance = max(distance, NEAREST)
        if self.obstruction is not None:
            lost, is_obstructed = self.obstruction.loss(draw, passage, distance)
            sight = self.obstructed if is_obstructed else sight
        if self.shadowing is not None:
            lost += sight.deviation * self.shadowing.at(draw, passage.receiver.driven)
        received = sight.errors.received(self.ratio(distance) - lost)
        return 0 if draw(PURPOSE, passage.seq) < received else "range"

    def ratio(self, distance: float) -> float:
        """Ratio of signal to noise (dB) at `distance` (m) in plain sight."""
        way = self.reference + 10.0 * self.exponent * log10(distance)
        return self.power - way - self.noise

    @property
    def mean_loss_ratio(self) -> float | None:
        """None: it depends on where the vehicles are."""
        return None

    def losses(self, distance_m: float | None) -> Losses | None:
        """Loss over a distance, with all vehicles in between in the way; no burst if it wavers."""
        if distance_m is None:
            return None
        loss = 1.0 - self._delivered(max(distance_m, NEAREST))
        obstruction = self.obstruction
        wavers = self.shadowing is not None or (obstruction is not None and obstruction.wavers)
        if wavers and loss:
            return Losses(loss, None, 0.0)
        return Losses.of_bursts(loss, 1.0 / (1.0 - loss) if loss < 1.0 else inf)

    @property
    def farthest_m(self) -> float:
        """Distance from which on all but all messages are lost."""
        far = STEP_M
        while far < MOST_M and 1.0 - self._delivered(far) < ALL_BUT_ALL:
            far += STEP_M
        return far

    def _delivered(self, distance: float) -> float:
        """Mean over the shadowing and, where it wavers by itself, over the obstruction."""
        normals, weights = _normal_nodes()
        sight, lost, of_lost = self.in_sight, np.zeros(1), np.ones(1)
        if self.obstruction is not None and self.obstruction.between.count:
            sight = self.obstructed
            lost, of_lost = self.obstruction.losses(distance, normals, weights)
        shadow, of_shadow = np.zeros(1), np.ones(1)
        if self.shadowing is not None:
            shadow, of_shadow = sight.deviation * normals, weights
        ratio = self.ratio(distance)
        received = [
            [sight.errors.received(ratio - one - other) for other in shadow.tolist()]
            for one in lost.tolist()
        ]
        return float(of_lost @ np.array(received) @ of_shadow)

    def describe(self) -> str:
        """Give the law in one line."""
        said = [f"{self.power:g} dBm, {self.ratio(100.0):.1f} dB above the noise at 100 m"]
        if self.shadowing is not None:
            deviations = dict.fromkeys((self.in_sight.deviation, self.obstructed.deviation))
            decibels = " and ".join(f"{one:g}" for one in deviations)
            said.append(f"shadowing {decibels} dB over {self.shadowing.decorrelation:g} m")
        if self.obstruction is not None:
            said.append(self.obstruction.describe())
        return ", ".join(said)


@cache
def _normal_nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Nodes and weights of the standard normal law (Gauss and Hermite)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return nodes, weights / sqrt(2.0 * np.pi)


def noise_power(bandwidth: float, figure: float) -> float:
    """Power (dBm) of the noise in `bandwidth` (Hz) of a receiver with a noise `figure` (dB)."""
    return THERMAL_NOISE + 10.0 * log10(bandwidth) + figure


def highway_loss(frequency: float) -> float:
    """Loss (dB) at 1 m on a highway (3GPP TR 37.885: 32.4 + 20 log₁₀ d + 20 log₁₀ f, f in GHz)."""
    return 32.4 + 20.0 * log10(frequency / 1e9)
