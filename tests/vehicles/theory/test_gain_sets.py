import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters, all_loadings, loaded
from vehicles.theory.gain_sets import (
    PAPER_SPEEDS,
    abscissa,
    boundary_curve,
    gain_extremes,
    is_stabilising,
    non_convex_pair,
    stabilises_all,
)
from vehicles.theory.linear_model import characteristic_polynomial, closed_loop_at


def singular_frequency(car: VehicleParameters) -> float | None:
    excess = car.yaw_inertia - car.mass * car.front_axle_distance * car.rear_axle_distance
    squared = car.rear_cornering_stiffness * car.wheelbase / excess if excess else 0.0
    return math.sqrt(squared) if squared > 0.0 else None


LOADED = [loaded(CAR, loading) for loading in all_loadings()]


def _extent(speed: float) -> np.ndarray:
    extremes = np.array(gain_extremes([CAR], [speed]))
    return np.array([extremes[k, :, k] for k in range(3)])


@pytest.mark.parametrize("speed", PAPER_SPEEDS)
def test_membership_against_roots(speed: float) -> None:
    """Random gains over twice the extent of the set: no disagreement off the boundary."""
    random = np.random.default_rng(round(speed * 100))
    box = _extent(speed)
    centre, half = box.mean(axis=1), 0.5 * (box[:, 1] - box[:, 0])
    gains = centre + 2.0 * half * random.uniform(-1.0, 1.0, size=(400, 3))
    gains = np.concatenate([gains, np.array(NOMINAL_GAINS) * random.uniform(0.0, 3.0, (200, 3))])
    claimed = is_stabilising(CAR, speed, gains)
    real = np.array(
        [
            np.linalg.eigvals(closed_loop_at(CAR, Gains(*row.tolist()), speed)).real.max()
            for row in gains
        ]
    )
    clear = np.abs(real) > 1e-9 * CAR.steering_frequency
    assert np.array_equal(claimed[clear], real[clear] < 0.0)
    assert clear.mean() > 0.99
    assert 10 < claimed.sum() < 590


@examples(16, 150)
@given(CARS, GAINS, SPEEDS)
def test_membership_of_any_car(car: VehicleParameters, gains: Gains, speed: float) -> None:
    roots = np.roots(characteristic_polynomial(car, gains, speed))
    worst = float(roots.real.max())
    assume(abs(worst) > 1e-6)
    assert bool(is_stabilising(car, speed, np.array(gains))) == (worst < 0.0)
    assert abscissa(car, gains, [speed])[0] == pytest.approx(worst, rel=1e-6, abs=1e-6)


@examples(16, 100)
@given(CARS, SPEEDS, st.floats(-0.1, 0.3), st.floats(0.2, 60.0))
def test_boundary_points_have_a_root_on_the_axis(
    car: VehicleParameters, speed: float, yaw_rate_gain: float, frequency: float
) -> None:
    singular = singular_frequency(car)
    assume(singular is None or abs(frequency - singular) > 0.1)
    lateral, heading = boundary_curve(car, speed, yaw_rate_gain, np.array([frequency]))[0]
    polynomial = characteristic_polynomial(car, Gains(lateral, heading, yaw_rate_gain), speed)
    terms = np.abs(polynomial) * frequency ** np.arange(6, -1, -1)
    assert abs(np.polyval(polynomial, 1j * frequency)) < 1e-9 * terms.sum()


def test_membership_changes_across_the_boundary_only() -> None:
    """Along a line through the set, membership flips where the boundary curve crosses it."""
    frequencies = np.linspace(0.05, 40.0, 40_000)
    curve = boundary_curve(CAR, 30.0, 0.08, frequencies)
    lateral = np.linspace(1e-4, 2.0, 4001)
    gains = np.column_stack([lateral, np.full(4001, 0.96), np.full(4001, 0.08)])
    inside = is_stabilising(CAR, 30.0, gains)
    flips = lateral[1:][inside[1:] != inside[:-1]]
    above = curve[:, 1] > 0.96
    crossings = curve[1:][above[1:] != above[:-1], 0]
    assert len(flips) >= 1
    for flip in flips:
        assert np.abs(crossings - flip).min() < 2e-3


@pytest.mark.parametrize("car", LOADED[1:], ids=lambda car: f"{car.mass:.0f} kg")
def test_the_boundary_goes_through_infinity_at_one_frequency(car: VehicleParameters) -> None:
    """At any speed, as I_z > m a b for all loaded cars."""
    frequency = singular_frequency(car)
    assert frequency is not None
    assert np.isnan(boundary_curve(car, 30.0, 0.08, np.array([frequency]))).all()
    near = boundary_curve(car, 30.0, 0.08, np.array([0.999, 1.001]) * frequency)
    assert np.isfinite(near).all()
    assert np.abs(near).max() > 10.0
    assert near[0, 0] * near[1, 0] < 0.0  # leaves to one side, returns from the other


def test_nominal_gains_are_in_the_intersection() -> None:
    assert stabilises_all(LOADED, PAPER_SPEEDS, np.array([NOMINAL_GAINS]))[0]
    assert not stabilises_all([CAR], PAPER_SPEEDS, np.array([[-0.01, 0.96, 0.08]]))[0]


def test_the_intersection_is_contained_in_every_case() -> None:
    gains = np.random.default_rng(2).uniform([0.0, 0.0, -0.1], [1.5, 2.0, 0.3], (2000, 3))
    every = np.all([is_stabilising(CAR, speed, gains) for speed in PAPER_SPEEDS], axis=0)
    together = stabilises_all([CAR], PAPER_SPEEDS, gains)
    assert np.array_equal(every, together)
    assert 100 < together.sum() < 1900


def test_the_extremes_contain_the_set() -> None:
    """The set at 30 m/s is bounded, as in the paper; a wider search finds no further members."""
    random = np.random.default_rng(4)
    gains = random.uniform([0.0, -20.0, -2.0], [20.0, 20.0, 2.0], (100_000, 3))
    low, high = _extent(30.0).T
    inner = random.uniform(low, high, (20_000, 3))
    inside = np.concatenate([g[is_stabilising(CAR, 30.0, g)] for g in (gains, inner)])
    assert len(inside) > 1000
    assert (inside > low - 0.02 * (high - low)).all()
    assert (inside < high + 0.02 * (high - low)).all()


def test_extremes_follow_tips_that_no_grid_finds() -> None:
    """All extremes are members; the closed-form boundary extends no further."""
    extremes = np.array(gain_extremes([CAR], [30.0]))
    assert is_stabilising(CAR, 30.0, extremes).all()
    reached = [(extremes[k, 0, k], extremes[k, 1, k]) for k in range(3)]
    assert reached[0] == pytest.approx((0.0, 1.54), abs=0.01)
    frequencies = np.geomspace(0.02, 90.0, 2000)
    surface = []
    for yaw_rate in np.linspace(-0.15, 0.3, 91).tolist():
        curve = boundary_curve(CAR, 30.0, yaw_rate, frequencies)
        gains = np.column_stack([curve, np.full(len(curve), yaw_rate)])
        gains = gains[np.isfinite(curve).all(axis=1) & (curve[:, 0] > 0.0)]
        neighbours = gains[:, None, :] + np.array([[0.0, 1e-3, 0.0], [0.0, -1e-3, 0.0]])
        surface.append(gains[is_stabilising(CAR, 30.0, neighbours).any(axis=1)])
    for (least, most), points in zip(reached, np.concatenate(surface).T, strict=True):
        room = 0.02 * (most - least)
        assert points.min() > least - room
        assert points.max() < most + room


def test_the_intersection_is_within_its_parts() -> None:
    single = np.array(gain_extremes([CAR], [30.0]))
    both = np.array(gain_extremes([CAR], [10.0, 30.0]))
    for k in range(3):
        assert both[k, 0, k] > single[k, 0, k] - 0.01
        assert both[k, 1, k] < single[k, 1, k] + 0.01


@pytest.mark.parametrize("speeds", [(30.0,), PAPER_SPEEDS])
def test_the_set_is_not_convex(speeds: tuple[float, ...]) -> None:
    pair = non_convex_pair([CAR], speeds)
    assert pair is not None
    middle = Gains(*(0.5 * (np.array(pair[0]) + np.array(pair[1]))).tolist())
    assert max(abscissa(CAR, pair[0], speeds)) < 0.0
    assert max(abscissa(CAR, pair[1], speeds)) < 0.0
    assert max(abscissa(CAR, middle, speeds)) > 1e-3
