"""Parameters of a car (the paper's Table I), and the effect of its load.

SI units: kg, m, s, rad, N. The single-track ("bicycle") model joins the two wheels of an axle into
one, so a cornering stiffness is that of a whole axle.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple

from vehicles.setting import Setting

TyreModel = Literal["linear", "brush"]  # The paper's linear tyres, or saturating ones; see `tyres`


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleParameters:
    """Parameters of the single-track model of a car with front steering (Section II, Table I).

    mass (kg) and yaw_inertia (kg m²) of the whole car; cornering stiffnesses (N/rad) per axle;
    axle distances (m) from the centre of mass; steering_frequency (rad/s) and steering_damping
    (ratio) of the second-order actuation, paper eq. (4); steering_limit (rad) and
    steering_rate_limit (rad/s, may be infinite) at the road wheels; length and width (m) of the
    body, for gaps and pictures only, with equal overhangs in front and behind; tyre model; friction
    coefficient (ratio) between tyres and road, unused by linear tyres; time constant drive_lag (s)
    of drive and brakes.
    """

    mass: float
    yaw_inertia: float
    front_cornering_stiffness: float
    rear_cornering_stiffness: float
    front_axle_distance: float
    rear_axle_distance: float
    steering_frequency: float
    steering_damping: float
    steering_limit: float
    length: float
    width: float
    steering_rate_limit: float = math.inf
    tyres: TyreModel = "linear"
    friction: float = 0.9
    drive_lag: float = 0.0

    @property
    def wheelbase(self) -> float:
        """Distance between the axles, a + b of Table I (m)."""
        return self.front_axle_distance + self.rear_axle_distance

    @property
    def body_offset(self) -> float:
        """Distance (m) of the body's centre ahead of the centre of mass, with equal overhangs."""
        return 0.5 * (self.front_axle_distance - self.rear_axle_distance)

    @property
    def steer_gradient(self) -> float:
        """K_sg of eq. (6), delta = L/R + K_sg v²/R (s² rad/m); positive for an understeering car.

        From eqs. (1), (2) with constant lateral speed and yaw rate: K_sg = m (b C_r - a C_f)
        / (L C_f C_r).
        """
        front, rear = self.front_cornering_stiffness, self.rear_cornering_stiffness
        surplus = self.rear_axle_distance * rear - self.front_axle_distance * front
        return self.mass * surplus / (self.wheelbase * front * rear)

    def steady_slip_per_curvature(self, speed: float) -> float:
        """Lateral speed over yaw rate in steady cornering at `speed` (m/s), in metres.

        From eqs. (1), (2): v_y / r = b - m a v² / (L C_r). The course of the centre of mass
        differs from the body's yaw by this times the curvature. In a left turn the course points
        left of the body at low speed and right of it above 26.8 m/s (nominal car).
        """
        sag = self.mass * self.front_axle_distance * speed * speed
        return self.rear_axle_distance - sag / (self.wheelbase * self.rear_cornering_stiffness)


def least_spacing(ahead: VehicleParameters, behind: VehicleParameters) -> float:
    """Spacing (m) of two cars, between their centres of mass, at which their bumpers touch.

    At least 0: otherwise a centre of mass would be outside its body.
    """
    touching = 0.5 * (ahead.length + behind.length) + (behind.body_offset - ahead.body_offset)
    return max(touching, 0.0)


LINCOLN_MKZ = VehicleParameters(
    mass=1896.0,
    yaw_inertia=3803.0,
    front_cornering_stiffness=400_000.0,
    rear_cornering_stiffness=381_900.0,
    front_axle_distance=1.2682,
    rear_axle_distance=1.5818,
    steering_frequency=21.4813,
    steering_damping=0.4056,
    steering_limit=0.54,
    length=4.93,
    width=1.86,
)
"""The paper's Table I, with linear tyres and no limit of the steering rate. The steering limit
(8 rad at the steering wheel over a ratio of 14.8) and the size of the body are those of the
production car; the paper does not give them."""


class Gains(NamedTuple):
    """Feedback gains k_e (rad/m), k_θ (rad/rad) and k_ω (s) of eq. (7), Section III-E."""

    lateral: float
    heading: float
    yaw_rate: float


NOMINAL_GAINS = Gains(0.06, 0.96, 0.08)  # The paper's nominal gains (Section V-A)


@dataclass(frozen=True, slots=True, kw_only=True)
class Loading:
    """Passengers in addition to the driver, each with luggage in the boot (paper, Section V-B).

    The mass of the car includes the driver. Masses in kg per passenger; `luggage_offset_m` is the
    paper's c, behind the rear axle.
    """

    front_passengers: Annotated[int, Setting("in front, in addition to the driver", "", 0, 8)] = 0
    rear_passengers: Annotated[int, Setting("in the rear", "", 0, 60)] = 0
    passenger_mass: Annotated[float, Setting("per passenger", "kg", 0, 500)] = 70.0
    luggage_mass: Annotated[float, Setting("per passenger, in the boot", "kg", 0, 1000)] = 50.0
    luggage_offset: Annotated[float, Setting("boot behind the rear axle", "m", 0, 10)] = 0.5


def loaded(parameters: VehicleParameters, loading: Loading) -> VehicleParameters:
    """Add a load to mass and yaw inertia (I_update of Section V-B).

    I = I_nominal + m_p n_f a² + m_p n_r b² + m_l (n_f + n_r) (b + c)². As in the paper, the centre
    of mass, and so a and b, do not move.
    """
    front, rear = loading.front_passengers, loading.rear_passengers
    body, luggage = loading.passenger_mass, loading.luggage_mass
    a, b = parameters.front_axle_distance, parameters.rear_axle_distance
    inertia = parameters.yaw_inertia + body * front * a**2 + body * rear * b**2
    return replace(
        parameters,
        mass=parameters.mass + (front + rear) * (body + luggage),
        yaw_inertia=inertia + luggage * (front + rear) * (b + loading.luggage_offset) ** 2,
    )


def all_loadings() -> tuple[Loading, ...]:
    """List the cases of Section V-B: up to 1 passenger in front and 3 behind."""
    return tuple(Loading(front_passengers=f, rear_passengers=r) for f in range(2) for r in range(4))


def loaded_with_moved_centre(parameters: VehicleParameters, loading: Loading) -> VehicleParameters:
    """Like `loaded`, but the centre of mass moves with the load, unlike in Section V-B.

    Axle distances are from the new centre, and the yaw inertia is about it (Steiner's theorem).
    """
    fixed = loaded(parameters, loading)
    a, b = parameters.front_axle_distance, parameters.rear_axle_distance
    front, rear, body = loading.front_passengers, loading.rear_passengers, loading.passenger_mass
    boot = loading.luggage_mass * (front + rear) * (b + loading.luggage_offset)
    forward = (body * (front * a - rear * b) - boot) / fixed.mass
    return replace(
        fixed,
        yaw_inertia=fixed.yaw_inertia - fixed.mass * forward * forward,
        front_axle_distance=a - forward,
        rear_axle_distance=b + forward,
    )
