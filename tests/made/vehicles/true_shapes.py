"""Random shapes of known truth, and a lower bound of the error of unbiased fits.

Independent of the fit: a shape is a curvature over distance, integrated numerically. The bound is
the covariance of least squares in the unknowns of the shape, by numerical derivatives.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.made.vehicles.fusions import fit_two
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window

Floats = NDArray[np.float64]
NOISE = 0.02
GNSS_HZ = 20.0
SPACING = 0.2
"""Least distance (m) of samples in a trace."""
GRID = 0.01
SETTINGS = FitSettings()


@dataclass(frozen=True)
class Shape:
    """Curvature by station, with `unknowns`: curvatures (1/m), then stations (m) of joins.

    Offset and heading of the shape are further unknowns. `stations` are those of the samples of
    lead and predecessor; the car is at 0.
    """

    unknowns: tuple[float, ...]
    curvature: Callable[[tuple[float, ...], Floats], Floats]
    stations: tuple[Floats, Floats]

    @property
    def end(self) -> float:
        return max(float(stations[-1]) for stations in self.stations)

    def coordinates(self, unknowns: tuple[float, ...], at: Floats) -> tuple[Floats, Floats, Floats]:
        """East, north and yaw at stations; the car is at (0, 0), facing east."""
        low, high = min(float(at.min()), 0.0) - GRID, max(float(at.max()), 0.0) + GRID
        grid = np.arange(np.floor(low / GRID), np.ceil(high / GRID) + 1.0) * GRID
        middles = grid[:-1] + 0.5 * GRID
        zero = int(np.argmin(np.abs(grid)))
        bend = GRID * self.curvature(unknowns, middles)
        yaw = np.concatenate(([0.0], np.cumsum(bend)))
        yaw -= yaw[zero]
        halfway = yaw[:-1] + 0.5 * bend
        east = np.concatenate(([0.0], np.cumsum(GRID * np.cos(halfway))))
        north = np.concatenate(([0.0], np.cumsum(GRID * np.sin(halfway))))
        east, north = east - east[zero], north - north[zero]
        return np.interp(at, grid, east), np.interp(at, grid, north), np.interp(at, grid, yaw)

    def bound(self) -> tuple[float, float]:
        """Standard deviation (m) of least squares at the car and at the end of the preview."""
        both = np.concatenate(self.stations)
        at = np.concatenate((both, [0.0, self.end]))
        east, north, yaw = self.coordinates(self.unknowns, at)
        columns = [np.cos(yaw), east * np.cos(yaw) + north * np.sin(yaw)]
        for k, value in enumerate(self.unknowns):
            step = 1e-5 if abs(value) < 0.5 else 1e-2
            moved = [
                self.coordinates((*self.unknowns[:k], value + side, *self.unknowns[k + 1 :]), at)
                for side in (step, -step)
            ]
            d_east = (moved[0][0] - moved[1][0]) / (2.0 * step)
            d_north = (moved[0][1] - moved[1][1]) / (2.0 * step)
            columns.append(d_north * np.cos(yaw) - d_east * np.sin(yaw))
        design = np.stack(columns, axis=1)
        samples, wanted = design[:-2], design[-2:]
        covariance = NOISE**2 * np.linalg.pinv(samples.T @ samples)
        deviations = np.sqrt(np.einsum("ij,jk,ik->i", wanted, covariance, wanted))
        return float(deviations[0]), float(deviations[1])

    def errors(self, random: np.random.Generator) -> tuple[float, float]:
        """Errors (m) of the fit to noisy samples at the car and at the end."""
        windows = []
        turn, shift = random.uniform(-np.pi, np.pi), random.uniform(-500.0, 500.0, 2)

        def in_world(at: Floats) -> Floats:
            east, north, _ = self.coordinates(self.unknowns, at)
            cos, sin = np.cos(turn), np.sin(turn)
            return np.stack((east * cos - north * sin, east * sin + north * cos)).T + shift

        for stations in self.stations:
            places = in_world(stations) + NOISE * random.standard_normal((len(stations), 2))
            windows.append(Window(places[:, 0].copy(), places[:, 1].copy(), stations.copy()))
        fit = fit_two(windows[0], windows[1], alpha=0.5, settings=SETTINGS)
        assert fit is not None
        here, end = in_world(np.array([0.0, self.end])).tolist()
        return fit.spline.project(*here).lateral, fit.spline.project(*end).lateral


def measured(random: np.random.Generator, low: float, high: float, step: float) -> Floats:
    """Stations every `step` (m) from `low` to `high`, with a random start."""
    step = max(step, SPACING)
    places = np.arange(low + random.uniform(0.0, step), high, step)
    stride = 1 << (max(len(places) - 1, 0) // 40).bit_length()
    return places[::stride]


def both(random: np.random.Generator, speed: float) -> tuple[Floats, Floats]:
    """Stations of both sources in the window of a car at `speed` (m/s)."""
    low, high = -SETTINGS.behind(speed), SETTINGS.ahead(speed)
    step = speed / GNSS_HZ
    return measured(random, low, high, step), measured(random, low, high, step)


def random_curvature(random: np.random.Generator, speed: float) -> float:
    """A curvature (1/m) at `speed`: 0.5 to 3 m/s² lateral acceleration, radius from 6 m."""
    side = float(random.choice([-1.0, 1.0]))
    return side * min(float(random.uniform(0.5, 3.0)) / speed**2, 1.0 / 6.0)


def _constant(unknowns: tuple[float, ...], at: Floats) -> Floats:
    return np.full_like(at, unknowns[0] if unknowns else 0.0)


def _ramp(unknowns: tuple[float, ...], at: Floats) -> Floats:
    return unknowns[0] + unknowns[1] * at


def _step(unknowns: tuple[float, ...], at: Floats) -> Floats:
    before, after, join = unknowns
    return np.where(at < join, before, after)


def _step_down(unknowns: tuple[float, ...], at: Floats) -> Floats:
    return _step((unknowns[0], 0.0, unknowns[1]), at)


def _step_up(unknowns: tuple[float, ...], at: Floats) -> Floats:
    return _step((0.0, *unknowns), at)


def line(random: np.random.Generator) -> Shape:
    return Shape((), _constant, both(random, random.uniform(3.0, 35.0)))


def arc(random: np.random.Generator) -> Shape:
    speed = random.uniform(3.0, 35.0)
    return Shape((random_curvature(random, speed),), _constant, both(random, speed))


def clothoid(random: np.random.Generator) -> Shape:
    speed = random.uniform(3.0, 35.0)
    seen = both(random, speed)
    first, last = (random.uniform(-1.0, 1.0) * random_curvature(random, speed) for _ in range(2))
    low, high = -SETTINGS.behind(speed), SETTINGS.ahead(speed)
    rate = (last - first) / (high - low)
    return Shape((first - rate * low, rate), _ramp, seen)


def _join(random: np.random.Generator, speed: float) -> float:
    low, high = -SETTINGS.behind(speed), SETTINGS.ahead(speed)
    return float(low + random.uniform(0.25, 0.75) * (high - low))


def line_arc(random: np.random.Generator) -> Shape:
    speed = random.uniform(3.0, 35.0)
    seen = both(random, speed)
    form = (_step_up, _step_down)[int(random.integers(2))]
    return Shape((random_curvature(random, speed), _join(random, speed)), form, seen)


def s_bend(random: np.random.Generator) -> Shape:
    speed = random.uniform(3.0, 35.0)
    seen = both(random, speed)
    first, other = random_curvature(random, speed), random_curvature(random, speed)
    return Shape((first, -np.copysign(other, first), _join(random, speed)), _step, seen)


def u_turn(random: np.random.Generator) -> Shape:
    """Straight, half a circle of 6 to 12 m radius, straight, at 3 to 5 m/s; random start."""
    speed = random.uniform(3.0, 5.0)
    radius, side = random.uniform(6.0, 12.0), random.choice([-1.0, 1.0])
    length = np.pi * radius
    begin = -random.uniform(0.0, length) if random.uniform() < 0.5 else _join(random, speed)
    if random.uniform() < 0.5:
        return Shape((side / radius, begin), _step_up, both(random, speed))
    return Shape((side / radius, begin + length), _step_down, both(random, speed))


def stop_and_go(random: np.random.Generator) -> Shape:
    """A source that stops and starts at 2 m/s²; samples are dense at the stop."""
    speed = random.uniform(3.0, 12.0)
    bend = random_curvature(random, speed)
    low, high = -SETTINGS.behind(speed), SETTINGS.ahead(speed)
    seen = []
    for _ in range(2):
        stop = random.uniform(low, high)
        time = np.arange(-8.0, 8.0, 1.0 / GNSS_HZ) + random.uniform(0.0, 1.0 / GNSS_HZ)
        places = stop + np.sign(time) * time * time  # 2 m/s² to and from the stop
        kept = [float(places[0])]
        for place in places[1:].tolist():
            if place - kept[-1] >= SPACING:
                kept.append(place)
        chosen = np.array([place for place in kept if low <= place <= high])
        stride = 1 << (max(len(chosen) - 1, 0) // 40).bit_length()
        seen.append(chosen[::stride])
    form = int(random.integers(4))
    if form == 0:
        return Shape((), _constant, (seen[0], seen[1]))
    if form == 1:
        return Shape((bend,), _constant, (seen[0], seen[1]))
    if form == 2:
        rate = bend / (high - low)
        return Shape((-rate * low, rate), _ramp, (seen[0], seen[1]))
    return Shape((bend, _join(random, speed)), _step_up, (seen[0], seen[1]))


SMOOTH = {"line": line, "arc": arc, "clothoid": clothoid}
"""Shapes whose curvature is continuous in the window."""
JUMPING = {"line and arc": line_arc, "S-bend": s_bend, "U-turn": u_turn, "stop and go": stop_and_go}
"""Shapes whose curvature may jump in the window."""


@dataclass(frozen=True)
class Row:
    """Root mean squares over all draws (m), at the car and at the end of the preview."""

    errors: tuple[float, float]
    bounds: tuple[float, float]

    @property
    def ratios(self) -> tuple[float, float]:
        return self.errors[0] / self.bounds[0], self.errors[1] / self.bounds[1]


def drawn(kind: Callable[[np.random.Generator], Shape], draws: int, seed: int = 1) -> Row:
    """Fit `draws` shapes of a kind with independent noise."""
    random = np.random.default_rng(seed)
    errors, bounds = [], []
    for _ in range(draws):
        shape = kind(random)
        bounds.append(shape.bound())
        errors.append(shape.errors(random))
    error = np.sqrt(np.mean(np.square(errors), axis=0))
    bound = np.sqrt(np.mean(np.square(bounds), axis=0))
    return Row((float(error[0]), float(error[1])), (float(bound[0]), float(bound[1])))
