"""Jumps and stands: found where they are, and nothing else is taken for one."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.traces.cleaning import Cleaned, cleaned
from tests.made.examples import examples
from tests.made.scenarios.rough_drives import SWEEP, Rough


def of(rough: Rough, *, timed: bool = True) -> Cleaned:
    rows = np.array(rough.points())
    return cleaned(rows[:, 1:3].T.copy(), rows[:, 0] if timed else np.zeros(0))


@examples(13, 80)
@given(
    pieces=st.lists(
        st.tuples(st.sampled_from([6.0, 8.0, 12.0, 20.0, 50.0, 200.0, math.inf]), st.booleans()),
        min_size=1,
        max_size=5,
    ),
    speed=st.floats(1.5, 35.0),
    rate_hz=st.sampled_from([1.0, 5.0, 10.0, 20.0]),
    noise=st.sampled_from([0.0, 0.005, 0.02, 0.1]),
    timed=st.booleans(),
    hole=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_a_clean_drive_is_left_as_it_is(  # noqa: PLR0917 - what is drawn
    pieces: list[tuple[float, bool]],
    speed: float,
    rate_hz: float,
    noise: float,
    timed: bool,
    hole: bool,
    seed: int,
) -> None:
    course = tuple(
        (min(80.0, 2.5 * radius), (1.0 if left else -1.0) / radius) for radius, left in pieces
    )
    tightest = min(radius for radius, _ in pieces)
    speed = min(speed, math.sqrt(8.0 * tightest))
    rough = Rough(
        course=course,
        speed=speed,
        rate_hz=rate_hz,
        noise=noise,
        holes=((30.0, 15.0),) if hole and math.isinf(tightest) else (),
        seed=seed,
    )
    points = rough.points()
    found = of(rough, timed=timed)
    assert not found.jumps
    assert not found.stands
    assert found.kept.tolist() == list(range(len(points)))


@examples(8, 40)
@given(
    size=st.floats(1.0, 50.0),
    count=st.integers(1, 4),
    timed=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_jumps_are_left_out_and_nothing_else(
    size: float, count: int, timed: bool, seed: int
) -> None:
    if not timed:  # places 0.75 m apart do not tell where several of them belong
        size, count = size + 2.0, 1
    rough = Rough(
        course=SWEEP,
        speed=15.0,
        rate_hz=20.0,
        jumps=6,
        jump_size=size,
        jump_length=count,
        seed=seed,
    )
    plain = np.array(Rough(course=SWEEP, speed=15.0, rate_hz=20.0, seed=seed).points())
    rows = np.array(rough.points())
    jumped = set(np.flatnonzero(np.any(rows[:, 1:3] != plain[:, 1:3], axis=1)).tolist())
    assert len(jumped) == 6 * count
    found = of(rough, timed=timed)
    left_out = set(range(len(rows))) - set(found.kept.tolist())
    assert jumped <= left_out
    assert len(left_out - jumped) <= 2 * 6
    assert max(jump.size for jump in found.jumps) == pytest.approx(1.25 * size, rel=0.35)


def test_costs_are_proportional_to_points() -> None:
    """Hundreds of stops and jumps in 120,000 points."""
    at = 0.1 * np.arange(120_000.0)
    phase = at % 100.0
    speeds = np.clip(np.minimum(2.0 * (phase - 30.0), 2.0 * (100.0 - phase)), 0.0, 10.0)
    stations = 0.1 * np.cumsum(speeds)
    points = np.stack((300.0 * np.sin(stations / 300.0), 300.0 * np.cos(stations / 300.0)))
    points += np.random.default_rng(1).normal(0.0, 0.02, points.shape)
    jumping = np.arange(650, 120_000, 1000)
    points[:, jumping] += 5.0
    begun = time.process_time()
    found = cleaned(points, at)
    assert time.process_time() - begun < 3.0
    assert [jump.first for jump in found.jumps] == jumping.tolist()
    assert len(found.stands) == 120


def test_a_lane_change_and_a_hard_stop_are_no_jumps() -> None:
    t = np.arange(0.0, 20.0, 0.05)
    aside = 3.5 / (1.0 + np.exp(-(t - 10.0) / 0.3))  # within a second
    along = np.where(t < 10.0, 30.0 * t, 300.0 + np.minimum(30.0 * (t - 10.0), 45.0))
    points = np.stack((along, aside))
    assert cleaned(points, t).jumps == []


def test_a_crawl_is_no_stand() -> None:
    t = np.arange(0.0, 200.0, 0.2)
    points = np.stack((0.4 * t, np.zeros(t.size)))
    points += np.random.default_rng(1).normal(0.0, 0.02, points.shape)
    assert cleaned(points, t).stands == []


@pytest.mark.parametrize("share", [0.05, 0.1])
def test_many_jumps_are_no_noise(share: float) -> None:
    """Of a winding road; jumps next to each other, or with a point or two between, included."""
    random = np.random.default_rng(4)
    s = 0.5 * np.arange(30_000)
    yaw = s / 4000.0 + 1.2 * np.sin(s / 90.0)
    truth = np.cumsum([np.cos(yaw), np.sin(yaw)], axis=1) * 0.5
    points = truth + random.normal(0.0, 0.01, truth.shape)
    jumping = np.flatnonzero(random.random(s.size) < share)
    course = random.uniform(0.0, 2.0 * np.pi, jumping.size)
    points[:, jumping] += 30.0 * np.array([np.cos(course), np.sin(course)])
    left = cleaned(points, 0.05 * np.arange(float(s.size)))
    assert np.max(np.hypot(*(left.points - truth[:, left.kept]))) < 0.1
    assert s.size - left.kept.size == pytest.approx(jumping.size, rel=0.15)
