"""Interface of a longitudinal controller, and its inputs; SI units.

A gap is between bumpers; a *spacing*, by which it is kept, is between centres of mass.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from math import inf, nan
from typing import Protocol

from vehicles.car.parameters import LINCOLN_MKZ, VehicleParameters

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
class SourceMotion:
    """Motion of a received vehicle in its newest pose.

    spacing       arc length (m) along its path from the car's present position to that pose,
                  negative for a vehicle behind
    speed         speed (m/s)
    acceleration  announced command (m/s²)
    age           time since the measurement (s)
    relied_on     whether a follower that degrades relies on it; None of another reaction, with
                  which a law decides by the age
    """

    spacing: float = nan
    speed: float = nan
    acceleration: float = 0.0
    age: float = nan
    relied_on: bool | None = None


@dataclass(slots=True)
class VehiclesAhead:
    """Motion of the vehicles ahead, and of those behind; NaN where nothing was received.

    The first five are predicted to the present by achieved and commanded accelerations
    (`vehicles.driver.situation.predicted_motion`). Those of the lead are NaN unless it is a
    longitudinal source ([information_flow]).

    spacing                   arc length to the predecessor (m)
    predecessor_speed         m/s
    lead_speed                m/s
    predecessor_acceleration  m/s²
    lead_acceleration         m/s²
    curvature_ahead           maps a distance ahead (m) to the curvature of the path (1/m), which is
                              extrapolated beyond the known path
    bend                      largest acceleration (m/s²) before and in bends of the received path
    own                       `OwnMotion`
    sources                   `SourceMotion` of each longitudinal source by its name, once received
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
    sources: Mapping[str, SourceMotion] = field(default_factory=dict)
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
    `Class(setup)`, followed by its `settings` if it has any; `setup` is a `LongitudinalSetup`. A
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
