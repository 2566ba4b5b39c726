"""Dead reckoning by the inertial sensor, and the growth of its error.

Gyroscope and wheels measure yaw rate and speed; the lateral speed follows from the yaw rate by the
single-track model. The densities below are the process noise of a filter that corrects dead
reckoning by fixes.
"""

import math
from typing import Final

from vehicles.car.imu import InertialNoise
from vehicles.car.parameters import VehicleParameters

MIN_LAG: Final = 1e-3
"""Least time constant (s) of the slip, for a car that hardly moves."""

UNKNOWN_LOAD: Final = 0.25
"""Error of the assumed load, as a share of the car's mass: four passengers with luggage are 480 kg
on 1896 kg (Section V-B). It enters the part of the steady slip that depends on the mass."""

LASTING: Final = 0.5
"""Time (s) for which an error of the slip lasts: half of the second that the paper assumes between
two changes of curvature (Section III-A)."""

SIDE_DRIFT: Final = 0.003
"""Sideways speed (m/s) by causes outside the model: camber, wind."""

YAW_JERK: Final = 5.0
"""Change of yaw acceleration (rad/s³) between readings: an emergency lane change at 30 m/s."""

JERK: Final = 10.0
"""Change of acceleration (m/s³) between readings: the onset of hard braking."""


class SlipModel:
    """Lateral speed (m/s) of the centre of mass from the yaw rate r, by eqs. (1), (2).

    Elimination of the front axle's force gives v_y' = (l r - v_y) / tau + (I / m a) r', with the
    steady slip l = b - s v² of `VehicleParameters.steady_slip_per_curvature`, tau = s v and
    s = m a / (L C_r). So the measured yaw rate determines the slip in transients, too, as far as
    mass and tyres are known.
    """

    def __init__(self, parameters: VehicleParameters) -> None:
        p = parameters
        moment = p.mass * p.front_axle_distance
        self._rear = p.rear_axle_distance
        self._sag = moment / (p.wheelbase * p.rear_cornering_stiffness)
        self._kick = p.yaw_inertia / moment

    def steady(self, speed: float, yaw_rate: float) -> float:
        """Lateral speed (m/s) in steady cornering, eqs. (1), (2) at rest."""
        return (self._rear - self._sag * speed * speed) * yaw_rate

    def after(
        self, span: float, speed: float, before: float, now: float, lateral_speed: float
    ) -> float:
        """Lateral speed `span` (s > 0) later; the yaw rate is a ramp from `before` to `now`.

        The exact solution of the equation above.
        """
        steady = self._rear - self._sag * speed * speed
        lag = self._sag * speed
        if lag < MIN_LAG:
            lag = MIN_LAG
        kept = math.exp(-span / lag)
        ramp = (self._kick - steady) * (now - before) * (lag * (1.0 - kept) / span)
        return kept * lateral_speed + steady * (now - kept * before) + ramp

    def error(self, speed: float, yaw_rate: float) -> float:
        """Standard deviation (m/s) of the lateral speed: unknown load, and `SIDE_DRIFT`."""
        return UNKNOWN_LOAD * self._sag * speed * speed * abs(yaw_rate) + SIDE_DRIFT


class DriftModel:
    """Process noise of dead reckoning, without biases.

    Densities of random walks, standard deviation² per time: `along` and `across` the body (m²/s),
    `heading` (rad²/s). White noise of deviation s held for T walks with density s² T.
    """

    def __init__(self, slip: SlipModel, noise: InertialNoise, rate_hz: float) -> None:
        self._slip = slip
        period = 1.0 / rate_hz
        between = period * period / 12.0  # of a change of slope missed by joining two readings
        self.along = period * (noise.speed**2 + (JERK * between) ** 2)
        self.heading = period * (noise.yaw_rate**2 + (YAW_JERK * between) ** 2)

    def across(self, speed: float, yaw_rate: float) -> float:
        """Density across the body (m²/s) at a motion: of the slip's error.

        One of deviation s that lasts for a time t (a Gauss–Markov process) walks with 2 s² t.
        """
        return 2.0 * LASTING * self._slip.error(speed, yaw_rate) ** 2
