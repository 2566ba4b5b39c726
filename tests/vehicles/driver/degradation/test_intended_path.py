"""Samples that are moved back to the lead's path by the offset that their sender announces."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport.received_poses import received_fix
from tests.made.vehicles.fusions import fit_two
from vehicles.car.gnss import Fix
from vehicles.driver.intended_path import (
    DEVIATIONS,
    MAX_ADDED,
    MAX_OFFSET,
    MAX_OFFSET_SLOPE,
    IntendedPath,
    path_offset,
)
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import Fit
from vehicles.schedule import MILLISECOND

PERIOD = 50 * MILLISECOND
HEADINGS = [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi, 2.3, -0.7]
ROADS = {"straight": 0.0, "left": 1 / 40, "right": -1 / 40}
SETTINGS = FitSettings(position_noise=0.02)


def road(kind: str, heading: float) -> SampledPath:
    """60 m of road from (100, -50) in the direction `heading` (rad)."""
    return path_from_segments([Segment(60.0, ROADS[kind])], east=100.0, north=-50.0, yaw=heading)


def fix_beside(path: SampledPath, seq: int, offset: float, spacing: float = 1.0) -> Fix:
    """Fix number `seq` of a car that drives `offset` (m) to the left of a path."""
    at = path.at(seq * spacing)
    east, north = at.east - offset * math.sin(at.yaw), at.north + offset * math.cos(at.yaw)
    return Fix(seq, seq * PERIOD, east, north, at.yaw, spacing / 0.05, 0.0)


def window_of(fixes: Sequence[Fix]) -> Window:
    east, north = [fix.east for fix in fixes], [fix.north for fix in fixes]
    station = [float(k) for k in range(len(fixes))]
    return Window(*(np.array(values, dtype=np.float64) for values in (east, north, station)))


def moved_back(fixes: Sequence[Fix], offsets: Sequence[float]) -> Window:
    intended = IntendedPath()
    for fix, offset in zip(fixes, offsets, strict=True):
        intended.add(received_fix(fix), offset)
    return intended.corrected(window_of(fixes), [fix.measured_at for fix in fixes])


def fit_of(window: Window, *, of_lead: bool = True) -> Fit:
    windows = (window, None) if of_lead else (None, window)
    fit = fit_two(*windows, alpha=0.5, settings=SETTINGS)
    assert fit is not None
    return fit


def moved(window: Window, by: float) -> Window:
    return window._replace(station=window.station - by)


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("kind", ROADS)
@pytest.mark.parametrize("offset", [0.4, -0.3])
def test_samples_left_of_the_path_move_right(kind: str, heading: float, offset: float) -> None:
    path = road(kind, heading)
    fixes = [fix_beside(path, seq, offset) for seq in range(40)]
    window = moved_back(fixes, [offset] * len(fixes))
    for k, (east, north) in enumerate(zip(window.east, window.north, strict=True)):
        assert path.project(east, north, float(k)).lateral == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("of_lead", [True, False])
@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("kind", ROADS)
def test_a_fix_left_of_the_samples_has_a_positive_offset(
    kind: str, heading: float, of_lead: bool
) -> None:
    path = road(kind, heading)
    fit = fit_of(
        moved(window_of([fix_beside(path, k, 0.0) for k in range(30)]), 10.0), of_lead=of_lead
    )
    for offset in (0.5, 0.0, -0.35):
        fix = fix_beside(path, 21, offset, spacing=0.5)
        assert path_offset(fit, fix) == pytest.approx(offset, abs=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_errors_do_not_grow_along_the_convoy(seed: int) -> None:
    """Ten vehicles, each decimetres off the path, with own noise, receive only their predecessor.

    A corrected sample lies between two samples corrected before, so it is no further off the road
    than those of the lead, and noise is smoothed instead of accumulated.
    """
    path, random = road("straight", 0.9), np.random.default_rng(seed)
    noise = random.normal(0.0, 0.02, 60)
    window = window_of([fix_beside(path, k, noise.item(k)) for k in range(60)])
    largest, first = float(np.max(np.abs(noise))), float(np.std(noise))
    for vehicle in range(10):
        intended, fixes = IntendedPath(), []
        wave, jitter = 0.1 * vehicle, random.normal(0.0, 0.02, 60)
        for k in range(2 + vehicle, 57 - vehicle):
            driven = k + random.uniform(0.0, 0.5)
            off = 0.3 * math.sin(wave * k) + jitter.item(k)
            fix = fix_beside(path, 1, off, spacing=driven)
            fix.measured_at = k * PERIOD
            fit = fit_of(moved(window, driven - window.station.item(0)))
            intended.add(received_fix(fix), path_offset(fit, fix))
            fixes.append(fix)
        window = intended.corrected(window_of(fixes), [fix.measured_at for fix in fixes])
        feet = [
            path.project(e, n, 30.0, 60.0).lateral
            for e, n in zip(window.east, window.north, strict=True)
        ]
        assert max(map(abs, feet)) < largest + 1e-3
        assert float(np.std(feet)) < first + 1e-3


@given(st.lists(st.floats(), min_size=2, max_size=30), st.floats(min_value=-1e6, max_value=1e6))
def test_any_announced_offsets_keep_the_path_drivable(
    offsets: list[float], accuracy: float
) -> None:
    path = road("straight", 0.0)
    fixes = [fix_beside(path, k, 0.0) for k in range(len(offsets))]
    fixes[0].accuracy = accuracy
    left = moved_back(fixes, offsets).north - window_of(fixes).north
    assert max(map(abs, left)) <= MAX_OFFSET + MAX_ADDED
    most = MAX_OFFSET_SLOPE * 1.0 + DEVIATIONS * 0.02
    assert max(map(abs, np.diff(left))) <= most + 1e-9
