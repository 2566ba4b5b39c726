"""Interface of a longitudinal controller, and its inputs; SI units.

A gap is between bumpers; a *spacing*, by which it is kept, is between centres of mass.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Protocol

from vehicles.car.parameters import LINCOLN_MKZ, VehicleParameters
from vehicles.driver.longitudinal.spacing import GapLimits, SpacingPolicy


@dataclass(slots=True)
class OwnMotion:
    """Motion of the car itself.

    step          time since the last control instant (s); 0 at the first one
    acceleration  last command (m/s²), after all limits
    distance      distance driven (m), by the estimated speed
    achieved      acceleration (m/s²) that the drive has reached by its assumed lag
    """

    step: float = 0.0
    acceleration: float = 0.0
    distance: float = 0.0
    achieved: float = 0.0


@dataclass(slots=True)
class SourceMotion:
    """Motion of a received vehicle in its newest pose.

    spacing       arc length (m) along its path from the car's present position to that pose,
                  negative for a vehicle behind
    speed         speed (m/s)
    acceleration  announced command (m/s²)
    age           time since the measurement (s)
    """

    spacing: float = nan
    speed: float = nan
    acceleration: float = 0.0
    age: float = nan


@dataclass(slots=True)
class VehiclesAhead:
    """Motion of the vehicles ahead, and of those behind; NaN where nothing was received.

    The first five are predicted to the present by the last announced accelerations; while messages
    are missing, a follower that degrades alters them and the spacings of the sources to open its
    gap. Those of the lead are NaN unless it is a longitudinal source ([information_flow]).

    spacing                   arc length to the predecessor (m)
    predecessor_speed         m/s
    lead_speed                m/s
    predecessor_acceleration  m/s²
    lead_acceleration         m/s²
    curvature_ahead           maps a distance ahead (m) to the curvature of the path (1/m)
    bend                      squared speed (m²/s²) that the received path allows, and the distance
                              of its bend (m), if any
    own                       `OwnMotion`
    sources                   `SourceMotion` of each longitudinal source by its name, once received
    measured_gap              gap by the on-board sensor (m), predicted to the present by its rate
    measured_gap_rate         its rate (m/s)
    measured_gap_age          time since the measurement (s)
    """

    spacing: float = nan
    predecessor_speed: float = nan
    lead_speed: float = nan
    predecessor_acceleration: float = 0.0
    lead_acceleration: float = nan
    curvature_ahead: Callable[[float], float] | None = None
    bend: tuple[float, float] | None = None
    own: OwnMotion = field(default_factory=OwnMotion)
    sources: Mapping[str, SourceMotion] = field(default_factory=dict)
    measured_gap: float = nan
    measured_gap_rate: float = nan
    measured_gap_age: float = nan

    def replaced(
        self, spacing: float, lead_speed: float, lead_acceleration: float
    ) -> "VehiclesAhead":
        """Copy with another spacing and motion of the lead; `replace` costs 1 % of a tick.

        The spacings to all sources change as that to the predecessor.
        """
        sources, wider = self.sources, self.spacing - spacing
        if wider:  # also NaN, without the predecessor
            sources = {
                name: SourceMotion(one.spacing - wider, one.speed, one.acceleration, one.age)
                for name, one in sources.items()
            }
        return VehiclesAhead(
            spacing,
            self.predecessor_speed,
            lead_speed,
            self.predecessor_acceleration,
            lead_acceleration,
            self.curvature_ahead,
            self.bend,
            self.own,
            sources,
            self.measured_gap,
            self.measured_gap_rate,
            self.measured_gap_age,
        )


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
    policies: Mapping[str, SpacingPolicy] = field(default_factory=dict)


class LongitudinalController(Protocol):
    """Interface of the longitudinal controller of a follower, shipped or user-defined.

    Each follower with `speed.followers = "gap"` has its own instance, constructed as
    `Class(setup)`, followed by its `settings` if it has any; `setup` is a `LongitudinalSetup`. A
    class with `needs_predecessor = True` is refused where the predecessor is not a longitudinal
    source.

    A controller must not keep state between calls or use a clock: it is called up to 3 times per
    control instant, with the measured and with altered spacings. A law with a
    derivative of its command continues from `ahead.own.acceleration`, over `ahead.own.step`.

    The command is limited to [speed.gap] and to bends. With `reaction = "degrade"` the follower
    also keeps the safe distance while messages are missing. It is not called before the first pose
    of the predecessor, or of any source if the predecessor is not received: until then the car
    keeps its speed. A class with `needs_poses = False` is also called without poses while the
    on-board sensor measures the gap.
    """

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        """Commanded acceleration (m/s²) at `speed` (m/s), behind the `VehiclesAhead`."""
        ...
