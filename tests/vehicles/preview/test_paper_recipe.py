"""The paper's own trajectory, against direct minimisation of its J and against exact courses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from tests.made.vehicles.arc_courses import course, fit_errors, point_at, window, with_noise
from tests.made.vehicles.fusions import fit_two
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.paper_recipe import circle_of_least_squares, recipe_curve
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import Fit

PAPER = FitSettings(trajectory="paper")
PREFIX = FitSettings(trajectory="paper_prefix")
STARTS = st.tuples(
    st.sampled_from([0.0, -1200.0, 500_000.0]),
    st.sampled_from([0.0, 4_649_776.0]),
    st.floats(-math.pi, math.pi),
)


def fit(
    lead: Window | None,
    predecessor: Window | None,
    alpha: float = 0.5,
    settings: FitSettings = PAPER,
) -> Fit:
    fitted = fit_two(lead, predecessor, alpha=alpha, settings=settings)
    assert fitted is not None
    return fitted


@pytest.mark.parametrize("seed", range(6))
def test_the_circle_minimises_j(seed: int) -> None:
    """Compared with an iterative minimisation of eq. (5)."""
    random = np.random.default_rng(seed)
    angles = np.linspace(0.1, random.uniform(0.4, 4.0), 17)
    radius = random.uniform(8.0, 60.0)
    x, y = (radius * f(angles) + random.normal(0.0, 0.05, 17) for f in (np.cos, np.sin))
    alpha = random.uniform(0.1, 0.9)
    weight = np.where(random.random(17) < 0.5, alpha, 1.0 - alpha)

    def e(unknowns: np.ndarray) -> np.ndarray:
        centre_x, centre_y, r = unknowns
        return np.asarray(np.sqrt(weight) * ((x - centre_x) ** 2 + (y - centre_y) ** 2 - r * r))

    fitted = circle_of_least_squares(x, y, weight)
    assert fitted is not None
    least = least_squares(e, [0.0, 0.0, radius], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert fitted == pytest.approx(tuple(least.x), rel=1e-6, abs=1e-6)


@given(start=STARTS, radius=st.floats(20.0, 600.0), side=st.sampled_from([-1.0, 1.0]))
def test_exact_arcs_ahead_are_recovered_and_extrapolated_to_the_car(
    start: tuple[float, float, float], radius: float, side: float
) -> None:
    path = course([(side / radius, 30.0)], start)
    lead = window(path, np.linspace(4.0, 30.0, 18), 3.0)
    predecessor = window(path, np.linspace(3.4, 18.0, 11), 3.0)
    offset, heading, bend = fit_errors(fit(lead, predecessor), path, 3.0)
    # Far from the origin positions are rounded to 1e-9 m.
    assert abs(offset) < 1e-5
    assert abs(heading) < 1e-6
    assert abs(bend) * radius < 1e-4


@pytest.mark.parametrize(("radius", "straight"), [(725.0, True), (715.0, False)])
def test_a_line_is_within_ten_centimetres_of_its_chord(radius: float, *, straight: bool) -> None:
    path = course([(1.0 / radius, 24.0)])
    fitted = fit(window(path, np.linspace(0.0, 24.0, 17), 0.0), None)  # 24² / 8 R = 10 cm at 720 m
    (piece,) = fitted.spline.pieces
    assert (piece.curvature == 0.0) is straight


def test_alpha_weights_the_predecessor() -> None:
    path, stations = course([(0.0, 20.0)]), np.linspace(1.0, 20.0, 15)
    lead, displaced = window(path, stations, 0.0), window(path, stations, 0.0, left=0.09)
    for alpha in (0.0, 0.25, 0.5, 1.0):
        offset, _, _ = fit_errors(fit(lead, displaced, alpha), path, 10.0)
        assert offset == pytest.approx(-0.09 * alpha, abs=1e-6)


def test_noise_makes_the_circle_small() -> None:
    """Least squares of e are biased, unlike those of distances: 14 % with 2 cm at 500 m."""
    path, random = course([(1 / 500, 30.0)]), np.random.default_rng(9)
    exact = window(path, np.linspace(0.5, 24.0, 16), 0.0)
    ratios = {}
    for settings in (PAPER, FitSettings()):
        noisy = [fit(with_noise(exact, random), None, settings=settings) for _ in range(300)]
        bends = [one.spline.pieces[0].curvature * 500.0 for one in noisy]
        ratios[settings.trajectory] = float(np.mean(bends))
    assert ratios["paper"] == pytest.approx(1.14, abs=0.03)
    assert ratios["fitted"] == pytest.approx(1.0, abs=0.03)


def test_no_sample_is_left_out_and_none_behind_is_used() -> None:
    path = course([(0.0, 30.0)])
    seen = window(path, np.linspace(1.0, 24.0, 17), 0.0)
    seen.north[9] += 1.5
    fitted = fit(seen, None)
    assert fitted.outliers == 0
    assert len(fitted.east) == 17
    assert fitted.residual_max > 0.5
    assert PAPER.behind(30.0) == PREFIX.behind(30.0) == 0.0
    assert FitSettings().behind(30.0) > 0.0


def test_the_longest_prefix_swallows_an_arc() -> None:
    """Trap of Section III-A: 15 m of an arc of 300 m are within 10 cm of their chord."""
    path = course([(1 / 300, 24.0)])
    seen = window(path, np.linspace(0.0, 24.0, 17), 0.0)
    line, arc = fit(seen, None, settings=PREFIX).spline.pieces
    assert line.curvature == 0.0
    assert line.length == pytest.approx(15.0, abs=0.1)
    assert arc.curvature == pytest.approx(1 / 300, rel=1e-3)
    assert fit(seen, None).spline.pieces[0].curvature == pytest.approx(1 / 300, rel=1e-6)


@pytest.mark.parametrize("settings", [PAPER, PREFIX])
def test_any_samples_give_finite_numbers_or_none(settings: FitSettings) -> None:
    random = np.random.default_rng(1)
    for _ in range(300):
        count = int(random.integers(0, 12))
        scale = 10.0 ** random.uniform(-3.0, 3.0)
        east, north = scale * random.standard_normal((2, count))
        if random.random() < 0.3 and count:
            east[:], north[:] = east[0], north[0]
        station = np.sort(scale * random.random(count))
        curve = recipe_curve(np.stack((east, north, station)), np.ones(count), settings)
        if curve is None:
            continue
        for piece in curve.spline.pieces:
            values = (piece.east, piece.north, piece.yaw, piece.curvature, piece.length)
            assert all(map(math.isfinite, values))
        assert math.isfinite(curve.rms)


def test_beside_is_left() -> None:
    """A point built to the left has a positive lateral error."""
    path = course([(-1 / 50, 30.0)], (7.0, 8.0, 2.5))
    fitted = fit(window(path, np.linspace(1.0, 24.0, 17), 0.0), None)
    assert fitted.spline.project(*point_at(path, 3.0, 0.4)).lateral == pytest.approx(0.4, abs=1e-6)
