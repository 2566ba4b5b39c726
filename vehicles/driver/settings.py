"""Thresholds of degradation, and levels of braking; SI units."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from vehicles.setting import Setting

Reaction = Literal["degrade", "extrapolate", "hold", "straight"]
PredecessorPath = Literal["intended", "driven"]

LOST_PERIODS = 10.0  # A source without usual losses is lost after this number of periods
COMFORTABLE_JERK = 0.3  # Jerk (m/s³) with which a lead slows down to wait


@dataclass(frozen=True, slots=True)
class Braking:
    """Deceleration (m/s², positive) and the jerk (m/s³) at which it builds up."""

    deceleration: float
    jerk: float


@dataclass(frozen=True, kw_only=True)
class DegradationSettings:
    """Thresholds of degradation and braking levels (s, m/s²; beyond the paper).

    The shortest silence of a lost source follows openpilot, the gate follows PX4's EKF2.
    Comfortable braking is the upper end of what passengers accept (Hoberock, "A survey of
    longitudinal acceleration comfort studies in ground transportation vehicles", 1977), emergency
    braking is hard braking on a dry road, as in [speed.gap].
    """

    reaction: Annotated[
        Reaction,
        Setting(
            'reaction without data. "degrade": drive on by what was received, brake where evidence '
            'requires it, and stop. Baselines at full speed: "extrapolate" the last trajectory, '
            '"hold" the last steering command, or turn the wheels "straight"'
        ),
    ] = "degrade"
    lost_after: Annotated[
        float, Setting("shortest silence after which a source is lost", "s", 0.01, 60, name="lost")
    ] = 0.5
    lost_after_max: Annotated[
        float,
        Setting("longest silence of a source with usual losses", "s", 0.01, 60, name="lost_max"),
    ] = 1.5
    probation: Annotated[
        float, Setting("time of reception after which a lost source is used again", "s", 0.1, 60)
    ] = 0.5
    gate: Annotated[
        float,
        Setting("largest plausible error of a position or heading", "deviations", 1, 1000),
    ] = 5.0
    predecessor_path: Annotated[
        PredecessorPath,
        Setting(
            'path of the samples of the predecessor. "intended": path of the lead, reconstructed '
            'from the offset that the predecessor announces. "driven": the path of the predecessor'
        ),
    ] = "intended"
    lateral_deviation_max: Annotated[
        float,
        Setting("deviation of the own lateral position above which it slows down", "m", 0, 1000),
    ] = 0.1
    comfortable_deceleration: Annotated[
        float, Setting("braking without evidence", "mps2", 0.1, 12, name="comfortable")
    ] = 1.5
    firm_deceleration: Annotated[
        float, Setting("required braking that overrides the law", "mps2", 0.1, 12, name="firm")
    ] = 3.0
    emergency_deceleration: Annotated[
        float, Setting("braking of a car that receives nothing", "mps2", 0.1, 12, name="emergency")
    ] = 6.0
    emergency_jerk: Annotated[float, Setting("jerk of emergency braking", "mps3", 0.05, 1000)] = (
        12.0
    )

    @property
    def comfortable(self) -> Braking:
        return Braking(self.comfortable_deceleration, COMFORTABLE_JERK)

    @cached_property
    def emergency(self) -> Braking:
        return Braking(self.emergency_deceleration, self.emergency_jerk)

    def lost_after_silence(self, period: float) -> float:
        """Silence (s) after which a source with this `period` (s) and no losses is lost."""
        return max(self.lost_after, LOST_PERIODS * period)
