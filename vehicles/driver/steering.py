"""From tracking errors to a steering command: the paper's law, alternatives, a user's own."""

import cmath
from dataclasses import dataclass
from math import atan, atan2, sin, sqrt
from typing import Annotated, Protocol

import numpy as np

from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters
from vehicles.car.path_keeping import PathKeeping
from vehicles.driver.tracking import TrackingErrors
from vehicles.setting import Setting


@dataclass(slots=True)
class SteeringCommand:
    """δ_c, δ_ff and δ_fb of Section III-C: front wheel angle, its parts before the limit (rad)."""

    steering: float
    feedforward: float
    feedback: float


class LateralController(Protocol):
    """Interface of a lateral controller (Fig. 1), shipped or user-defined.

    Each vehicle has its own instance, constructed as `Class(parameters, gains)`, followed by its
    own parameters:

    parameters   `VehicleParameters` assumed of the car (SI units)
    gains        `Gains` of the table `control.gains`; a controller may ignore them

    A controller may keep state. It must not use a clock. `steer` is called
    once per control instant, every 1/`control.rate_hz` seconds of the run; with `fusion = "blend"`
    once per trajectory. Wheel angles are limited to `parameters.steering_limit` (rad).
    """

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """Front wheel angle δ_c (Section III-C) for `errors` at `speed` (m/s, at least 0).

        `errors` are those of Section III-B against the trajectory, positive to the left: `lateral`
        (m), `heading` (rad), `yaw_rate` (rad/s), the trajectory's `curvature` (1/m) beside the car,
        and `curvature_ahead(distance)` (1/m) at a distance (m) along it.
        """
        ...


def limited(feedforward: float, feedback: float, limit: float) -> SteeringCommand:
    """Sum δ_ff + δ_fb (Section III-C) in rad, held within ±`limit` (rad)."""
    return SteeringCommand(min(max(feedforward + feedback, -limit), limit), feedforward, feedback)


class FeedforwardFeedback:
    """The paper's law: δ = δ_ff + δ_fb (Sections III-C to III-E)."""

    def __init__(self, parameters: VehicleParameters, gains: Gains = NOMINAL_GAINS) -> None:
        self._gains = gains
        self.assume(parameters)

    def assume(self, parameters: VehicleParameters) -> None:
        """Replace the assumed parameters of the car for K_sg, eq. (6)."""
        self._wheelbase = parameters.wheelbase
        self._steer_gradient = parameters.steer_gradient
        self._limit = parameters.steering_limit

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """Eqs. (6), (7): δ_ff = (a+b)/R + K_sg v²/R, δ_fb = −k_e e_lat − k_θ θ̃ − k_ω dθ̃/dt."""
        gains = self._gains
        feedforward = (self._wheelbase + self._steer_gradient * speed * speed) * errors.curvature
        feedback = (
            -gains.lateral * errors.lateral
            - gains.heading * errors.heading
            - gains.yaw_rate * errors.yaw_rate
        )
        return limited(feedforward, feedback, self._limit)


class SlipCompensated:
    """The paper's law, eqs. (6) and (7), with steady-state slip in curves compensated.

    A cornering car does not point along its path: on an arc of curvature κ its body has the slip
    angle β = κ l, l = b - m a v²/((a+b) C_r) (eqs. (1), (2), steady state). The paper's heading
    error θ̃ therefore settles at -β, and e_lat at k_θ β / k_e: 2 cm at 30 m/s on a radius of 500 m,
    but 3 m at walking pace on 8 m. So θ̃ is compared with that of a car that keeps to the path
    behind and ahead (`path_keeping`), and the feedforward is the steering of that car.

    To first order the yaw rate of that car is v times the curvature at the distance l behind it. If
    l < 0, in fast cars, the curvature beside the car is used instead, because followers learn of a
    change late.

    If the bend of a trajectory begins too early or too late, its errors of heading beside the car
    and of curvature behind it add up in θ̃ for l > 0 (below 24 to 27 m/s), and partly cancel for
    l < 0. Slower cars therefore use the curvature of the path as it was followed, faster ones that
    of the trajectory.

    The steering actuator, eq. (4), lags by 2ζ/ω_n and, being underdamped, overshoots: to second
    order it is exp(-2ζ s/ω_n) exp(-(1 - 2ζ²) s²/ω_n²). Commands are therefore issued that much
    earlier, each as a mean with weights 1/4, 1/2, 1/4 over three stations v 2 sqrt(1 - 2ζ²)/ω_n
    apart, which inverts the second-order term. This rounds off a jump Δa of the lateral
    acceleration by Δa (1 - 2ζ²)/(2 ω_n²): 1.3 mm at 1.8 m/s².

    On straights the law equals the paper's; the poles of the closed loop are the same everywhere.
    """

    HOLD = 0.01  # Mean age of a command (s): half a control period at 50 Hz

    def __init__(self, parameters: VehicleParameters, gains: Gains = NOMINAL_GAINS) -> None:
        self._gains = gains
        self.assume(parameters)
        damping, frequency = parameters.steering_damping, parameters.steering_frequency
        self._delay = self.HOLD + 2.0 * damping / frequency
        self._apart = 2.0 * sqrt(max(1.0 - 2.0 * damping * damping, 0.0)) / frequency

    def assume(self, parameters: VehicleParameters) -> None:
        """Replace the assumed parameters of the car for eqs. (1), (2) and (6)."""
        self._keeping = PathKeeping(parameters)
        self._limit = parameters.steering_limit

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """Steer by eqs. (6) and (7), with θ̃ and dθ̃/dt relative to a car that keeps to the path."""
        keeping, gains = self._keeping, self._gains
        delay, apart = speed * self._delay, speed * self._apart
        slip = keeping.slip(speed)
        lag = max(slip, 0.0)
        reach = -lag - apart, delay + apart
        curvatures = errors.curvatures_driven if slip > 0.0 else errors.curvatures_ahead
        motion = keeping.motion(curvatures, reach, speed)
        heading = motion.heading.mean(0.0, apart)
        curvature = motion.curvature.mean(-lag, apart)
        feedback = (
            -gains.lateral * errors.lateral
            - gains.heading * (errors.heading - heading)
            - gains.yaw_rate * (errors.yaw_rate + speed * (errors.curvature - curvature))
        )
        return limited(motion.steering.mean(delay, apart), feedback, self._limit)


@dataclass(eq=False)
class Stanley:
    """The law of the robot Stanley, for comparison.

    G. M. Hoffmann, C. J. Tomlin, M. Montemerlo, S. Thrun, "Autonomous automobile trajectory
    tracking for off-road driving", American Control Conference 2007; S. Thrun et al., "Stanley: the
    robot that won the DARPA Grand Challenge", Journal of Field Robotics 23(9), 2006. The wheels
    point along the path at the front axle, plus the arctangent of its lateral error over speed,
    plus yaw damping, plus the slip angle of the front tyres on a steady curve. The paper's gains
    are ignored.
    """

    @dataclass(frozen=True, slots=True)
    class Settings:
        """Parameters of the law of Stanley."""

        cross_track: Annotated[
            float,
            Setting("rate at which the lateral error of the front axle decays", "per_s", 0, 100),
        ] = 2.5
        softening: Annotated[
            float, Setting("limits the arctangent near standstill", "mps", 0.01, 100)
        ] = 1.0
        damping: Annotated[float, Setting("steering per yaw rate error", "s", 0, 10)] = 0.06

    parameters: VehicleParameters
    gains: Gains = NOMINAL_GAINS
    settings: Settings = Settings()

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """Bring the front axle back to the path (Hoffmann et al., 2007).

        The path at the front axle is extrapolated from its curvature κ at the centre of gravity: it
        has turned by κa and is offset by κa²/2. The feedforward are all terms with κ.
        """
        car, settings, kappa = self.parameters, self.settings, errors.curvature
        ahead = car.front_axle_distance
        slip = car.mass * car.rear_axle_distance / (car.wheelbase * car.front_cornering_stiffness)
        front = errors.lateral + ahead * sin(errors.heading) - 0.5 * kappa * ahead * ahead
        feedforward = (ahead + slip * speed * speed) * kappa
        feedback = (
            -errors.heading
            - atan2(settings.cross_track * front, settings.softening + abs(speed))
            - settings.damping * errors.yaw_rate
        )
        return limited(feedforward, feedback, car.steering_limit)


@dataclass(eq=False)
class PurePursuit:
    """Pure pursuit, for comparison.

    R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01,
    1992; J. M. Snider, "Automatic steering methods for autonomous automobile path tracking",
    CMU-RI-TR-09-08, 2009, for the bicycle and a look-ahead distance that grows with speed. The rear
    axle follows the circle that is tangent to the car's axis and passes through a goal point ahead
    on the path. Tyre slip, yaw rate and the paper's gains are ignored.
    """

    STEPS = 16  # Parts of the path up to the goal, each of constant curvature

    @dataclass(frozen=True, slots=True)
    class Settings:
        """Parameters of pure pursuit."""

        lookahead: Annotated[float, Setting("look-ahead distance over speed", "s", 0, 10)] = 0.5
        lookahead_wheelbases_min: Annotated[
            float, Setting("smallest look-ahead distance, in wheelbases", "", 0.1, 100)
        ] = 1.5

    parameters: VehicleParameters
    gains: Gains = NOMINAL_GAINS
    settings: Settings = Settings()

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """δ = atan(2 (a+b) sin α / l_d), α being the goal's bearing from the rear axle (Coulter).

        The goal is where the look-ahead distance l_d from the rear axle ends, measured along the
        path. The feedforward is the steering on the arc of the path's curvature; the feedback is
        the difference.
        """
        car, settings, heading = self.parameters, self.settings, errors.heading
        least = settings.lookahead_wheelbases_min * car.wheelbase
        reach = max(least, settings.lookahead * abs(speed))
        step = (reach - car.rear_axle_distance) / self.STEPS
        turns = step * np.asarray(errors.curvatures_ahead(0.5 * step, step, self.STEPS))
        goal = step * np.sum(np.exp(1j * (np.cumsum(turns) - 0.5 * turns)))
        axle = complex(0.0, errors.lateral) - car.rear_axle_distance * cmath.exp(1j * heading)
        bearing = cmath.phase(complex(goal) - axle) - heading
        steering = atan(2.0 * car.wheelbase * sin(bearing) / reach)
        feedforward = atan(car.wheelbase * errors.curvature)
        return limited(feedforward, steering - feedforward, car.steering_limit)
