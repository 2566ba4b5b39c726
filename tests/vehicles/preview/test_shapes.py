"""Curves with changing curvature, exact and noisy, and transitions between shapes."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.vehicles.arc_courses import course, fit_errors, window, with_noise
from tests.made.vehicles.fusions import fit_two
from tests.made.vehicles.true_shapes import JUMPING, SMOOTH, drawn
from vehicles.geometry.arc_spline import ArcSpline, Piece
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.trajectory import Fit

SETTINGS = FitSettings()
YAWS = st.floats(-math.pi, math.pi)


def fit(path: ArcSpline, places: Sequence[float], ego: float, noise: float = 0.0) -> Fit:
    seen = with_noise(window(path, places, ego), np.random.default_rng(3), noise)
    fitted = fit_two(seen, None, alpha=0.5, settings=SETTINGS)
    assert fitted is not None
    return fitted


@given(
    bend=st.floats(-0.03, 0.03),
    rate=st.floats(1e-4, 4e-3),
    side=st.sampled_from([-1.0, 1.0]),
    yaw=YAWS,
)
def test_exact_clothoids_are_recovered(bend: float, rate: float, side: float, yaw: float) -> None:
    length, ego = 24.0, 6.0
    path = ArcSpline((Piece(400.0, -300.0, yaw, bend, length, side * rate),))
    fitted = fit(path, np.linspace(0.0, length, 40).tolist(), ego)
    # The fit is first order in the rate.
    off = 2e-5 + 0.005 * rate * length**3 / 24.0
    offset, heading, curvature = fit_errors(fitted, path, ego)
    assert abs(offset) < off
    assert abs(heading) < off
    assert abs(curvature) < 0.03 * rate * length + 1e-6
    end = path.at(length)
    assert abs(fitted.spline.project(end.east, end.north).lateral) < 3.0 * off


@given(
    radii=st.tuples(st.floats(20.0, 60.0), st.floats(20.0, 60.0)),
    side=st.sampled_from([-1.0, 1.0]),
    opposite=st.booleans(),
    join=st.floats(0.3, 0.7),
    yaw=YAWS,
)
def test_exact_joins_of_two_arcs_are_recovered(
    radii: tuple[float, float], side: float, opposite: bool, join: float, yaw: float
) -> None:
    length = 24.0
    before, after = side / radii[0], side / radii[1] * (-1.0 if opposite else 1.0)
    assume(abs(after - before) > 0.3 * max(abs(before), abs(after)))
    path = course([(before, join * length), (after, (1.0 - join) * length)], (5.0, 7.0, yaw))
    fitted = fit(path, np.linspace(0.0, length, 40).tolist(), 0.2 * length)
    # A curvature within the noise is not fitted, hence millimetres.
    assert max(map(abs, fit_errors(fitted, path, 0.2 * length)[:2])) < 5e-3
    end = path.at(length)
    assert abs(fitted.spline.project(end.east, end.north).lateral) < 0.02


def test_shapes_change_without_a_jump() -> None:
    # The window moves from a straight through a clothoid into an arc. Steps of the curve are due to
    # noise, not to a choice of shape, so none is far above the usual.
    path = ArcSpline(
        (Piece(0.0, 0.0, 0.0, 0.0, 60.0), Piece(60.0, 0.0, 0.0, 0.0, 30.0, 1.0 / 3000.0))
    )
    end = path.at(90.0)
    path = ArcSpline((*path.pieces, Piece(end.east, end.north, end.yaw, end.curvature, 60.0)))
    random, places = np.random.default_rng(8), np.arange(0.0, 150.0, 0.75)
    seen = with_noise(window(path, places.tolist(), 0.0), random)
    bends = []
    for ego in np.arange(10.0, 120.0, 0.25):
        chosen = (places > ego - 5.0) & (places < ego + 16.0)
        cut = seen._replace(
            east=seen.east[chosen], north=seen.north[chosen], station=seen.station[chosen] - ego
        )
        fitted = fit_two(cut, None, alpha=0.5, settings=SETTINGS)
        assert fitted is not None
        here = path.at(float(ego))
        bends.append(fitted.spline.project(here.east, here.north).curvature)
    steps = np.abs(np.diff(bends))
    assert steps.max() < 2e-3
    assert np.sqrt(np.mean(steps**2)) < 4e-4


@pytest.mark.spread(2)
@pytest.mark.campaign(300, 3000)
@pytest.mark.parametrize("name", SMOOTH)
def test_smooth_shapes_are_fitted_nearly_as_well_as_known_ones(name: str, campaign: int) -> None:
    # 300 draws determine a root mean square to 4 %.
    assert max(drawn(SMOOTH[name], campaign).ratios) < 1.3


@pytest.mark.spread(2)
@pytest.mark.campaign(300, 3000)
@pytest.mark.parametrize("name", JUMPING)
def test_shapes_with_a_jump_of_curvature_are_fitted_at_least_half_as_well(
    name: str, campaign: int
) -> None:
    assert max(drawn(JUMPING[name], campaign).ratios) < 2.0
