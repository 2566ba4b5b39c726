"""From tracking errors to a steering command: the paper's law, alternatives, a user's own."""

from dataclasses import dataclass
from importlib import import_module
from math import atan, atan2, cos, hypot, isfinite, sin, sqrt
from typing import Protocol

from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters
from vehicles.car.path_keeping import PathKeeping
from vehicles.driver.tracking import TrackingErrors


@dataclass(slots=True)
class SteeringCommand:
    """δ_c, δ_ff and δ_fb of Section III-C: front wheel angle, its parts before the limit (rad)."""

    steering: float
    feedforward: float
    feedback: float


class LateralController(Protocol):
    """Interface of a lateral controller (Fig. 1), shipped or user-defined.

    A controller is a class in a module that Python can import, for example from the working folder.
    A scenario selects it by its dotted name, `module.Class`, in `control.controller`, or for one
    vehicle in `vehicle.NAME.control.controller`. Each vehicle has its own instance, constructed as
    `Class(parameters, gains)`:

    parameters   `VehicleParameters` assumed of the car (SI units)
    gains        `Gains` of the table `control.gains`; a controller may ignore them

    A controller may keep state. It must not use a clock and should not draw random numbers, so that
    the same seed gives the same run. `steer` is called once per control instant, every
    1/`control.rate_hz` seconds of the run; with `fusion = "blend"` once per trajectory. Wheel
    angles are limited to `parameters.steering_limit` (rad).

    Before a run the controller is constructed and called once, on a straight at 10 m/s without
    errors; if this fails the scenario is refused. During a run an exception or a non-finite command
    ends the run with a one-line message, or only its vehicle if
    `convoy.on_vehicle_failure = "continue"`.
    """

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """Front wheel angle δ_c (Section III-C) for `errors` at `speed` (m/s, at least 0).

        `errors` are those of Section III-B against the trajectory, positive to the left: `lateral`
        (m), `heading` (rad), `yaw_rate` (rad/s), the trajectory's `curvature` (1/m) beside the car,
        and `curvature_ahead(distance)` (1/m) at a distance (m) along it.
        """
        ...


class ControllerError(ValueError):
    """A controller violates the contract of `LateralController`; the message is one line."""


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

    HOLD = 0.01
    """Mean age of a command (s): half a control period at 50 Hz."""

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


class Stanley:
    """The law of the robot Stanley, for comparison.

    G. M. Hoffmann, C. J. Tomlin, M. Montemerlo, S. Thrun, "Autonomous automobile trajectory
    tracking for off-road driving", American Control Conference 2007; S. Thrun et al., "Stanley: the
    robot that won the DARPA Grand Challenge", Journal of Field Robotics 23(9), 2006. The wheels
    point along the path at the front axle, plus the arctangent of its lateral error over speed,
    plus yaw damping, plus the slip angle of the front tyres on a steady curve. The paper's gains
    are ignored.
    """

    CROSS_TRACK = 2.5
    """Rate at which the front axle's lateral error decays (1/s)."""
    SOFTENING = 1.0
    """Limits the arctangent near standstill (m/s)."""
    DAMPING = 0.06
    """Steering per yaw-rate error (s)."""

    def __init__(self, parameters: VehicleParameters, gains: Gains = NOMINAL_GAINS) -> None:  # noqa: ARG002 - every controller is built alike
        self._parameters = parameters
        car = parameters
        self._slip = (
            car.mass * car.rear_axle_distance / (car.wheelbase * car.front_cornering_stiffness)
        )

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """Bring the front axle back to the path (Hoffmann et al., 2007).

        The path at the front axle is extrapolated from its curvature κ at the centre of gravity: it
        has turned by κa and is offset by κa²/2. The feedforward are all terms with κ.
        """
        ahead, kappa = self._parameters.front_axle_distance, errors.curvature
        front = errors.lateral + ahead * sin(errors.heading) - 0.5 * kappa * ahead * ahead
        feedforward = (ahead + self._slip * speed * speed) * kappa
        feedback = (
            -errors.heading
            - atan2(self.CROSS_TRACK * front, self.SOFTENING + abs(speed))
            - self.DAMPING * errors.yaw_rate
        )
        return limited(feedforward, feedback, self._parameters.steering_limit)


class PurePursuit:
    """Pure pursuit, for comparison.

    R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01,
    1992; J. M. Snider, "Automatic steering methods for autonomous automobile path tracking",
    CMU-RI-TR-09-08, 2009, for the bicycle and a look-ahead distance that grows with speed. The rear
    axle follows the circle that is tangent to the car's axis and passes through a goal point ahead
    on the path. Tyre slip, yaw rate and the paper's gains are ignored.
    """

    LOOK_AHEAD = 0.5
    """Look-ahead distance over speed (s)."""
    LOOK_AHEAD_LEAST = 1.5
    """Smallest look-ahead distance, in wheelbases."""
    STEPS = 16
    """Search points for the goal per look-ahead distance."""

    def __init__(self, parameters: VehicleParameters, gains: Gains = NOMINAL_GAINS) -> None:  # noqa: ARG002 - every controller is built alike
        self._parameters = parameters

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        """δ = atan(2 (a+b) sin α / l_d), α being the goal's bearing from the rear axle (Coulter).

        The feedforward follows from the path's curvature beside the car, the feedback is the rest.
        """
        car, heading = self._parameters, errors.heading
        reach = max(self.LOOK_AHEAD_LEAST * car.wheelbase, self.LOOK_AHEAD * abs(speed))
        x = -car.rear_axle_distance * cos(heading)
        y = errors.lateral - car.rear_axle_distance * sin(heading)
        goal_x, goal_y = self._goal(errors, x, y, reach)
        bearing = atan2(goal_y - y, goal_x - x) - heading
        steering = atan(2.0 * car.wheelbase * sin(bearing) / reach)
        feedforward = atan(car.wheelbase * errors.curvature)
        return limited(feedforward, steering - feedforward, car.steering_limit)

    def _goal(
        self, errors: TrackingErrors, x: float, y: float, reach: float
    ) -> tuple[float, float]:
        """First point of the path at distance `reach` (m) from (x, y), in the foot point's frame.

        The foot point itself if the car is further away than `reach`; the search ends at twice
        `reach` if the path turns in a smaller circle.
        """
        step = reach / self.STEPS
        goal_x = goal_y = turned = 0.0
        away = hypot(x, y)
        for k in range(2 * self.STEPS):
            if away >= reach:
                break
            turn = errors.curvature_ahead((k + 0.5) * step) * step
            before_x, before_y, before = goal_x, goal_y, away
            goal_x += step * cos(turned + 0.5 * turn)
            goal_y += step * sin(turned + 0.5 * turn)
            turned += turn
            away = hypot(goal_x - x, goal_y - y)
            if away > reach:
                share = (reach - before) / (away - before)
                goal_x = before_x + share * (goal_x - before_x)
                goal_y = before_y + share * (goal_y - before_y)
        return goal_x, goal_y


class GuardedController:
    """Wraps a user's controller (Section III-C), and converts its faults to ControllerError."""

    def __init__(self, controller: LateralController, name: str) -> None:
        self._controller = controller
        self._name = name

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        try:
            command: object = self._controller.steer(errors, speed)
        except (Exception, SystemExit) as error:
            raise ControllerError(
                f"controller {self._name!r}: steer() raised {_described(error)}"
            ) from error
        if not isinstance(command, SteeringCommand):
            given = type(command).__name__
            raise ControllerError(
                f"controller {self._name!r}: steer() returned {given}, expected a SteeringCommand"
            )
        for part in ("steering", "feedforward", "feedback"):
            value: object = getattr(command, part)
            if not isinstance(value, (int, float)) or not isfinite(value):
                raise ControllerError(
                    f"controller {self._name!r}: steer() returned {part} = {value!r}, expected a "
                    "finite number of radians"
                )
        # The controller may return NumPy scalars.
        return SteeringCommand(
            float(command.steering), float(command.feedforward), float(command.feedback)
        )


def _described(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def load_controller(name: str, parameters: VehicleParameters, gains: Gains) -> LateralController:
    """Build the controller class of a dotted name such as `vehicles.driver.steering.Stanley`.

    A class of another module is wrapped in a `GuardedController`. Raises ControllerError if there
    is no such class, or if it cannot be built.
    """
    module_name, _, class_name = name.rpartition(".")
    if not module_name or not class_name:
        raise ControllerError(f"controller {name!r}: give a dotted name, package.module.Class")
    try:
        factory = getattr(import_module(module_name), class_name)
    except (Exception, SystemExit) as error:
        why = str(error) if isinstance(error, ImportError) else _described(error)
        raise ControllerError(f"controller {name!r}: {why}") from error
    if not isinstance(factory, type) or not callable(getattr(factory, "steer", None)):
        raise ControllerError(
            f"controller {name!r}: not a class with a method steer(errors, speed)"
        )
    try:
        controller: LateralController = factory(parameters, gains)
    except (Exception, SystemExit) as error:
        raise ControllerError(
            f"controller {name!r}: cannot be built as {class_name}(parameters, gains): "
            f"{_described(error)}"
        ) from error
    return controller if factory.__module__ == __name__ else GuardedController(controller, name)


def try_out(controller: LateralController) -> None:
    """Call `steer` once, on a straight at 10 m/s without errors; raises ControllerError."""
    controller.steer(TrackingErrors(lateral=0.0, heading=0.0, yaw_rate=0.0, curvature=0.0), 10.0)
