"""Shadowing: variance and autocorrelation, exact and of drawn values."""

from math import exp, sqrt
from statistics import NormalDist, fmean

import numpy as np
import pytest
from numpy.typing import NDArray

from transport.links.laws.radio import STEPS, ShadowField
from transport.links.link import keyed_draw

DECORRELATION = 25.0
NODE = DECORRELATION / STEPS
ONE = NormalDist().cdf(1.0)
LINE_ERROR = 0.026
BLOCK = 415
"""Nodes after which the weight of earlier draws is below 10⁻⁹."""


def weights(places: list[float]) -> NDArray[np.float64]:
    """Weights of the nodes' normal numbers in the field, which is linear in them."""

    def response(node: int) -> list[float]:
        field = ShadowField(DECORRELATION)
        return [field.at(lambda _, drawn: ONE if drawn == node else 0.5, place) for place in places]

    return np.array([response(node) for node in range(BLOCK - 190, BLOCK + 75)])


def test_variance_and_autocorrelation_follow_exactly_from_the_weights() -> None:
    """Also across two blocks, at nodes and between them."""
    border = BLOCK * NODE
    places = [border + NODE * step for step in (-25.0, -20.3, -7.0, -3.5, -1.2, -0.5, -0.25)]
    places += [border + NODE * step for step in (0.0, 0.5, 1.0, 1.75, 4.0, 12.5, 40.0, 70.2)]
    found = weights(places)
    covariance = found.T @ found
    assert np.diag(covariance) == pytest.approx(np.ones(len(places)), abs=1e-6)
    apart = np.abs(np.subtract.outer(places, places))
    error = covariance - np.exp(-apart / DECORRELATION)
    assert np.abs(error).max() < LINE_ERROR
    assert np.abs(error[apart > 3.0 * NODE]).max() < 0.026 * exp(-3.0 / STEPS)
    at_nodes = [index for index, place in enumerate(places) if (place / NODE) % 1.0 == 0.0]
    assert len(at_nodes) >= 6
    assert np.abs(error[np.ix_(at_nodes, at_nodes)]).max() < 1e-6


@pytest.mark.campaign(2_000, 100_000)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_is_drawn_has_the_law(seed: int, campaign: int) -> None:
    """Values two decorrelation distances apart are nearly independent."""
    draw, field = keyed_draw(seed, "v1", "v2"), ShadowField(DECORRELATION)
    stride = 2.0 * DECORRELATION
    values = [field.at(draw, stride * step + 0.3) for step in range(campaign)]
    error = sqrt(1.0 / campaign) * sqrt((1.0 + exp(-2.0)) / (1.0 - exp(-2.0)))
    assert abs(fmean(values)) < 4.0 * error
    assert abs(fmean(value * value for value in values) - 1.0) < 4.0 * sqrt(2.0) * error
    for apart in (0.25, 1.0, 2.0):
        ahead = [
            field.at(draw, stride * step + 0.3 + apart * DECORRELATION) for step in range(campaign)
        ]
        found = fmean(one * other for one, other in zip(values, ahead, strict=True))
        assert abs(found - exp(-apart)) < LINE_ERROR * exp(-apart) + 4.0 * sqrt(2.0) * error
