"""Thresholds of degradation, and levels of braking; SI units."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from vehicles.setting import Setting

Reaction = Literal["degrade", "extrapolate", "hold", "straight"]
"""Reaction of a follower without data.

degrade      drive on by what was received, brake where evidence requires it, and stop
extrapolate  continue along the last trajectory at full speed
hold         keep the last steering command, at full speed
straight     turn the wheels straight, at full speed, as one production system does
"""

PredecessorPath = Literal["intended", "driven"]
"""Path that the samples of the predecessor represent.

intended  the lead's path, reconstructed from the offset that the predecessor announces
driven    the predecessor's own path, with its errors, which add up along the convoy
"""


@dataclass(frozen=True, slots=True)
class Braking:
    """Deceleration (m/s², positive) and the jerk (m/s³) at which it builds up."""

    deceleration: float
    jerk: float


@dataclass(frozen=True, kw_only=True)
class DegradationSettings:
    """Thresholds of degradation and braking levels (s, m/s²; beyond the paper).

    The shortest silence of a lost source follows openpilot, the gates follow PX4's EKF2.
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
    late_periods: Annotated[
        float,
        Setting("a source is late after this number of periods without a message", "", 1, 1000),
    ] = 3.0
    lost_periods: Annotated[
        float,
        Setting(
            "a source without usual losses is lost after max(lost_periods × period, lost_s) "
            "without a message",
            minimum=1,
            maximum=1000,
        ),
    ] = 10.0
    lost_after: Annotated[
        float, Setting("shortest silence after which a source is lost", "s", 0.01, 60, name="lost")
    ] = 0.5
    lost_after_max: Annotated[
        float,
        Setting(
            "longest silence after which a source with usual losses is lost",
            unit="s",
            minimum=0.01,
            maximum=60,
            name="lost_max",
        ),
    ] = 1.5
    probation: Annotated[
        float, Setting("time of reception after which a lost source is relied on", "s", 0.1, 60)
    ] = 0.5
    gate: Annotated[
        float,
        Setting(
            "largest deviation of a position or heading from the expected one, in deviations",
            unit="deviations",
            minimum=1,
            maximum=1000,
        ),
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
        Setting(
            "the car drives slower while the standard deviation of its own lateral position is "
            "larger than this; three of the default are 0.3 m",
            unit="m",
            minimum=0,
            maximum=1000,
        ),
    ] = 0.1
    comfortable_deceleration: Annotated[
        float,
        Setting(
            "comfortable braking; harder braking requires evidence",
            "mps2",
            0.1,
            12,
            name="comfortable",
        ),
    ] = 1.5
    comfortable_jerk: Annotated[
        float, Setting("jerk of comfortable braking", "mps3", 0.05, 100)
    ] = 0.3
    firm_deceleration: Annotated[
        float,
        Setting(
            "braking required behind the vehicle ahead from which the law is overridden",
            unit="mps2",
            minimum=0.1,
            maximum=12,
            name="firm",
        ),
    ] = 3.0
    emergency_deceleration: Annotated[
        float,
        Setting(
            "braking of a car that receives nothing, to stop within its known path",
            unit="mps2",
            minimum=0.1,
            maximum=12,
            name="emergency",
        ),
    ] = 6.0
    emergency_jerk: Annotated[float, Setting("jerk of emergency braking", "mps3", 0.05, 1000)] = (
        12.0
    )

    @cached_property
    def comfortable(self) -> Braking:
        return Braking(self.comfortable_deceleration, self.comfortable_jerk)

    @cached_property
    def firm(self) -> Braking:
        return Braking(self.firm_deceleration, self.emergency_jerk)

    @cached_property
    def emergency(self) -> Braking:
        return Braking(self.emergency_deceleration, self.emergency_jerk)

    def lost_after_silence(self, period: float) -> float:
        """Silence (s) after which a source with this `period` (s) and no losses is lost."""
        return max(self.lost_after, self.lost_periods * period)


# ---- Random numbers of the classes that decide in a vehicle, keyed by the control instant


Numbers = Callable[[str, int], float]  # By purpose and time (ns) after the start, in (0, 1)


class InstantDraw:
    """Random numbers of one vehicle at the control instant `now` (ns).

    A number depends on the source of `numbers`, the class, the purpose and the time since the start
    of the run, `start_at` (ns), only, not on other draws. So a decision can be computed alone, and
    again.
    """

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.now = self.start_at = 0

    def of(self, point: str) -> Callable[[str], float]:
        """Draws of the class at a plug-in point: the number in (0, 1) of a purpose."""

        def draw(purpose: str) -> float:
            return self.numbers(f"{point} {purpose}", self.now - self.start_at)

        return draw
