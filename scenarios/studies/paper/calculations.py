"""Values of the paper's claims that are calculated, not simulated: car, theory and gains.

Each function returns the value that is judged and other figures by name and unit.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from scenarios.studies.paper.runs import BASE_SPEED
from transport.columns import Floats
from vehicles.car.parameters import (
    LINCOLN_MKZ,
    NOMINAL_GAINS,
    Gains,
    Loading,
    VehicleParameters,
    all_loadings,
    loaded,
    loaded_with_moved_centre,
)
from vehicles.preview.paper_recipe import circle_of_least_squares
from vehicles.theory.gain_sets import (
    PAPER_SPEEDS,
    abscissa,
    common_ball,
    gain_extremes,
    guaranteed_decay,
    non_convex_pair,
    stability_ball,
)
from vehicles.theory.linear_model import (
    characteristic_polynomial,
    closed_loop_at,
    handling_polynomial,
    low_frequency_growth,
    propagation,
)
from vehicles.theory.string_stability import amplified_band, largest_singular_value, peak
from vehicles.theory.varying_speed import certify

Result = tuple[float, Mapping[str, Any]]

CAR, GAINS = LINCOLN_MKZ, NOMINAL_GAINS
SLOWEST = PAPER_SPEEDS[0]
SPEEDS = (*PAPER_SPEEDS, BASE_SPEED)
CARS = [loaded(CAR, loading) for loading in all_loadings()]
RADIUS = 500.0
"""Radius (m) of the curves of the paper's simulations."""


def _slowest_root(car: VehicleParameters, speed: float = BASE_SPEED) -> float:
    """Largest real part (1/s) of the roots."""
    return float(abscissa(car, GAINS, [speed])[0])


# ---- Sections II and III: car, feedforward, samples


def table_i() -> Result:
    """Understeer gradient; the centre of mass by the axle loads of Table I."""
    front, rear = 1052.32, 843.68  # kg
    centre = CAR.wheelbase * rear / (front + rear)
    figures = {"front_axle_distance_m": CAR.front_axle_distance, "by_axle_loads_m": centre}
    return CAR.steer_gradient, figures


def other_steering() -> Result:
    """Slowest root of all speeds and loadings with a steering of ζ = 0.7, ω_n = 19 rad/s."""
    other = replace(CAR, steering_damping=0.7, steering_frequency=19.0)
    cars = [loaded(other, loading) for loading in all_loadings()]
    figures = {}
    for name, car in (("", CAR), ("_other_steering", other)):
        figures[f"abscissa{name}_per_s"] = _slowest_root(car)
        figures[f"norm{name}_ratio"] = peak(propagation(car, GAINS, BASE_SPEED)).magnitude
        ball = common_ball([car], PAPER_SPEEDS, GAINS, GAINS)
        figures[f"relative_ball{name}_ratio"] = ball.radius
    return max(_slowest_root(car, speed) for car in cars for speed in PAPER_SPEEDS), figures


def feedforward() -> Result:
    """Relative difference of eq. (6) from the steady angle by eq. (3)."""
    requested = (CAR.wheelbase + CAR.steer_gradient * BASE_SPEED**2) / RADIUS
    wheels, heading = _steady_turn(CAR, BASE_SPEED, RADIUS)
    heavy = loaded(CAR, Loading(front_passengers=1, rear_passengers=3))
    return requested / wheels - 1.0, {
        "steering_rad": wheels,
        "heading_error_rad": heading,
        "offset_m": -GAINS.heading * heading / GAINS.lateral,
        "loaded_rad": _steady_turn(heavy, BASE_SPEED, RADIUS)[0],
    }


def _steady_turn(car: VehicleParameters, speed: float, radius: float) -> tuple[float, float]:
    """Solve eq. (3) as printed for steady δ_f and θ̃ (rad) on a circle of `radius` (m)."""
    front, rear = car.front_cornering_stiffness, car.rear_cornering_stiffness
    a, b = car.front_axle_distance, car.rear_axle_distance
    turning = a * front - b * rear
    # L x = B C_f δ_f − F / R; the first column of L is zero.
    left = np.array([[front, front + rear], [a * front, turning]])
    right = np.array([car.mass * speed**2 + turning, a * a * front + b * b * rear]) / radius
    steering, heading = np.linalg.solve(left, right)
    return float(steering), float(heading)


def printed_error_in_a_right_turn() -> Result:
    """R − distance from the centre, of a car 1 m to the left of its path in a right turn."""
    centre, car = np.array([0.0, -RADIUS]), np.array([0.0, 1.0])  # driving east
    return RADIUS - float(np.hypot(*(car - centre))), {}


def hidden_curvature() -> Result:
    """Curvature of the arc whose samples stay within 10 cm of the chord of a preview at 30 m/s."""
    hidden = {f"{v:.0f}": (0.8 * v) ** 2 / (8.0 * 0.1) for v in (10.0, 20.0, 30.0)}
    return 1.0 / hidden["30"], {"hidden_radius_m_by_mps": hidden}


ACCURACY, DRAWS = 0.02, 400
"""Accuracy of RTK in the paper (m); noisy arcs over which a fitted curvature is averaged."""


def circle() -> Result:
    """Largest difference of the solved circle from one by eq. (5) as printed, over its radius."""
    x, y = _arc(RADIUS)
    weight = np.full(len(x), 0.5)
    solved = circle_of_least_squares(x, y, weight)
    root = np.sqrt(weight)
    design = np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)]) * root[:, None]
    centre_x, centre_y, rest = np.linalg.lstsq(design, (x * x + y * y) * root, rcond=None)[0]
    direct = (centre_x, centre_y, np.sqrt(rest + centre_x**2 + centre_y**2))
    difference = np.inf if solved is None else float(np.abs(np.subtract(solved, direct)).max())
    bias = {f"{radius:.0f}": _mean_curvature(radius) for radius in (300.0, 500.0, 1500.0)}
    return difference / float(direct[2]), {"mean_curvature_ratio_by_radius_m": bias}


def _arc(radius: float) -> tuple[Floats, Floats]:
    """16 samples of the preview at 30 m/s on an arc (m), relative to their middle."""
    angles = (np.linspace(0.5, 24.0, 16) - 12.0) / radius
    return radius * np.sin(angles), radius * (1.0 - np.cos(angles))


def _mean_curvature(radius: float) -> float:
    """Mean curvature of circles of eq. (5) fitted to noisy samples, over the true curvature."""
    random, (x, y) = np.random.default_rng(5), _arc(radius)
    curvatures = []
    for _ in range(DRAWS):
        noise = ACCURACY * random.standard_normal((2, len(x)))
        solved = circle_of_least_squares(x + noise[0], y + noise[1], np.ones_like(x))
        if solved is not None:
            curvatures.append(np.copysign(radius / solved[2], solved[1]))
    return float(np.mean(curvatures))


# ---- Sections III-F and IV: polynomial, Proposition 1, G(jω)


def polynomial_against_matrix() -> Result:
    """Largest relative distance of a root of Δ(s, K) from the eigenvalues of A(γ)."""
    worst = 0.0
    for speed in PAPER_SPEEDS:
        for car in CARS:
            roots = np.roots(characteristic_polynomial(car, GAINS, speed))
            states = np.linalg.eigvals(closed_loop_at(car, GAINS, speed))
            gaps = np.abs(roots[:, None] - states[None, :]).min(axis=0) / np.abs(states)
            worst = max(worst, float(gaps.max()))
    return worst, {}


def printed_matrix() -> Result:
    """Slowest root of the matrix as printed, without M⁻¹, over that of eq. (3)."""
    right = closed_loop_at(CAR, GAINS, BASE_SPEED)
    printed = right * np.array([1.0, 1.0, CAR.mass, CAR.yaw_inertia, 1.0, 1.0])[:, None]
    wrong, slow = (float(np.linalg.eigvals(m).real.max()) for m in (printed, right))
    return wrong / slow, {"abscissa_as_printed_per_s": wrong, "abscissa_per_s": slow}


def mean_decay() -> Result:
    decay, sensitivity = certify(CAR, GAINS, SLOWEST, BASE_SPEED).mean_bound()
    return decay, {"sensitivity_s_per_m": sensitivity}


def mean_acceleration() -> Result:
    decay, sensitivity = certify(CAR, GAINS, SLOWEST, BASE_SPEED).mean_bound()
    return decay / sensitivity, {}


def certified_accelerations() -> Result:
    certificate = certify(CAR, GAINS, SLOWEST, BASE_SPEED)
    bounds = {f"{v:.1f}": certificate.bound(v) for v in (SLOWEST, 10.0, 20.0, BASE_SPEED)}
    decay = guaranteed_decay(CAR, GAINS, SLOWEST, BASE_SPEED)
    return min(bounds.values()), {"decay_per_s": decay, "certified_mps2_by_mps": bounds}


def norm_of_g() -> Result:
    """The smaller of ‖G‖∞ without and with steering actuation."""
    plain = propagation(CAR, GAINS, BASE_SPEED, "instantaneous")
    first, second = peak(plain), peak(propagation(CAR, GAINS, BASE_SPEED))
    return min(first.magnitude, second.magnitude), {
        "norm_instantaneous_at_radps": first.frequency,
        "amplified_up_to_radps": amplified_band(plain)[0][1],
        "norm_ratio": second.magnitude,
        "norm_at_radps": second.frequency,
        "low_frequency_growth_s2": low_frequency_growth(CAR, GAINS, BASE_SPEED),
    }


def singular_value() -> Result:
    """Largest σ_max over ‖G‖∞, with instantaneous steering."""
    frequencies = np.geomspace(0.01, 100.0, 4000)
    largest = float(largest_singular_value(CAR, GAINS, BASE_SPEED, frequencies).max())
    norm = peak(propagation(CAR, GAINS, BASE_SPEED, "instantaneous")).magnitude
    return largest / norm, {"sigma_max": largest}


# ---- Sections V-A and V-B: sets of gains, loadings


def stabilising_set() -> Result:
    """Slowest root midway between two stabilising points; NaN without such a pair."""
    lateral, heading, yaw_rate = (
        (least[axis], most[axis])
        for axis, (least, most) in enumerate(gain_extremes([CAR], [BASE_SPEED]))
    )
    pair = non_convex_pair([CAR], [BASE_SPEED])
    middle = Gains(*np.mean(pair, axis=0).tolist()) if pair else None
    return float(abscissa(CAR, middle, [BASE_SPEED])[0]) if middle else np.nan, {
        "lateral_rad_per_m_max": lateral[1],
        "heading_rad_per_rad": heading,
        "yaw_rate_s": yaw_rate,
    }


def slowest_root_over_speeds() -> Result:
    roots = {f"{speed:.2f}": _slowest_root(CAR, speed) for speed in SPEEDS}
    return max(roots.values()), {"abscissa_per_s_by_mps": roots}


def ball() -> Result:
    """Share by which all gains may change together, at all speeds and loadings."""
    plain = stability_ball(CAR, BASE_SPEED, GAINS).radius
    return common_ball(CARS, SPEEDS, GAINS, GAINS).radius, {"ball_radius_at_30_mps": plain}


def bounded_matrix() -> Result:
    """Decay over all speeds, and the largest norm of A."""
    speeds = np.geomspace(SLOWEST, BASE_SPEED, 50).tolist()
    norms = [float(np.linalg.norm(closed_loop_at(CAR, GAINS, speed), 2)) for speed in speeds]
    return guaranteed_decay(CAR, GAINS, SLOWEST, BASE_SPEED), {"norm_max": max(norms)}


def inertia() -> Result:
    """Largest excess of I_update over Steiner's theorem about the true centre of mass."""
    moved = [loaded_with_moved_centre(CAR, loading) for loading in all_loadings()]
    excess = [a.yaw_inertia / b.yaw_inertia - 1.0 for a, b in zip(CARS, moved, strict=True)]
    shift = [
        b.front_axle_distance - a.front_axle_distance for a, b in zip(CARS, moved, strict=True)
    ]
    return max(excess), {"centre_moves_m_max": max(shift)}


def second_difference() -> Result:
    light, middle, heavy = (
        characteristic_polynomial(loaded(CAR, Loading(rear_passengers=count)), GAINS, BASE_SPEED)
        for count in (0, 1, 2)
    )
    return float(np.abs((light - 2.0 * middle + heavy) / middle).max()), {}


def slowest_root_over_loadings() -> Result:
    roots = [_slowest_root(car) for car in CARS]
    moved = [_slowest_root(loaded_with_moved_centre(CAR, loading)) for loading in all_loadings()]
    return max(_slowest_root(car, speed) for car in CARS for speed in SPEEDS), {
        "abscissa_at_30_mps_per_s": (max(roots), min(roots)),
        "abscissa_moved_centre_per_s_max": max(moved),
    }


def open_loop_root() -> Result:
    """Largest real part (1/s) of the roots of Δ_o(s) = s² R(s)."""
    roots = np.roots(handling_polynomial(CAR, BASE_SPEED))
    figures = {"other_roots_per_s": [(float(r.real), float(r.imag)) for r in roots]}
    return max(0.0, float(roots.real.max())), figures
