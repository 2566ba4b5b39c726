"""Thresholds of degradation, and the ways of braking; SI units."""

from dataclasses import dataclass
from typing import Literal

Reaction = Literal["degrade", "extrapolate", "hold", "straight"]
"""What a follower does when it hears nobody any more.

degrade      slows down while it knows the road, and stops
extrapolate  goes on along its last trajectory at full speed
hold         keeps its last steering command, at full speed
straight     turns its wheels straight, at full speed, as one production system does
"""
PredecessorPath = Literal["meant", "driven"]
"""What a follower that hears its predecessor alone follows of it.

meant    the lead's path, as far as the predecessor says how far off it is
driven   the way that it drove, with its errors, which add up along the convoy
"""


@dataclass(frozen=True, slots=True)
class Braking:
    """A way of braking: deceleration (m/s², positive) and the jerk (m/s³) at which it builds up.

    As planners state it (Autoware).
    """

    deceleration: float
    jerk: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DegradationSettings:
    """When a source counts as late, lost and found again, and how the car slows down (s, m/s²).

    Beyond the paper, whose followers trust in whatever they heard last.

    A source is late after `late_periods` expected periods without a message, lost after
    `lost_periods` or `lost_after`, whichever is longer (openpilot: 10 periods). It is relied on
    again once `trusted_share` of what it usually delivers was received over `probation`, which
    doubles with each relapse up to `probation_max` and halves again after each `forgiven_after`
    without one (PX4's estimator: the time grows while failing and shrinks while passing). What a
    source says is not believed beyond `gate` standard deviations of its position, `heading_gate` of
    its heading (PX4's EKF2: 5 and 2.6). Of a predecessor that it hears alone it follows
    `predecessor_path`, which it comes to within `probation`. `comfortable` and `firm` are
    Autoware's comfortable and emergency stops, `hardest` what a stop may take where less does not
    suffice.
    """

    reaction: Reaction = "degrade"
    late_periods: float = 3.0
    lost_periods: float = 10.0
    lost_after: float = 0.5
    trusted_share: float = 0.9
    probation: float = 1.0
    probation_max: float = 16.0
    forgiven_after: float = 10.0
    gate: float = 5.0
    heading_gate: float = 3.0
    predecessor_path: PredecessorPath = "meant"
    comfortable: Braking = Braking(1.0, 0.3)
    firm: Braking = Braking(2.5, 1.5)
    hardest: Braking = Braking(6.0, 12.0)

    def lost_after_silence(self, period: float) -> float:
        """Silence (s) after which a source of such a `period` (s) is lost."""
        silence, least = self.lost_periods * period, self.lost_after
        return least if least > silence else silence
