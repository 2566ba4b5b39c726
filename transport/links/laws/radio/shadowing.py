"""Shadowing: how the strength of a radio link wavers as its receiver drives on."""

from dataclasses import dataclass, field
from math import exp, floor, sqrt

from transport.links.laws.effect import Draw
from transport.links.laws.normals import Normals

STEPS = 20
"""Nodes over one decorrelation distance."""

_RHO = exp(-1.0 / STEPS)


@dataclass(frozen=True, slots=True)
class ShadowField:
    """A standard normal quantity over the metres that a receiver has driven, one for each link.

    Its autocorrelation is e^(−Δd/D) with the decorrelation distance D = `decorrelation` (m): the
    recursion of ETSI TR 103 257, S' = e^(−Δd/D) S + √(1 − e^(−2Δd/D)) N, on nodes D/20 apart, and
    on a line between two nodes, stretched so that the variance is 1 there too. N belongs to the
    link, the `purpose` and the node, so that any value can be worked out alone. At the nodes the
    law is exact, between them the autocorrelation is too large by 0.026 at most.

    A receiver that stands keeps its value. Each direction between two vehicles has its own: the
    field is not reciprocal.
    """

    decorrelation: float
    purpose: str = "shadowing"
    _nodes: Normals = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Make the nodes."""
        object.__setattr__(self, "_nodes", Normals(self.purpose, _RHO))

    def at(self, draw: Draw, driven: float) -> float:
        """Value where the receiver has driven `driven` metres."""
        place = driven * STEPS / self.decorrelation
        node = floor(place)
        share = place - node
        rest = 1.0 - share
        here, ahead = self._nodes.at(draw, node), self._nodes.at(draw, node + 1)
        spread = sqrt(rest * rest + share * share + 2.0 * rest * share * _RHO)
        return (rest * here + share * ahead) / spread
