"""Laws of loss and of delay as plug-ins."""

from collections.abc import Callable
from typing import Any, TypeVar, get_args

from scenarios.definition.schema.plug_ins.point import PlugInError, PlugInPoint, called, dotted_name
from transport.links.laws.burst_losses import BaseLoss
from transport.links.laws.delays import BaseDelay
from transport.links.laws.link_law import (
    Delays,
    Draw,
    Effect,
    LinkLaw,
    LinkSetting,
    Losses,
    Position,
    TransmissionContext,
)
from transport.links.laws.registry import DelayLaw, LossLaw
from transport.links.link import keyed_draw
from transport.topics import REASONS, DropReason
from vehicles.schedule import MILLISECOND

T = TypeVar("T")
TRIAL_MESSAGES = 20
"""Number of messages that are judged before a run."""
PERIOD = 50 * MILLISECOND


class GuardedEffect(Effect):
    """Wraps the effect of a user's law, and converts its faults to PlugInError."""

    __slots__ = ("_effect", "_what", "by_number", "key", "reason")

    def __init__(self, effect: Effect, name: str) -> None:
        self._effect = effect
        self._what = f"law {name!r}"
        self.key = effect.key  # type: ignore[misc]
        self.reason = effect.reason  # type: ignore[misc]
        self.by_number = effect.by_number  # type: ignore[misc]

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        what = f"{self._what}: judge()"
        result: object = called(lambda: self._effect.judge(draw, context), what)
        is_delay = isinstance(result, int) and not isinstance(result, bool) and result >= 0
        if is_delay or (isinstance(result, str) and result in REASONS and REASONS[result].is_drop):
            return result  # type: ignore[return-value]
        raise PlugInError(
            f"{what} returned {result!r}, expected a whole number of ns of at least 0, or the "
            'reason of a drop, such as "loss"'
        )

    def losses(self, distance_m: float | None) -> Losses | None:
        return self._called(lambda: self._effect.losses(distance_m), "losses")

    @property
    def delays(self) -> Delays | None:
        return self._called(lambda: self._effect.delays, "delays")

    def _called(self, call: Callable[[], T], method: str) -> T:
        return called(call, f"{self._what}: {method}")


def effects_of(law: LinkLaw, setting: LinkSetting) -> tuple[Effect, ...]:
    """Effects of a law on a link; those of a user's law are guarded."""
    use: str = getattr(law, "use", "")
    if not use:
        return law.effects(setting)
    effects = called(lambda: law.effects(setting), f"law {use!r}: effects()")
    return tuple(GuardedEffect(effect, use) for effect in effects)


def try_law(law: LinkLaw, setting: LinkSetting) -> list[list[int | DropReason]]:
    """Judge messages in order, and again in reverse order with another copy; raises PlugInError."""
    draw = keyed_draw(1, "sender", "receiver")
    contexts = [
        TransmissionContext(
            seq=seq,
            sent_at=setting.start_at + seq * PERIOD,
            size=200,
            sender=Position(1.0 * seq, 0.0, 1.0 * seq),
            receiver=Position(1.0 * seq - 20.0, 0.0, 1.0 * seq),
        )
        for seq in range(TRIAL_MESSAGES)
    ]
    verdicts = []
    for order in (1, -1):
        effects = effects_of(law, setting)
        for effect in effects:
            effect.losses(None)
            _ = effect.delays
        judged = [[effect.judge(draw, one) for effect in effects] for one in contexts[::order]]
        verdicts.append(judged[::order])
    if verdicts[0] != verdicts[1]:
        raise PlugInError(
            f"law {getattr(law, 'use', '')!r}: judge() has other verdicts if messages come in "
            "another order: it must depend on draw and context only"
        )
    return verdicts[0]


def _shipped(laws: Any) -> dict[str, str]:
    """Dotted names of the laws of a union by their kinds."""
    union = get_args(get_args(laws)[0])
    return {law.model_fields["kind"].default: dotted_name(law) for law in union}


_METHODS = {"judge": "draw, context"}

LOSS = PlugInPoint(
    name="law",
    title="law of loss",
    key="links.loss",
    shipped=_shipped(LossLaw),
    contract=BaseLoss,
    methods=_METHODS,
    types=(TransmissionContext, Position),
    base=LinkLaw,
    trial=try_law,
)
DELAY = PlugInPoint(
    name="law",
    title="law of delay",
    key="links.delay",
    shipped=_shipped(DelayLaw),
    contract=BaseDelay,
    methods=_METHODS,
    types=(),
    base=BaseDelay,
    trial=try_law,
)
