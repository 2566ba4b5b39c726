"""Shadowing: slow variation of the signal strength along the receiver's path."""

from dataclasses import dataclass, field
from math import exp, floor, sqrt
from typing import Annotated

from pydantic import Field

from transport.links.laws.correlated_normals import CorrelatedNormals
from transport.links.laws.effect import Draw
from transport.links.laws.link_law import LawTable

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

    def describe(self) -> str:
        deviations = dict.fromkeys((self.deviation_db, self.obstructed_deviation_db))
        decibels = " and ".join(f"{deviation:g}" for deviation in deviations)
        return f"shadowing {decibels} dB, decorrelation distance {self.decorrelation_m:g} m"


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
