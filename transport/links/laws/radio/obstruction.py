"""Obstruction of a radio link by the vehicles between sender and receiver."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, log10
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from transport.links.laws.effect import Draw, Passage
from transport.links.laws.radio.shadowing import ShadowField

Floats = NDArray[np.float64]

HOPELESS = 150.0
"""Loss (dB) behind which nothing is received, whatever the radio: further vehicles do not count."""


@dataclass(frozen=True, slots=True)
class Road:
    """Places (m) every `step` metres along the road that the convoy drives, from station 0 on.

    Straight lines join them; with 2 m steps they lie within 0.1 m of a bend of 5 m radius.
    """

    step: float
    east: Sequence[float]
    north: Sequence[float]

    def places(self, station: float, step: float, count: int) -> Iterator[tuple[float, float]]:
        """Give east and north (m) at `count` stations (m), each `step` on from the one before.

        The first is `step` on from `station`; beyond an end the road goes straight on.
        """
        easts, norths, last = self.east, self.north, len(self.east) - 2
        place, on = station / self.step, step / self.step
        for _ in range(count):
            place += on
            node = int(place)
            node = 0 if node < 0 else min(node, last)
            share = place - node
            rest = 1.0 - share
            yield (
                rest * easts[node] + share * easts[node + 1],
                rest * norths[node] + share * norths[node + 1],
            )


@dataclass(frozen=True, slots=True)
class VehiclesBetween:
    """The `count` vehicles between sender and receiver, and which of them are in the way.

    The receiver does not hear all of them, so it takes them to stand evenly along the road between
    the two: each node knows the road, and both ends' true places come with the message and from
    the receiver itself, so every clock finds the same. Where they stand follows from the stations
    of both ends on the `road`: that of each at its start plus the metres that it has driven.

    A vehicle is in the way if its circle of `radius` m (ETSI TR 103 257: 1.5 m) cuts the line of
    sight between the true places of both ends. On a straight all are, around a bend they are not.
    """

    count: int
    road: Road
    sender_start: float
    receiver_start: float
    radius: float = 1.5

    def in_the_way(self, passage: Passage, most: int) -> int:
        """Count those in the way, up to `most`."""
        sender, receiver = passage.sender, passage.receiver
        station = self.receiver_start + receiver.driven
        step = (self.sender_start + sender.driven - station) / (self.count + 1)
        here_east, here_north = receiver.east, receiver.north
        way_east, way_north = sender.east - here_east, sender.north - here_north
        length = way_east * way_east + way_north * way_north  # squared
        reach = self.radius * self.radius * length  # of the cross product, squared
        found = 0
        for east, north in self.road.places(station, step, self.count):
            ahead, aside = east - here_east, north - here_north
            cross = way_east * aside - way_north * ahead
            # One beside the line counts where its foot lies between the two ends.
            if cross * cross < reach and 0.0 < way_east * ahead + way_north * aside < length:
                found += 1
                if found == most:
                    break
        return found


class Obstruction(Protocol):
    """A law of what the vehicles in between cost; one that `wavers` differs as they drive."""

    wavers: ClassVar[bool]

    @property
    def between(self) -> VehiclesBetween:
        """The vehicles in between."""

    def loss(self, draw: Draw, passage: Passage, distance: float) -> tuple[float, bool]:
        """Return the loss (dB) over `distance` (m), and whether any vehicle is in the way."""

    def losses(self, distance: float, normals: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Return losses (dB) over `distance` (m) and their weights, with all in the way.

        `normals` and `weights` are those of a quadrature over a standard normal number.
        """

    def describe(self) -> str:
        """Describe the law in a few words."""


@dataclass(frozen=True, slots=True)
class PerVehicle:
    """Each vehicle in the way costs `each` dB (ETSI TR 103 257: 6.9)."""

    between: VehiclesBetween
    each: float

    wavers: ClassVar[bool] = False

    def loss(self, draw: Draw, passage: Passage, distance: float) -> tuple[float, bool]:  # noqa: ARG002 - no chance
        """Return the sum over those in the way, and whether there are any."""
        found = self.between.in_the_way(passage, ceil(HOPELESS / self.each))
        return self.each * found, found > 0

    def losses(self, distance: float, normals: Floats, weights: Floats) -> tuple[Floats, Floats]:  # noqa: ARG002 - no chance
        """Return the sum over all."""
        most = ceil(HOPELESS / self.each)
        return np.array([self.each * min(self.between.count, most)]), np.ones(1)

    def describe(self) -> str:
        """Describe the law in a few words."""
        return f"{self.each:g} dB for each of up to {self.between.count} vehicles in between"


@dataclass(frozen=True, slots=True)
class OnceForAll:
    """Vehicles in the way cost max(0, N(μ, σ)) dB together, however many they are (TR 37.885).

    μ = `mean` + max(0, 15 log₁₀ d − 41) dB with d in metres, σ = `deviation` dB. The report does
    not say how N changes as the vehicles drive; here it wavers like the shadowing, as `wavering`.
    """

    between: VehiclesBetween
    mean: float
    deviation: float
    wavering: ShadowField

    wavers: ClassVar[bool] = True

    def loss(self, draw: Draw, passage: Passage, distance: float) -> tuple[float, bool]:
        """Return the loss if one is in the way, and whether one is."""
        if not self.between.in_the_way(passage, 1):
            return 0.0, False
        wavering = self.wavering.at(draw, passage.receiver.driven)
        return max(0.0, self._mean(distance) + self.deviation * wavering), True

    def losses(self, distance: float, normals: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Return the loss at each of the normal numbers."""
        return np.maximum(0.0, self._mean(distance) + self.deviation * normals), weights

    def _mean(self, distance: float) -> float:
        return self.mean + max(0.0, 15.0 * log10(distance) - 41.0)

    def describe(self) -> str:
        """Describe the law in a few words."""
        law = f"{self.mean:g} ± {self.deviation:g} dB once"
        return f"{law} for up to {self.between.count} vehicles in between"
