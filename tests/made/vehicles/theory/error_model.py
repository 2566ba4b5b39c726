"""Effect of the trajectory's curvature on the errors, by a second derivation."""

import numpy as np

from vehicles.car.parameters import VehicleParameters
from vehicles.theory.linear_model import steering_input

Array = np.ndarray


def curvature_input(
    parameters: VehicleParameters, speed: float, known: VehicleParameters | None = None
) -> Array:
    """Column by which the trajectory's curvature (1/m) enters z': -M^-1 F and the feedforward.

    Eqs. (3) and (6); `known` is the car that the controller assumes (feedforward).
    """
    front, rear = parameters.front_cornering_stiffness, parameters.rear_cornering_stiffness
    a, b = parameters.front_axle_distance, parameters.rear_axle_distance
    assumed = known or parameters
    feedforward = assumed.wheelbase + assumed.steer_gradient * speed * speed
    column = steering_input(parameters) * feedforward
    column[2] = -speed * speed - (a * front - b * rear) / parameters.mass
    column[3] = -(a * a * front + b * b * rear) / parameters.yaw_inertia
    return column


def curvature_rate_input(speed: float) -> Array:
    """Column by which the rate of curvature (1/(m s)) enters z': -v in theta~''.

    From yaw rate = theta~' + v kappa; absent from eq. (3), which applies to arcs. If the speed
    changes as well, the rate to enter is kappa' + v' kappa / v.
    """
    return np.array([0.0, 0.0, 0.0, -speed, 0.0, 0.0])
