"""Shadowing: how the strength of a radio link wavers as its receiver drives on."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from math import exp, floor, sqrt
from statistics import NormalDist

from transport.links.laws.effect import Draw

STEPS = 20
"""Nodes over one decorrelation distance."""
LOOK_BACK = 160
"""Nodes before a block from which its recursion starts: eight decorrelation distances."""
BLOCK = 512
"""Nodes of one recursion."""
MOST_BLOCKS = 4
"""Blocks that are kept; what is not kept is worked out again."""

_RHO = exp(-1.0 / STEPS)
_FRESH = sqrt(1.0 - _RHO * _RHO)
_normal = NormalDist().inv_cdf


@dataclass(frozen=True, slots=True)
class ShadowField:
    """A standard normal quantity over the metres that a receiver has driven, one for each link.

    Its autocorrelation is e^(−Δd/D) with the decorrelation distance D = `decorrelation` (m): the
    recursion of ETSI TR 103 257, S' = e^(−Δd/D) S + √(1 − e^(−2Δd/D)) N, on nodes D/20 apart, and
    on a line between two nodes, stretched so that the variance is 1 there too. N belongs to the
    link, the `purpose` and the node. So that any node can be worked out alone, the recursion
    starts afresh for each block of 512 nodes, 160 nodes before it and in its stationary law: the
    variance is exact, the autocorrelation between two blocks too small by 4·10⁻⁴ at most. The line
    between the nodes adds at most 0.026 to the autocorrelation, at distances of up to two nodes.

    A receiver that stands keeps its value. Each direction between two vehicles has its own: the
    field is not reciprocal.
    """

    decorrelation: float
    purpose: str = "shadowing"
    _blocks: dict[tuple[Draw, int], tuple[list[float], Iterator[float]]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def at(self, draw: Draw, driven: float) -> float:
        """Value where the receiver has driven `driven` metres."""
        place = driven * STEPS / self.decorrelation
        node = floor(place)
        share = place - node
        rest = 1.0 - share
        here, ahead = self._node(draw, node), self._node(draw, node + 1)
        spread = sqrt(rest * rest + share * share + 2.0 * rest * share * _RHO)
        return (rest * here + share * ahead) / spread

    def _node(self, draw: Draw, node: int) -> float:
        block, place = divmod(node, BLOCK)
        known = self._blocks.get((draw, block))
        if known is None:
            if len(self._blocks) >= MOST_BLOCKS:
                self._blocks.clear()
            start = block * BLOCK
            values = islice(self._recursion(draw, start - LOOK_BACK), LOOK_BACK, None)
            known = self._blocks[draw, block] = [], values
        found, further = known
        if place >= len(found):
            found.extend(islice(further, place + 1 - len(found)))
        return found[place]

    def _recursion(self, draw: Draw, node: int) -> Iterator[float]:
        """Values from `node` on, the first in the stationary law."""
        value = _normal(draw(self.purpose, node))
        while True:
            yield value
            node += 1
            value = _RHO * value + _FRESH * _normal(draw(self.purpose, node))
