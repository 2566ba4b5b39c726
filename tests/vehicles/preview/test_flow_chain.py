"""True errors along a convoy whose cars each drive 1 cm left of their composite trajectory.

Each car fits the paths that the cars before it drove. By the weights of eq. (5) the distance x_i of
car i from the lead's path is Σ w_j x_j + d.
"""

import numpy as np
import pytest

from tests.made.vehicles.fusions import FUSION_OF
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import SourceWindow

CARS, OFFSET, ALPHA = 8, 0.01, 0.5
STATIONS = np.linspace(-4.0, 20.0, 25)
SETTINGS, DEGRADATION = FitSettings(), DegradationSettings(reaction="extrapolate")


def chain(ahead: int, *, lead: bool, fusion: str = "composite") -> list[float]:
    """Distances (m) from the lead's path of cars that use the lead and vehicles directly ahead."""
    driven = [0.0]
    for place in range(1, CARS):
        used = [k for k in range(place) if place - k <= ahead or (lead and not k)]
        sources = Sources(
            [Source(f"v{k}", 0.05, DEGRADATION, place=place - k if k else 0) for k in used],
            DEGRADATION,
            lead="v0",
            predecessor=f"v{place - 1}",
            lateral=[f"v{k}" for k in used],
        )
        weights = sources.weights(ALPHA)
        windows = [
            SourceWindow(source.place, weights[name], Window(STATIONS, left(driven[k]), STATIONS))
            for k, (name, source) in zip(used, sources.all.items(), strict=True)
        ]
        parts = FUSION_OF[fusion].fuse(windows, SETTINGS)
        fitted = sum([share * -fit.spline.project(0.0, 0.0).lateral for share, fit in parts])
        driven.append(fitted + OFFSET)
    return driven[1:]


def left(offset: float) -> np.ndarray:
    return np.full(len(STATIONS), offset)


@pytest.mark.parametrize("fusion", FUSION_OF)
def test_with_the_lead_errors_level_off_without_it_they_grow(fusion: str) -> None:
    number = np.arange(1, CARS)
    assert chain(1, lead=False, fusion=fusion) == pytest.approx((OFFSET * number).tolist())
    with_lead = OFFSET / (1.0 - ALPHA) * (1.0 - ALPHA**number)
    assert chain(1, lead=True, fusion=fusion) == pytest.approx(with_lead.tolist(), rel=1e-4)
    assert chain(0, lead=True, fusion=fusion) == pytest.approx([OFFSET] * (CARS - 1))


def test_several_vehicles_ahead_delay_the_growth_and_do_not_end_it() -> None:
    """Each car adds d over its mean distance to its sources: 1.5 cars for two ahead."""
    two, more = np.array(chain(2, lead=False)), np.array(chain(3, lead=False))
    assert np.diff(two)[3:] == pytest.approx(OFFSET / 1.5, rel=0.1)
    assert np.all(np.diff(more)[2:] > 0.3 * OFFSET)
    # With the lead x_i = α x_(i-1) + (1 - α)/2 x_(i-2) + d, which tends to 2 d / (1 - α).
    levelled = chain(2, lead=True)
    assert levelled[0] == pytest.approx(OFFSET)
    assert max(levelled) < 2.0 * OFFSET / (1.0 - ALPHA)
    for place in range(2, CARS - 1):
        before, second = levelled[place - 1], levelled[place - 2]
        wanted = ALPHA * before + (1.0 - ALPHA) / 2.0 * second + OFFSET
        assert levelled[place] == pytest.approx(wanted, rel=1e-4)
