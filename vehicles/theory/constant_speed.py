"""Stability at every constant speed of an interval, proven in exact arithmetic (Proposition 1).

The paper checks seven speeds and argues by continuity, which proves nothing between them. Here
Hurwitz's minors are polynomials in gamma = 1/v with rational coefficients. Their signs over the
whole interval are determined without rounding.
"""

from fractions import Fraction

import numpy as np

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import closed_loop_at
from vehicles.theory.polynomials import (
    Exact,
    add,
    hurwitz_minors,
    is_positive_between,
    multiply,
    shifted,
)


def exact_coefficients(parameters: VehicleParameters, gains: Gains) -> list[Exact]:
    """Coefficients of Delta(s, K), descending in s, as exact polynomials in gamma = 1/v (s/m).

    Paper, Section III-F. The floating-point parameters are used at their exact binary values.
    """
    mass, inertia = Fraction(parameters.mass), Fraction(parameters.yaw_inertia)
    front = Fraction(parameters.front_cornering_stiffness)
    rear = Fraction(parameters.rear_cornering_stiffness)
    a, b = Fraction(parameters.front_axle_distance), Fraction(parameters.rear_axle_distance)
    frequency = Fraction(parameters.steering_frequency)
    damping = Fraction(parameters.steering_damping)
    lateral, heading, yaw_rate = (Fraction(gain) for gain in gains)
    zero, length, drive = Fraction(0), a + b, front * frequency * frequency
    handling: list[Exact] = [
        (mass * inertia,),
        (zero, (inertia + mass * a * a) * front + (inertia + mass * b * b) * rear),
        (-mass * (a * front - b * rear), zero, length * length * front * rear),
    ]
    steering = ((Fraction(1),), (2 * damping * frequency,), (frequency * frequency,))
    result: list[Exact] = [(zero,)] * 7
    for i, left in enumerate(steering):
        for j, right in enumerate(handling):
            result[i + j] = add(result[i + j], multiply(left, right))
    turning: Exact = (drive * mass * a,)
    damped: Exact = (zero, drive * length * rear)
    feedback: list[Exact] = [
        multiply((yaw_rate,), turning),
        add(
            add(multiply((heading,), turning), multiply((yaw_rate,), damped)),
            (lateral * drive * inertia,),
        ),
        multiply((heading + lateral * b,), damped),
        (lateral * drive * length * rear,),
    ]
    return result[:3] + [add(*pair) for pair in zip(result[3:], feedback, strict=True)]


def is_stable_over(
    parameters: VehicleParameters, gains: Gains, slowest: float, fastest: float, decay: float = 0.0
) -> bool:
    """Whether all roots lie left of -decay (1/s) at every constant speed of an interval (m/s).

    Proves the hypothesis of Proposition 1 for the whole interval, not on a grid.
    """
    if not 0.0 < slowest <= fastest:
        raise ValueError(f"speeds must satisfy 0 < slowest <= fastest: {slowest}, {fastest}")
    low, high = 1 / Fraction(fastest), 1 / Fraction(slowest)
    coefficients = shifted(exact_coefficients(parameters, gains), Fraction(decay))
    conditions = [coefficients[0], coefficients[-1], *hurwitz_minors(coefficients)]
    return all(is_positive_between(condition, low, high) for condition in conditions)


def guaranteed_decay(
    parameters: VehicleParameters, gains: Gains, slowest: float, fastest: float
) -> float:
    """Proven decay sigma (1/s) of Proposition 1 over an interval of constant speeds (m/s).

    At most 1 % below the true value; 0 if the loop is not stable over the interval.
    """
    if not is_stable_over(parameters, gains, slowest, fastest):
        return 0.0
    low = 0.0
    high = min(
        -float(np.linalg.eigvals(closed_loop_at(parameters, gains, speed)).real.max())
        for speed in (slowest, fastest)
    )
    while high - low > 0.005 * high:
        middle = 0.5 * (low + high)
        if is_stable_over(parameters, gains, slowest, fastest, middle):
            low = middle
        else:
            high = middle
    return low
