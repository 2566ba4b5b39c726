"""What a radio loses over a distance that stays the same, by its law."""

from functools import cache
from math import ceil, inf, log10, sqrt

import numpy as np

from transport.links.laws.effect import Effect
from transport.links.laws.radio.delivery import NEAREST, DeliveryOverDistance, Propagation
from transport.links.laws.radio.obstruction import HOPELESS, OnceForAll, PerVehicle

RADIO = DeliveryOverDistance, Propagation
NODES = 32
"""Of the quadrature over a normal number; the curves of errors are smooth."""
ALL_BUT_ALL = 0.99
"""Loss from which on a radio is out of reach."""
MOST_M, STEP_M = 20_000.0, 50.0


def loss_over_distance(effect: Effect, distance_m: float) -> tuple[float, float | None]:
    """Return mean loss and mean burst of a radio over `distance_m`; no burst where it wavers.

    All vehicles in between are taken to be in the way. Raises TypeError for another effect.
    """
    if isinstance(effect, DeliveryOverDistance):
        loss, held = 1.0 - effect.ratio(distance_m), effect.reservations
        messages = 1.0 if held is None else held.mean_messages
        return loss, messages / (1.0 - loss) if loss < 1.0 else inf
    if isinstance(effect, Propagation):
        loss = 1.0 - _delivered(effect, max(distance_m, NEAREST))
        wavers = effect.shadowing is not None or isinstance(effect.obstruction, OnceForAll)
        return loss, None if wavers and loss else 1.0 / (1.0 - loss) if loss < 1.0 else inf
    raise TypeError(type(effect).__name__)


def farthest_m(effect: Effect) -> float:
    """Distance (m) beyond which little or nothing is received."""
    if isinstance(effect, DeliveryOverDistance):
        return effect.distances[-1]
    far = STEP_M
    while far < MOST_M and loss_over_distance(effect, far)[0] < ALL_BUT_ALL:
        far += STEP_M
    return far


def _delivered(law: Propagation, distance: float) -> float:
    """Mean over the shadowing and, where it wavers by itself, over the obstruction."""
    normals, weights = _normal_nodes()
    sight, obstruction, lost = law.in_sight, law.obstruction, np.zeros(1)
    of_lost = np.ones(1)
    if isinstance(obstruction, PerVehicle) and obstruction.between.count:
        most = ceil(HOPELESS / obstruction.each)
        lost = np.array([obstruction.each * min(obstruction.between.count, most)])
        sight = law.obstructed
    elif isinstance(obstruction, OnceForAll) and obstruction.between.count:
        mean = obstruction.mean + max(0.0, 15.0 * log10(distance) - 41.0)
        lost, of_lost = np.maximum(0.0, mean + obstruction.deviation * normals), weights
        sight = law.obstructed
    shadow, of_shadow = np.zeros(1), np.ones(1)
    if law.shadowing is not None:
        shadow, of_shadow = sight.deviation * normals, weights
    ratio = law.ratio(distance)
    received = [
        [sight.errors.received(ratio - one - other) for other in shadow.tolist()]
        for one in lost.tolist()
    ]
    return float(of_lost @ np.array(received) @ of_shadow)


@cache
def _normal_nodes() -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of the standard normal law (Gauss and Hermite)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
    return nodes, weights / sqrt(2.0 * np.pi)
