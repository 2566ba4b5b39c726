"""The laws of loss that a link's table asks for, and what does not fit together in it."""

import re
from collections.abc import Callable, Iterator
from typing import Any, cast

from scenarios.definition.refusal import shown
from scenarios.definition.schema.channel.loss import (
    CollisionsTable,
    EveryNthLoss,
    FourStateLoss,
    GilbertElliottLoss,
    ListedLoss,
    LogLoss,
    NoLoss,
    PatternLoss,
)
from scenarios.definition.schema.links import LinkTable
from transport.links.laws.chains import FourState, GilbertElliott
from transport.links.laws.effect import Effect
from transport.links.laws.patterns import (
    EarlierRun,
    EveryNth,
    Listed,
    Numbers,
    RecordedPattern,
    known_reason,
)
from transport.links.laws.radio.collisions import Collisions
from vehicles.schedule import MILLISECOND

LARGEST_DELAY_DIGITS = 15
"""Of a recorded delay in ns: eleven days."""


class _Unfit(ValueError):  # noqa: N818 - one problem on its way into a list of them
    """A key of a table, relative to it, and what is wrong."""

    def __init__(self, key: str, why: str) -> None:
        self.key, self.why = key, why
        super().__init__(f"{key}: {why}")


def loss_effects(table: LinkTable) -> Iterator[Effect]:
    """Give the effects of `loss` and `collisions`; problems were found before."""
    if table.loss is not None and not isinstance(table.loss, NoLoss | LogLoss):
        yield _LAWS[type(table.loss)](table.loss)
    if table.collisions is not None:
        yield _collisions(table.collisions)


def earlier_run(table: LinkTable) -> tuple[Effect, ...]:
    """Give the effects that take the place of all others: loss and delay of an earlier run."""
    if not isinstance(table.loss, LogLoss):
        return ()
    law = _earlier_run(table.loss, round(table.latency_ms * MILLISECOND))
    return law, law.recorded_delay


def loss_problems(table: LinkTable) -> Iterator[tuple[str, str]]:
    """Give every key of a link's law of loss that does not fit the others, as `loss.file`."""
    parts: tuple[tuple[str, Callable[[], object]], ...] = (
        ("loss", lambda: [*loss_effects(table.model_copy(update={"collisions": None}))]),
        ("loss", lambda: earlier_run(table)),
        ("collisions", lambda: table.collisions and _collisions(table.collisions)),
    )
    for name, build in parts:
        try:
            build()
        except _Unfit as unfit:
            yield f"{name}.{unfit.key}", unfit.why


def _needed(table: Any, key: str, why: str = "") -> Any:
    """Value of a key that must not be left out."""
    value = getattr(table, key)
    if value is None:
        raise _Unfit(key, f"missing{why}")
    return value


def _gilbert_elliott(table: GilbertElliottLoss) -> Effect:
    by_burst = {"loss_ratio", "burst_messages_mean"}
    given = {key for key in type(table).model_fields if getattr(table, key) is not None} - {"kind"}
    if given & by_burst and given - by_burst:
        key = min(given - by_burst)
        raise _Unfit(
            key, f"given together with {min(given & by_burst)}, allowed chances or mean values"
        )
    if given & by_burst:
        loss, burst = _needed(table, "loss_ratio"), _needed(table, "burst_messages_mean")
        if loss == 1.0 or burst < loss / (1.0 - loss):
            least = f"at least {loss / (1.0 - loss):g}" if loss < 1.0 else "a loss below 1"
            raise _Unfit(
                "burst_messages_mean", f"given {burst:g} with a loss of {loss:g}, allowed {least}"
            )
        return _forgetting("burst_messages_mean", GilbertElliott.of_bursts, loss, burst)
    p, r = _needed(table, "good_to_bad_ratio"), _needed(table, "bad_to_good_ratio")
    h = 0.0 if table.bad_delivered_ratio is None else table.bad_delivered_ratio
    k = 1.0 if table.good_delivered_ratio is None else table.good_delivered_ratio
    return _forgetting("bad_to_good_ratio", GilbertElliott, p, r, h, k)


def _four_state(table: FourStateLoss) -> Effect:
    p13, p31 = _needed(table, "gap_to_burst_ratio"), _needed(table, "burst_to_gap_ratio")
    p32, p23, p14 = table.lost_to_sent_ratio, table.sent_to_lost_ratio, table.isolated_loss_ratio
    if p13 + p14 > 1.0:
        allowed = f"at most {1.0 - p13:g}, for gap_to_burst_ratio is {p13:g}"
        raise _Unfit("isolated_loss_ratio", f"given {p14:g}, allowed {allowed}")
    if p31 + p32 > 1.0:
        allowed = f"at most {1.0 - p31:g}, for burst_to_gap_ratio is {p31:g}"
        raise _Unfit("lost_to_sent_ratio", f"given {p32:g}, allowed {allowed}")
    return _forgetting("burst_to_gap_ratio", FourState, p13, p31, p32, p23, p14)


def _forgetting(key: str, law: Callable[..., Effect], *chances: float) -> Effect:
    """Build a chain, or say that it has no stationary state that can be found."""
    try:
        return law(*chances)
    except ValueError as error:
        value = ", ".join(f"{one:g}" for one in chances)
        raise _Unfit(
            key,
            f"given {value}, {error}; allowed a chain that does within 10000 messages on average, "
            "and does not go round in a circle",
        ) from error


def _every_nth(table: EveryNthLoss) -> Effect:
    return EveryNth(_needed(table, "every_messages"), table.first_number)


def _listed(table: ListedLoss) -> Effect:
    _needed(table, "lost_numbers")
    return Listed(_numbers("lost_numbers", table.lost_numbers or ""))


def _pattern(table: PatternLoss) -> Effect:
    if table.file is not None and table.length_messages is not None:
        raise _Unfit("file", "given together with length_messages, allowed a file or its contents")
    if table.file is not None:
        return RecordedPattern(Numbers(()), 1, table.after_end)  # not read yet
    length = _needed(table, "length_messages", ", needed without file")
    lost = _numbers("lost_numbers", table.lost_numbers or "")
    if lost.ranges and lost.ranges[-1][1] >= length:
        allowed = f"numbers below length_messages, {length}"
        raise _Unfit("lost_numbers", f"given {lost.ranges[-1][1]}, allowed {allowed}")
    return RecordedPattern(lost, length, table.after_end)


def _earlier_run(table: LogLoss, latency: int) -> EarlierRun:
    if table.file is not None and table.delays_ns is not None:
        raise _Unfit("file", "given together with delays_ns, allowed a log or its contents")
    if table.file is not None:
        return EarlierRun((), ((0, 1),), table.after_end, latency)  # not read yet
    delays = _delays(_needed(table, "delays_ns", ", needed without file"))
    dropped = tuple(
        (known_reason(word), _numbers(f"dropped_numbers.{word}", numbers))
        for word, numbers in table.dropped_numbers.items()
    )
    return EarlierRun(dropped, delays, table.after_end, latency)


def _numbers(key: str, text: str) -> Numbers:
    try:
        return Numbers.read(text)
    except ValueError as error:
        raise _Unfit(key, f"given {str(error)[:200]}") from error


def _delays(text: str) -> tuple[tuple[int, int], ...]:
    found = []
    for part in text.split(","):
        pair = re.fullmatch(
            rf"\s*(\d{{1,{LARGEST_DELAY_DIGITS}}})(?:x([1-9]\d{{0,8}}))?\s*", part, re.ASCII
        )
        if pair is None:
            allowed = 'delays and how many messages had them, such as "20000000x700, 23000000"'
            raise _Unfit("delays_ns", f"given {shown(part)}, allowed {allowed}")
        found.append((int(pair[1]), int(pair[2] or 1)))
    return tuple(found)


def _collisions(table: CollisionsTable) -> Effect:
    loss = _needed(table, "loss_ratio")
    least, most = table.reselection_messages_min, table.reselection_messages_max
    if most < least:
        allowed = f"at least reselection_messages_min, {least}"
        raise _Unfit("reselection_messages_max", f"given {most}, allowed {allowed}")
    return Collisions(loss, table.keep_ratio, least, most)


_LAWS = cast(
    "dict[type[object], Callable[[Any], Effect]]",
    {
        GilbertElliottLoss: _gilbert_elliott,
        FourStateLoss: _four_state,
        EveryNthLoss: _every_nth,
        ListedLoss: _listed,
        PatternLoss: _pattern,
    },
)
