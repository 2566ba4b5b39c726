"""Synthetic recorded drives: corners with curvature ramps, and receiver noise.

The curvature of a course is piecewise linear, as a driver turns the wheel. Its points have the
noise of an RTK receiver: white noise and a slow drift.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario, scenario_from_text

Points = NDArray[np.float64]
STEP = 0.05
"""Step (m) of the integration."""
SPACING = 0.8
"""Distance (m) between two recorded points."""
WHITE, WANDER, WANDER_LENGTH = 0.01, 0.015, 40.0
"""Noise: white (m), and a drift of this standard deviation (m) and correlation length (m)."""
Knots = Sequence[tuple[float, float]]
"""Length (m) of a stretch and curvature (1/m) at its end; the first begins straight."""


def course_points(knots: Knots) -> Points:
    """Points (2, n) every `SPACING` along stretches of linear curvature, from (0, 0) eastward."""
    places = np.concatenate(([0.0], np.cumsum([length for length, _ in knots])))
    curvatures = np.array([0.0, *(curvature for _, curvature in knots)])
    middle = np.arange(0.0, float(places[-1]), STEP) + 0.5 * STEP
    yaw = np.cumsum(STEP * np.interp(middle, places, curvatures))
    ahead = yaw - 0.5 * STEP * np.interp(middle, places, curvatures)
    east = np.cumsum(STEP * np.cos(ahead))
    north = np.cumsum(STEP * np.sin(ahead))
    points: Points = np.stack((east, north))[:, :: round(SPACING / STEP)]
    return points


def corner(angle: float, radius: float, ramp: float) -> Knots:
    """Turn by `angle` (rad, left positive) at a radius (m), with a `ramp` (m) at both ends."""
    curvature = np.copysign(1.0 / radius, angle)
    arc = abs(angle) * radius - ramp
    assert arc > 0.0, "the ramps alone turn further"
    return [(ramp, float(curvature)), (arc, float(curvature)), (ramp, 0.0)]


def around_the_block() -> Points:
    quarter = 0.5 * np.pi
    knots: list[tuple[float, float]] = [(80.0, 0.0)]
    for side, radius, ramp in (
        *((1.0, 8.0, 6.0), (1.0, 10.0, 7.0), (1.0, 7.0, 5.0), (1.0, 9.0, 8.0)),
        *((-1.0, 8.0, 6.0), (-1.0, 7.0, 5.0), (1.0, 10.0, 6.0)),
    ):
        knots += [*corner(side * quarter, radius, ramp), (70.0, 0.0)]
    return course_points(knots)


def slalom() -> Points:
    x = np.arange(0.0, 400.0, STEP)
    inside = (x > 100.0) & (x < 100.0 + 12 * 18.0)
    swing = 2.0 * np.pi / 36.0
    fade = np.clip((x - 100.0) / 18.0, 0.0, 1.0) * np.clip((316.0 - x) / 18.0, 0.0, 1.0)
    y = np.where(inside, 1.5 * np.sin(swing * (x - 100.0)) * fade * fade * (3.0 - 2.0 * fade), 0.0)
    return _resampled(np.stack((x, y)))


def roundabout() -> Points:
    """Three quarters of a roundabout of 16 m radius, counter-clockwise."""
    turn = 0.25 * np.pi
    return course_points(
        [
            (80.0, 0.0),
            *corner(-turn, 18.0, 8.0),
            (1.0, 0.0),
            *corner(1.5 * np.pi + 2.0 * turn - 0.5 * np.pi, 16.0, 9.0),
            (1.0, 0.0),
            *corner(-turn, 18.0, 8.0),
            (90.0, 0.0),
        ]
    )


def track(length: float = 5000.0) -> Points:
    """A closed race track of varying curvature, radius from about 20 m."""
    round_ = np.linspace(0.0, 2.0 * np.pi, 400_001)
    radius = (
        1.0
        + 0.34 * np.cos(2.0 * round_ + 0.4)
        + 0.16 * np.cos(3.0 * round_ + 1.9)
        + 0.10 * np.cos(5.0 * round_ + 4.0)
        + 0.055 * np.cos(9.0 * round_ + 2.2)
    )
    outline = radius * np.stack((np.cos(round_), np.sin(round_)))
    length_now = float(np.sum(np.hypot(*np.diff(outline))))
    return _resampled(outline * (length / length_now))


def _resampled(line: Points) -> Points:
    distance = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line)))))
    at = np.arange(0.0, float(distance[-1]), SPACING)
    return np.stack((np.interp(at, distance, line[0]), np.interp(at, distance, line[1])))


def with_receiver_noise(points: Points, seed: int) -> Points:
    random = np.random.default_rng(seed)
    keep = np.exp(-SPACING / WANDER_LENGTH)
    drift, wander = np.zeros(2), []
    for kick in random.standard_normal(points.T.shape):
        drift = keep * drift + WANDER * np.sqrt(1.0 - keep * keep) * kick
        wander.append(drift)
    noisy: Points = points + np.array(wander).T + WHITE * random.standard_normal(points.shape)
    return noisy


DRIVES: dict[str, tuple[Callable[[], Points], str, float]] = {
    "block": (around_the_block, "smoothing_m = 4.0", 12.0),
    "slalom": (slalom, "smoothing_m = 8.0", 12.0),
    "roundabout": (roundabout, "smoothing_m = 6.0", 12.0),
    "track": (track, "smoothing_m = 10.0\nclosed = true", 30.0),
}
"""Course, keys of the table [path], and set speed (m/s) of straights."""


def convoy_on(
    name: str, folder: Path, seed: int = 1, vehicles: int = 8, keys: str = ""
) -> Scenario:
    course, path, speed = DRIVES[name]
    points = with_receiver_noise(course(), seed)
    rows = "\n".join(f"{east:.4f},{north:.4f}" for east, north in points.T.tolist())
    (folder / f"{name}.csv").write_text(f"x_m,y_m\n{rows}\n", encoding="utf-8")
    text = f"""name = "{name}"
seed = {seed}
[convoy]
vehicles = {vehicles}
[path]
kind = "trace"
file = "{name}.csv"
{path}
[speed]
lead = "set"
set_mps = {speed}
followers = "gap"
lateral_acceleration_mps2_max = 2.5
{keys}
"""
    return scenario_from_text(text, label=f"{name}.toml", folder=folder)
