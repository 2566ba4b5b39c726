"""Interface of a longitudinal controller, and its inputs; SI units.

A gap is measured between bumpers, a *spacing* between centres of mass.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from math import inf, nan
from typing import Final, NamedTuple, Protocol

from vehicles.car.parameters import LINCOLN_MKZ, VehicleParameters
from vehicles.messages import Mode, SourceStatus

# ---- Spacing to keep between centres of mass, and limits of the acceleration; SI units


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


# ---- Motion of a received vehicle


RELIED_ON: tuple[SourceStatus, ...] = ("fresh", "late")
PREDICTED_FOR: Final = 0.5  # Time (s) for which an announced acceleration is assumed to last
LASTING: Final = -2.5
"""Harder announced braking (m/s²) is assumed to last to a standstill: it rarely ends sooner."""
OVERDUE_AFTER: Final = 1.5  # Periods after which a message is missing
FADES_FROM: Final = 0.3
FADES_FOR: Final = 0.5
"""Age (s) from which an announced acceleration fades as a feedforward, and the time (s) taken."""


class PredictedMotion(NamedTuple):
    """Distance driven (m) since a sample, present speed (m/s) and commanded acceleration (m/s²)."""

    driven: float
    speed: float
    acceleration: float


def predicted_motion(  # noqa: PLR0917 - a state
    speed: float,
    achieved: float,
    command: float,
    age: float,
    lag: float,
    lasting: float = LASTING,
) -> PredictedMotion:
    """Predict a vehicle `age` (s) after a sample of its speed, achieved and commanded acceleration.

    The acceleration a approaches the command u with the drive lag τ (s), τ da/dt = u - a, for
    s = min(age, `PREDICTED_FOR`), then the speed is constant. With k = τ (1 - exp(-s/τ)):
    v(s) = v + u s + (a - u) k and x(s) = v s + u s²/2 + (a - u) τ (s - k). A vehicle that stands
    remains so. The returned command fades (`FADES_FROM`). Braking harder than `lasting` (m/s²)
    neither ends nor fades.
    """
    lasts = command < lasting
    span = age if lasts or age < PREDICTED_FOR else PREDICTED_FOR
    rest = achieved - command
    built = lag * (1.0 - math.exp(-span / lag)) if lag > 0.0 else 0.0
    after = speed + command * span + rest * built
    if after <= 0.0:
        stopped = speed * speed / max(-2.0 * min(command, achieved), 0.1)
        return PredictedMotion(stopped, 0.0, 0.0)
    driven = speed * span + 0.5 * command * span * span + rest * lag * (span - built)
    driven += after * (age - span)
    if not lasts and age > FADES_FROM:
        left = 1.0 - (age - FADES_FROM) / FADES_FOR
        command *= left if left > 0.0 else 0.0
    return PredictedMotion(driven, after, command)


@dataclass(slots=True)
class SourceState:
    """State of one source at the last control instant; it is updated in place.

    `age` (s) is the time since the newest sample was measured, `silence` (s) since it was received,
    `usual_silence` (s) the longest recent one, `period` (s) the time between messages, `share` the
    received ratio of the last ten seconds. Its path is known up to `known` (m) ahead of the car,
    negative if it ends behind. It is lost at `lost_at` (ns) unless it is received again. `mode`,
    `hazard`, `acceleration` (m/s², commanded), `achieved` (m/s²), `leaving` and `stops_at` (ns, 0
    for never) are those announced last, or a later `stops_at` relayed by the lead. Of the newest
    sample, `measured_at` (ns) is its instant, `speed` (m/s) its speed and `spacing` (m) how far
    ahead of the car it is along the path, negative behind. `lag` (s) is the assumed drive lag.
    """

    status: SourceStatus = "unheard"
    age: float = nan
    silence: float = nan
    usual_silence: float = 0.0
    period: float = nan
    share: float = nan
    known: float = nan
    mode: Mode = "path"
    hazard: bool = False
    acceleration: float = 0.0
    achieved: float = 0.0
    leaving: bool = False
    lost_at: int = 0
    stops_at: int = 0
    speed: float = nan
    measured_at: int = 0
    spacing: float = nan
    lag: float = 0.0

    @property
    def is_overdue(self) -> bool:
        """Whether a message is missing."""
        return self.silence > OVERDUE_AFTER * self.period

    @property
    def is_silent(self) -> bool:
        """Whether messages are missing for longer than usual."""
        return self.is_overdue and self.silence > self.usual_silence

    def predicted(self) -> PredictedMotion:
        """Motion predicted to now (see `predicted_motion`)."""
        return predicted_motion(self.speed, self.achieved, self.acceleration, self.age, self.lag)


# ---- Controller


@dataclass(slots=True)
class OwnMotion:
    """Motion of the car itself.

    step          time since the last control instant (s); 0 at the first one
    acceleration  last command (m/s²), after all limits
    achieved      acceleration (m/s²) that the drive has reached by its assumed lag
    """

    step: float = 0.0
    acceleration: float = 0.0
    achieved: float = 0.0


@dataclass(slots=True)
class VehiclesAhead:
    """Motion of the vehicles ahead, and of those behind; NaN where nothing was received.

    The first five are predicted to the present (`predicted_motion`). Those of the lead are NaN
    unless it is a longitudinal source ([information_flow]).

    spacing                   arc length to the predecessor (m)
    predecessor_speed         m/s
    lead_speed                m/s
    predecessor_acceleration  m/s²
    lead_acceleration         m/s²
    curvature_ahead           maps a distance ahead (m) to the curvature of the path (1/m), which is
                              extrapolated beyond the known path
    bend                      largest acceleration (m/s²) before and in bends of the received path
    own                       `OwnMotion`
    sources                   `SourceState` of each longitudinal source by its name, once received
    measured_gap              gap by the on-board sensor (m), predicted to the present by its rate
    measured_gap_rate         its rate (m/s)
    """

    spacing: float = nan
    predecessor_speed: float = nan
    lead_speed: float = nan
    predecessor_acceleration: float = 0.0
    lead_acceleration: float = nan
    curvature_ahead: Callable[[float], float] | None = None
    bend: float = inf
    own: OwnMotion = field(default_factory=OwnMotion)
    sources: dict[str, SourceState] = field(default_factory=dict)
    measured_gap: float = nan
    measured_gap_rate: float = nan


@dataclass(frozen=True, slots=True)
class LongitudinalSetup:
    """Constants of a follower for its longitudinal controller.

    policy         `SpacingPolicy` of [speed.gap]: `desired(speed)` is the spacing to keep (m)
    limits         `GapLimits` of [speed.gap], to which commands are limited
    least_spacing  spacing (m) to the predecessor at which the bumpers touch: gap = spacing minus it
    period         control period (s)
    desired_speed  highest speed (m/s) that is planned for the lead
    parameters     `VehicleParameters` assumed of the car
    lead           name of the lead
    predecessor    name of the predecessor
    initial_spacing  spacing (m) to the predecessor at the start
    catch_up_ratio  largest speed over the lead's
    policies       `SpacingPolicy` to each longitudinal source by its name; to the predecessor,
                   `policy`, and negative to vehicles behind
    """

    policy: SpacingPolicy
    limits: GapLimits
    least_spacing: float = 0.0
    period: float = 0.02
    desired_speed: float = inf
    parameters: VehicleParameters = LINCOLN_MKZ
    lead: str = ""
    predecessor: str = ""
    initial_spacing: float = nan
    catch_up_ratio: float = 1.1
    policies: Mapping[str, SpacingPolicy] = field(default_factory=dict)


class LongitudinalController(Protocol):
    """Interface of the longitudinal controller of a follower, shipped or user-defined.

    Each follower with `speed.followers = "gap"` has its own instance, constructed as
    `Class(setup)`, followed by its parameters; `setup` is a `LongitudinalSetup`. A
    class with `needs_predecessor = True` is refused where the predecessor is not a longitudinal
    source.

    A controller must not keep state between calls or use a clock. A law with a derivative of its
    command continues from `ahead.own.acceleration`, over `ahead.own.step`.

    The command is limited to [speed.gap] and to bends. With `reaction = "degrade"` the follower
    overrides it where evidence requires other braking (see `Command.override`). It is not called
    before the first pose of the predecessor, or of any source if the predecessor is not received:
    until then the car keeps its speed. A class with `needs_poses = False` is also called without
    poses while the on-board sensor measures the gap.
    """

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        """Commanded acceleration (m/s²) at `speed` (m/s), behind the `VehiclesAhead`."""
        ...
