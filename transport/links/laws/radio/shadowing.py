"""Shadowing: how the strength of a radio link wavers as its receiver drives on."""

from dataclasses import dataclass, field
from math import exp, floor, sqrt
from typing import Annotated

from pydantic import Field

from transport.links.laws.correlated_normals import CorrelatedNormals
from transport.links.laws.effect import Draw
from transport.links.laws.link_law import LawTable

STEPS = 20
"""Nodes over one decorrelation distance."""

_RHO = exp(-1.0 / STEPS)

Deviation = Annotated[float, Field(ge=0, le=60)]


class Shadowing(LawTable):
    """Slow wavering of the strength: standard deviations, and the way over which it decorrelates.

    ETSI TR 103 257: 3 dB in sight, 4 dB not, 25 m on highways; the autocorrelation is
    e^(−metres driven by the receiver / `decorrelation_m`).
    """

    deviation_db: Deviation = 3.0
    obstructed_deviation_db: Deviation = 4.0
    decorrelation_m: Annotated[float, Field(ge=1, le=10_000)] = 25.0

    def deviation(self, is_obstructed: bool) -> float:
        return self.obstructed_deviation_db if is_obstructed else self.deviation_db

    def describe(self) -> str:
        deviations = dict.fromkeys((self.deviation_db, self.obstructed_deviation_db))
        decibels = " and ".join(f"{one:g}" for one in deviations)
        return f"shadowing {decibels} dB over {self.decorrelation_m:g} m"


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
    _nodes: CorrelatedNormals = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_nodes", CorrelatedNormals(self.purpose, _RHO))

    def at(self, draw: Draw, travelled: float) -> float:
        place = travelled * STEPS / self.decorrelation
        node = floor(place)
        share = place - node
        rest = 1.0 - share
        here, ahead = self._nodes.at(draw, node), self._nodes.at(draw, node + 1)
        spread = sqrt(rest * rest + share * share + 2.0 * rest * share * _RHO)
        return (rest * here + share * ahead) / spread
