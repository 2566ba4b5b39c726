"""Spacing to keep between centres of mass, and limits of the acceleration; SI units."""

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class SpacingPolicy:
    """The spacing to keep (m): `standstill` (m) plus `headway` (s) times speed.

    Constant time headway policy; a headway of 0 keeps a constant distance. To a vehicle behind,
    spacings are negative.
    """

    standstill: float
    headway: float = 0.0

    def __post_init__(self) -> None:
        behind = self.standstill < 0.0
        _require_not_negative("standstill", -self.standstill if behind else self.standstill)
        _require_not_negative("headway", -self.headway if behind else self.headway)

    def desired(self, speed: float) -> float:
        return self.standstill + self.headway * speed


@dataclass(frozen=True, slots=True)
class GapLimits:
    """Limits of acceleration and braking (m/s²) for the constant time headway policy.

    Both are positive. 2 m/s² is brisk driving; 6 m/s² is hard braking on a dry road with some grip
    in reserve, twice the braking of a lead, so that followers can compensate their delay. `lateral`
    (m/s²) is the largest lateral acceleration in bends, infinite for no limit; `before_bends` is
    the braking before bends of the known path.
    """

    acceleration: float = 2.0
    deceleration: float = 6.0
    lateral: float = math.inf
    before_bends: float = 2.5

    def __post_init__(self) -> None:
        for each in fields(self):
            _require_not_negative(each.name, getattr(self, each.name))


def _require_not_negative(name: str, value: float) -> None:
    if not (value >= 0.0 and (math.isfinite(value) or name == "lateral")):
        raise ValueError(f"{name} must be a number of at least 0, not {value}")
