"""Samples that are moved back to the lead's path by the offset that their sender announces."""

import math
import tracemalloc
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport.received_poses import received, received_fix
from tests.made.vehicles.fusions import fit_two
from vehicles.car.gnss import Fix
from vehicles.driver.degradation.intended_path import (
    CAPACITY,
    DEVIATIONS,
    MAX_ADDED,
    MAX_OFFSET,
    MAX_OFFSET_SLOPE,
    IntendedPath,
    IntendedShare,
    path_offset,
)
from vehicles.driver.degradation.settings import PredecessorPath
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.messages import Mode
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.received.samples import Window
from vehicles.preview.received.trace import Trace
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


def moved_back(fixes: Sequence[Fix], offsets: Sequence[float], share: float = 1.0) -> Window:
    intended = IntendedPath()
    for fix, offset in zip(fixes, offsets, strict=True):
        intended.add(received_fix(fix), offset)
    return intended.corrected(window_of(fixes), [fix.measured_at for fix in fixes], share)


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
    for share, left in ((1.0, 0.0), (0.25, 0.75), (0.0, 1.0)):
        window = moved_back(fixes, [offset] * len(fixes), share)
        for k, (east, north) in enumerate(zip(window.east, window.north, strict=True)):
            foot = path.project(east, north, float(k))
            assert foot.lateral == pytest.approx(left * offset, abs=1e-9)


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


def test_offsets_are_measured_from_the_lead_if_it_is_received() -> None:
    path = road("straight", 0.3)
    of_lead = moved(window_of([fix_beside(path, k, 0.0) for k in range(30)]), 10.0)
    of_predecessor = moved(window_of([fix_beside(path, k, 0.06) for k in range(30)]), 10.0)
    fit = fit_two(of_lead, of_predecessor, alpha=0.5, settings=SETTINGS)
    assert fit is not None
    fix = fix_beside(path, 21, 0.2, spacing=0.5)
    assert fit.spline.project(fix.east, fix.north).lateral == pytest.approx(0.17, abs=1e-3)
    assert path_offset(fit, fix) == pytest.approx(0.2, abs=1e-6)


def test_offsets_are_measured_from_the_line_between_samples_not_from_the_curve() -> None:
    """Every second sample lies 2 cm to the left; at a quarter of the step it is 1.5 cm."""
    path = road("straight", 1.1)
    fixes = [fix_beside(path, k, 0.02 * (k % 2 == 0)) for k in range(30)]
    fit = fit_of(moved(window_of(fixes), 10.0))
    fix = fix_beside(path, 41, 0.1, spacing=0.25)
    assert path_offset(fit, fix) == pytest.approx(0.1 - 0.015, abs=1e-4)


def test_without_samples_on_both_sides_the_offset_is_nan() -> None:
    path = road("left", 2.0)
    fit = fit_of(moved(window_of([fix_beside(path, k, 0.0) for k in range(10, 30)]), 5.0))
    assert math.isnan(path_offset(fit, fix_beside(path, 8, 0.1)))
    assert not math.isnan(path_offset(fit, fix_beside(path, 12, 0.1)))
    assert math.isnan(path_offset(fit, fix_beside(path, 31, 0.1)))


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
        window = intended.corrected(window_of(fixes), [fix.measured_at for fix in fixes], 1.0)
        feet = [
            path.project(e, n, 30.0, 60.0).lateral
            for e, n in zip(window.east, window.north, strict=True)
        ]
        assert max(map(abs, feet)) < largest + 1e-3
        assert float(np.std(feet)) < first + 1e-3


@given(
    st.lists(st.floats(), min_size=2, max_size=30),
    st.floats(min_value=-1e6, max_value=1e6),
)
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


@pytest.mark.parametrize("offset", [math.nan, math.inf, 1.82, -80.0])
def test_an_unknown_or_impossible_offset_counts_as_zero(offset: float) -> None:
    fixes = [fix_beside(road("right", 0.4), k, 0.3) for k in range(20)]
    window, driven = moved_back(fixes, [offset] * 20), window_of(fixes)
    assert np.array_equal(window.east, driven.east)
    assert np.array_equal(window.north, driven.north)


def test_the_stated_error_of_a_fix_may_be_all_of_its_offset() -> None:
    """A car on the path whose fix is 2.2 m beside it announces 2.2 m."""
    path, offset = road("right", 0.4), 2.2
    fixes, intended = [fix_beside(path, k, offset) for k in range(20)], IntendedPath()
    for fix in fixes:
        fix.accuracy = 1.5
        intended.add(received_fix(fix), offset)
    instants = [fix.measured_at for fix in fixes]
    window = intended.corrected(window_of(fixes), instants, 1.0)
    on_path = window_of([fix_beside(path, k, 0.0) for k in range(20)])
    assert np.allclose(window.east, on_path.east)
    assert np.allclose(window.north, on_path.north)


def test_offsets_are_interpolated_and_held_at_the_ends() -> None:
    path, intended = road("straight", 0.0), IntendedPath()
    intended.add(received_fix(fix_beside(path, 4, 0.0)), 0.2)
    intended.add(received_fix(fix_beside(path, 8, 0.0)), -0.2)
    fixes = [fix_beside(path, k, 0.0) for k in (0, 4, 5, 6, 8, 12)]
    instants = [-1, *(fix.measured_at for fix in fixes[1:])]  # a bridge has no instant
    window = intended.corrected(window_of(fixes), instants, 1.0)
    assert window.north + 50.0 == pytest.approx([-0.2, -0.2, -0.1, 0.0, 0.2, 0.2])


@given(st.permutations(range(12)))
def test_the_order_of_arrival_does_not_matter(order: list[int]) -> None:
    fixes = [fix_beside(road("left", 0.0), k, 0.1) for k in range(12)]
    offsets = [0.1 + 0.02 * math.sin(k) for k in range(12)]
    intended = IntendedPath()
    for k in (*order, *order):  # each twice
        intended.add(received_fix(fixes[k]), offsets[k])
    instants = [fix.measured_at for fix in fixes]
    window, expected = (
        intended.corrected(window_of(fixes), instants, 1.0),
        moved_back(fixes, offsets),
    )
    assert np.array_equal(window.east, expected.east)
    assert np.array_equal(window.north, expected.north)


def test_a_standing_car_adds_no_offsets() -> None:
    path, intended = road("straight", 0.0), IntendedPath()
    driven = [fix_beside(path, k, 0.0) for k in range(3)]
    for fix in driven:
        intended.add(received_fix(fix), 0.1)
    for seq in range(3, 9000):
        stands = fix_beside(path, 2, 0.0)
        stands.measured_at = seq * PERIOD
        intended.add(received_fix(stands), 0.1 + 0.01 * math.sin(seq))
    window = intended.corrected(window_of(driven), [fix.measured_at for fix in driven], 1.0)
    assert window.north + 50.0 == pytest.approx([-0.1] * 3)


def test_a_trace_knows_the_instants_of_a_window() -> None:
    path, trace = road("left", 1.0), Trace()
    fixes = [fix_beside(path, k, 0.0) for k in range(50)]
    for fix in fixes:
        trace.add(received(fix.measured_at, fix.east, fix.north, fix.yaw, fix.speed))
    for here in (3.2, 11.7, 25.0):
        place = path.at(here)
        window = trace.window(place.east, place.north, 5.0, 9.0)
        chosen = [fixes[at // PERIOD] for at in trace.instants(window)]
        assert [fix.east for fix in chosen] == window.east.tolist()
        assert [fix.north for fix in chosen] == window.north.tolist()


def test_the_share_changes_without_a_step() -> None:
    share, seen = IntendedShare(1.0, "intended"), []
    spells: list[tuple[Mode, float]] = [
        ("composite", 1.0), ("predecessor", 0.6), ("composite", 0.2), ("predecessor", 2.0),
        ("coast", 1.0), ("stop", 1.0), ("predecessor", 0.5), ("lead", 2.0),
    ]  # fmt: skip
    for mode, seconds in spells:
        for _ in range(round(seconds * 50)):
            if mode not in {"coast", "stop"}:
                share.advance(0.02, without_lead=mode == "predecessor")
        seen.append(share.value)
    assert seen == pytest.approx([0.0, 0.6, 0.4, 1.0, 1.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize(("path", "value"), [("driven", 0.0), ("always_intended", 1.0)])
def test_the_share_of_other_paths_stays(path: PredecessorPath, value: float) -> None:
    share = IntendedShare(1.0, path)
    for without_lead in (False, True, False):
        share.advance(5.0, without_lead=without_lead)
        assert share.value == value


def test_memory_is_bounded() -> None:
    tracemalloc.start()
    try:
        intended = IntendedPath()
        before, _ = tracemalloc.get_traced_memory()
        for seq in range(3 * CAPACITY):
            intended.add(received(seq * PERIOD, float(seq), 0.0, 0.0, 20.0), 0.001 * (seq % 7))
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 64 * CAPACITY
