"""False contents of a link in an interval."""

from dataclasses import asdict
from math import inf
from typing import TypeVar

from tests.made.scenarios.messages import START
from transport.links.laws.content import (
    FalseContent,
    FalseDrift,
    FalseInterval,
    FalseOffset,
    FrozenContent,
    GhostVehicle,
    ReplayedContent,
    Shift,
)
from transport.links.laws.link_law import LinkSetting
from vehicles.schedule import SECOND

Content = TypeVar("Content", bound=FalseContent)


def _in(spell: FalseInterval, law: type[Content], rate_hz: float = 20.0, **keys: float) -> Content:
    start_at = START if spell.from_at >= START else 0
    to_s = None if spell.to_at == inf else (spell.to_at - start_at) / SECOND
    keys |= {"from_s": max((spell.from_at - start_at) / SECOND, 1e-9)}
    made = law.model_validate({**keys, "to_s": to_s})
    return made.for_link(LinkSetting(start_at=start_at, source_rate_hz=rate_hz))


def offset(spell: FalseInterval, by: Shift) -> FalseOffset:
    """Displaced by a constant (m)."""
    return _in(spell, FalseOffset, **{f"{key}_m": value for key, value in asdict(by).items()})


def drift(spell: FalseInterval, rate: Shift) -> FalseDrift:
    """Displaced at a rate (m/s)."""
    return _in(spell, FalseDrift, **{f"{key}_mps": value for key, value in asdict(rate).items()})


def frozen(spell: FalseInterval) -> FrozenContent:
    return _in(spell, FrozenContent)


def replayed(spell: FalseInterval, age: int) -> ReplayedContent:
    """Repeats messages that are `age` ns old."""
    return _in(spell, ReplayedContent, age_s=age / SECOND)


def ghost(spell: FalseInterval, at: Shift, after: int = SECOND // 40) -> GhostVehicle:
    """A ghost vehicle, `after` ns later."""
    rate_hz = SECOND / (2.0 * after)
    return _in(spell, GhostVehicle, rate_hz, ahead_m=at.ahead, left_m=at.left)
