"""Shapes of known truth, drawn at random, and the error that no unbiased fit of them can beat.

Independent of the fit: a shape is a curvature over the way, integrated numerically, and the bound
is the covariance of least squares with the shape's own unknowns, taken from numerical derivatives.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import fit_composite

Floats = NDArray[np.float64]
NOISE = 0.02
GNSS_HZ = 20.0
SPACING = 0.2
"""A trace keeps no samples closer together than this (m)."""
GRID = 0.01
SETTINGS = FitSettings()


@dataclass(frozen=True)
class Shape:
    """Curvature by place: `unknowns` and what they mean, and where both sources were measured.

    The unknowns begin with curvatures (1/m) and end with places (m); offset and heading of the
    whole come on top. `stations` are those of the lead's and of the predecessor's samples, the
    car being at 0.
    """

    unknowns: tuple[float, ...]
    curvature: Callable[[tuple[float, ...], Floats], Floats]
    stations: tuple[Floats, Floats]

    @property
    def end(self) -> float:
        return max(float(stations[-1]) for stations in self.stations)

    def laid(self, unknowns: tuple[float, ...], at: Floats) -> tuple[Floats, Floats, Floats]:
        """East, north and yaw at places, from (0, 0) eastward at the car's."""
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
        """Standard deviation (m) of least squares beside the car and at the end of the preview."""
        both = np.concatenate(self.stations)
        at = np.concatenate((both, [0.0, self.end]))
        east, north, yaw = self.laid(self.unknowns, at)
        columns = [np.cos(yaw), east * np.cos(yaw) + north * np.sin(yaw)]
        for k, value in enumerate(self.unknowns):
            step = 1e-5 if abs(value) < 0.5 else 1e-2
            moved = [
                self.laid((*self.unknowns[:k], value + side, *self.unknowns[k + 1 :]), at)
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
        """How far (m) the fit to samples with noise is off beside the car and at the end."""
        windows = []
        turn, shift = random.uniform(-np.pi, np.pi), random.uniform(-500.0, 500.0, 2)

        def in_world(at: Floats) -> Floats:
            east, north, _ = self.laid(self.unknowns, at)
            cos, sin = np.cos(turn), np.sin(turn)
            return np.stack((east * cos - north * sin, east * sin + north * cos)).T + shift

        for stations in self.stations:
            places = in_world(stations) + NOISE * random.standard_normal((len(stations), 2))
            windows.append(Window(places[:, 0].copy(), places[:, 1].copy(), stations.copy()))
        fit = fit_composite(windows[0], windows[1], alpha=0.5, settings=SETTINGS)
        assert fit is not None
        here, end = in_world(np.array([0.0, self.end])).tolist()
        return fit.spline.project(*here).lateral, fit.spline.project(*end).lateral


def measured(random: np.random.Generator, low: float, high: float, step: float) -> Floats:
    """Places every `step` (m) from `low` to `high`, begun anywhere."""
    step = max(step, SPACING)
    places = np.arange(low + random.uniform(0.0, step), high, step)
    stride = 1 << (max(len(places) - 1, 0) // 40).bit_length()
    return places[::stride]


def both(random: np.random.Generator, speed: float) -> tuple[Floats, Floats]:
    """Places of both sources in the window of a car at `speed` (m/s)."""
    low, high = -SETTINGS.behind(speed), SETTINGS.ahead(speed)
    step = speed / GNSS_HZ
    return measured(random, low, high, step), measured(random, low, high, step)


def bent(random: np.random.Generator, speed: float) -> float:
    """A curvature (1/m) that a car drives at `speed`: from 0.5 to 3 m/s², radius from 6 m."""
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
    return Shape((bent(random, speed),), _constant, both(random, speed))


def clothoid(random: np.random.Generator) -> Shape:
    """From one curvature to another within the window, as where a road turns into a bend."""
    speed = random.uniform(3.0, 35.0)
    seen = both(random, speed)
    first, last = (random.uniform(-1.0, 1.0) * bent(random, speed) for _ in range(2))
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
    return Shape((bent(random, speed), _join(random, speed)), form, seen)


def s_bend(random: np.random.Generator) -> Shape:
    speed = random.uniform(3.0, 35.0)
    seen = both(random, speed)
    first, other = bent(random, speed), bent(random, speed)
    return Shape((first, -np.copysign(other, first), _join(random, speed)), _step, seen)


def u_turn(random: np.random.Generator) -> Shape:
    """Straight, half a circle of 6 to 12 m, straight, from anywhere in it; at 3 to 5 m/s."""
    speed = random.uniform(3.0, 5.0)
    radius, side = random.uniform(6.0, 12.0), random.choice([-1.0, 1.0])
    length = np.pi * radius
    begin = -random.uniform(0.0, length) if random.uniform() < 0.5 else _join(random, speed)
    if random.uniform() < 0.5:
        return Shape((side / radius, begin), _step_up, both(random, speed))
    return Shape((side / radius, begin + length), _step_down, both(random, speed))


def stop_and_go(random: np.random.Generator) -> Shape:
    """A source that brakes to a stop and starts again at 2 m/s², its samples crowding there."""
    speed = random.uniform(3.0, 12.0)
    bend = bent(random, speed)
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
    """Root mean squares over many draws (m), beside the car and at the end of the preview."""

    errors: tuple[float, float]
    bounds: tuple[float, float]

    @property
    def ratios(self) -> tuple[float, float]:
        return self.errors[0] / self.bounds[0], self.errors[1] / self.bounds[1]


def drawn(kind: Callable[[np.random.Generator], Shape], draws: int, seed: int = 1) -> Row:
    """Fit `draws` shapes of a kind, each with noise of its own."""
    random = np.random.default_rng(seed)
    errors, bounds = [], []
    for _ in range(draws):
        shape = kind(random)
        bounds.append(shape.bound())
        errors.append(shape.errors(random))
    error = np.sqrt(np.mean(np.square(errors), axis=0))
    bound = np.sqrt(np.mean(np.square(bounds), axis=0))
    return Row((float(error[0]), float(error[1])), (float(bound[0]), float(bound[1])))
