"""The four states of netem's `loss state`."""

from functools import cached_property
from typing import Literal

from transport.links.laws.law import Ratio, Unfit
from transport.links.laws.loss.chains import ChainLoss, CoupledChain, forgetting


class FourState(ChainLoss):
    """The four states of netem: sent in a gap 1, sent in a burst 2, lost in it 3, lost alone 4.

    gap_to_burst_ratio   p13, chance of a burst to begin with the message
    burst_to_gap_ratio   p31, chance of it to end after a loss
    lost_to_sent_ratio   p32, chance of a message sent after a loss, within the burst
    sent_to_lost_ratio   p23, chance of a loss after such a message
    isolated_loss_ratio  p14, chance of a loss alone, in the gap

    The new state is the message's fate, and after 4 follows 1. Source: sch_netem.c of Linux;
    Salsano, Ludovici, Ordine and Giannuzzi, Definition of a general and intuitive loss model for
    packet networks, 2012. The states that matter are those reached from 1, where netem starts; here
    the chain is stationary from the first message on.
    """

    kind: Literal["four_state"] = "four_state"
    gap_to_burst_ratio: Ratio | None = None
    burst_to_gap_ratio: Ratio | None = None
    lost_to_sent_ratio: Ratio = 0.0
    sent_to_lost_ratio: Ratio = 1.0
    isolated_loss_ratio: Ratio = 0.0

    @cached_property
    def chances(self) -> dict[str, float]:
        """The five numbers by netem's names; raises Unfit."""
        p13, p31 = self.needed("gap_to_burst_ratio"), self.needed("burst_to_gap_ratio")
        p32, p23, p14 = self.lost_to_sent_ratio, self.sent_to_lost_ratio, self.isolated_loss_ratio
        if p13 + p14 > 1.0:
            allowed = f"at most {1.0 - p13:g}, for gap_to_burst_ratio is {p13:g}"
            raise Unfit("isolated_loss_ratio", f"given {p14:g}, allowed {allowed}")
        if p31 + p32 > 1.0:
            allowed = f"at most {1.0 - p31:g}, for burst_to_gap_ratio is {p31:g}"
            raise Unfit("lost_to_sent_ratio", f"given {p32:g}, allowed {allowed}")
        return {"p13": p13, "p31": p31, "p32": p32, "p23": p23, "p14": p14}

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain in the order 3, 4, 2, 1: a small draw loses, a large one delivers."""
        p13, p31, p32, p23, p14 = self.chances.values()
        rows = (
            (1.0 - p31 - p32, 0.0, p32, p31),
            (0.0, 0.0, 0.0, 1.0),
            (p23, 0.0, 1.0 - p23, 0.0),
            (p13, p14, 0.0, 1.0 - p13 - p14),
        )
        given = tuple(self.chances.values())
        return forgetting("burst_to_gap_ratio", given, lambda: CoupledChain(rows, start=3))

    @cached_property
    def loses(self) -> tuple[float, ...]:
        """Chance of a loss in each state."""
        return 1.0, 1.0, 0.0, 0.0

    def describe(self) -> str:
        """Name the law, its loss and burst, and its five numbers."""
        numbers = ", ".join(f"{name} {value:.4g}" for name, value in self.chances.items())
        return f"four states as in netem: {self._loss_and_burst()} ({numbers})"
