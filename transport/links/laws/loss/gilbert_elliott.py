"""The law of Gilbert and Elliott: a good and a bad state of the link."""

from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.law import Ratio, Unfit
from transport.links.laws.loss.chains import ChainLoss, CoupledChain, forgetting


class GilbertElliott(ChainLoss):
    """A good and a bad state of the link: by its chances, or by mean loss and mean burst.

    good_to_bad_ratio     p, chance of the link turning bad before a message
    bad_to_good_ratio     r, chance of its turning good
    bad_delivered_ratio   h, share of messages delivered in the bad state
    good_delivered_ratio  k, share delivered in the good state
    loss_ratio            in place of them: mean loss ...
    burst_messages_mean   ... and mean number lost in a row (with h = 0, k = 1)

    With h = 0 and k = 1 it is Gilbert's simple model: the loss is p / (p + r), bursts last 1 / r
    messages on average, and the autocorrelation of loss at lag m is (1 - p - r)^m. Sources:
    Gilbert, Bell System Technical Journal 39, 1960; Elliott, ibid. 42, 1963.

    A message is judged by the state after the change that belongs to it. Linux netem judges before
    the change and starts in the good state; in the long run both are the same.
    """

    kind: Literal["gilbert_elliott"] = "gilbert_elliott"
    good_to_bad_ratio: Ratio | None = None
    bad_to_good_ratio: Ratio | None = None
    bad_delivered_ratio: Ratio | None = None
    good_delivered_ratio: Ratio | None = None
    loss_ratio: Ratio | None = None
    burst_messages_mean: Annotated[float, Field(ge=1, le=10_000)] | None = None

    @cached_property
    def chances(self) -> tuple[float, float, float, float]:
        """The numbers p, r, h and k; raises Unfit."""
        by_burst = {"loss_ratio", "burst_messages_mean"}
        every = set(type(self).model_fields) - {"kind"}
        given = {key for key in every if getattr(self, key) is not None}
        if given & by_burst and given - by_burst:
            key, other = min(given - by_burst), min(given & by_burst)
            raise Unfit(key, f"given together with {other}, allowed chances or mean values")
        if given & by_burst:
            loss, burst = self.needed("loss_ratio"), self.needed("burst_messages_mean")
            if loss == 1.0 or burst < loss / (1.0 - loss):
                least = f"at least {loss / (1.0 - loss):g}" if loss < 1.0 else "a loss below 1"
                why = f"given {burst:g} with a loss of {loss:g}, allowed {least}"
                raise Unfit("burst_messages_mean", why)
            return loss / ((1.0 - loss) * burst), 1.0 / burst, 0.0, 1.0
        p, r = self.needed("good_to_bad_ratio"), self.needed("bad_to_good_ratio")
        h = 0.0 if self.bad_delivered_ratio is None else self.bad_delivered_ratio
        k = 1.0 if self.good_delivered_ratio is None else self.good_delivered_ratio
        return p, r, h, k

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain, the bad state first: a draw below both chances of it forgets."""
        p, r, *delivered = self.chances
        rows = ((1.0 - r, r), (p, 1.0 - p))
        by_burst = self.burst_messages_mean is not None
        key = "burst_messages_mean" if by_burst else "bad_to_good_ratio"
        given = (self.loss_ratio or 0.0, 1.0 / r) if by_burst else (p, r, *delivered)
        return forgetting(key, given, lambda: CoupledChain(rows, start=1))

    @cached_property
    def loses(self) -> tuple[float, ...]:
        """Chance of a loss in the bad and in the good state."""
        _, _, h, k = self.chances
        return 1.0 - h, 1.0 - k

    def describe(self) -> str:
        """Name the law, its loss and burst, and its four numbers."""
        p, r, h, k = self.chances
        numbers = f"p {p:.4g}, r {r:.4g}, h {h:.4g}, k {k:.4g}"
        return f"Gilbert–Elliott: {self._loss_and_burst()} ({numbers})"
