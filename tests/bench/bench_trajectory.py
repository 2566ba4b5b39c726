"""Time of a composite fit: `python -m tests.bench.bench_trajectory`.

Prints microseconds per fit for each shape and number of samples, and of a decision on new poses
(fit and steering law). The yardstick for comparing machines is numpy's least-squares solver on the
paper's three equations for one circle, without selection of a shape. Times are processor times; the
budget is 100 µs for the median of a decision at 40 samples.
"""

import sys
import timeit
from collections.abc import Callable
from functools import partial
from time import process_time

import numpy as np

from tests.made.transport.received_poses import received
from tests.made.vehicles.arc_courses import course, window, with_noise
from tests.made.vehicles.fusions import fit_two
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.driver.ego.own_state import Pose
from vehicles.driver.steering import SlipCompensated
from vehicles.driver.tracking import track
from vehicles.geometry import arc_spline
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.received.samples import Window
from vehicles.preview.received.trace import Trace
from vehicles.preview.trajectory import Fit

SHAPES = {
    "line": [(0.0, 32.0)],
    "arc": [(1 / 300, 32.0)],
    "line-arc": [(0.0, 14.0), (1 / 150, 18.0)],
    "arc-line": [(1 / 150, 16.0), (0.0, 16.0)],
    "clothoid": [(k / 1500, 1.0) for k in range(-8, 24)],
    "gentle clothoid": [(k / 10000, 1.0) for k in range(-8, 24)],
    "S-bend": [(1 / 150, 16.0), (-1 / 150, 16.0)],
    "two arcs": [(1 / 150, 16.0), (1 / 50, 16.0)],
}
LENGTH, EGO, SPEED = 30.0, 7.0, 25.0
ROUNDS, DRAWS = 7, 50


def microseconds(work: Callable[[int], object], calls: int = 500) -> tuple[float, float]:
    """Mean time (µs) of a call, best and median of several rounds; `work` takes its number."""

    def round_of_calls() -> None:
        for k in range(calls):
            work(k)

    rounds = sorted(timeit.repeat(round_of_calls, timer=process_time, number=1, repeat=ROUNDS))
    return rounds[0] / calls * 1e6, rounds[ROUNDS // 2] / calls * 1e6


def samples(pieces: list[tuple[float, float]], count: int, seed: int) -> tuple[Window, Window]:
    """Half of the samples from the lead, half from the predecessor, 2 cm of noise."""
    random, path = np.random.default_rng(seed), course(pieces)
    lead = window(path, np.linspace(0.0, LENGTH, count - count // 2), EGO)
    predecessor = window(path, np.linspace(0.7, LENGTH - 0.4, count // 2), EGO)
    return with_noise(lead, random), with_noise(predecessor, random)


def circle(windows: tuple[Window, Window], _: int) -> object:
    """The paper's circle by a general solver."""
    lead, predecessor = windows
    east = np.concatenate((lead.east, predecessor.east))
    north = np.concatenate((lead.north, predecessor.north))
    design = np.stack((east, north, np.ones(len(east))), axis=1)
    return np.linalg.lstsq(design, east * east + north * north, rcond=None)


def trace_of(count: int) -> Trace:
    """A straight trace at 30 m/s and 20 Hz."""
    trace = Trace()
    for k in range(count):
        trace.add(received((k + 1) * 50_000_000, 1.5 * k, 0.0, 0.0, 30.0))
    return trace


def row(name: str, *works: Callable[[int], object]) -> None:
    """Measure and print a row."""
    print(f"{name:26s}", end="")
    for work in works:
        best, median = microseconds(work)
        print(f"{best:12.1f}{median:12.1f}", end="")
    print(flush=True)


def fits_of(pieces: list[tuple[float, float]], count: int) -> Callable[[int], Fit | None]:
    """A function that fits the draws of noise in turn."""
    draws, settings = [samples(pieces, count, seed) for seed in range(DRAWS)], FitSettings()
    return lambda k: fit_two(*draws[k % DRAWS], alpha=0.5, settings=settings)


def decisions_of(pieces: list[tuple[float, float]], count: int) -> Callable[[int], object]:
    """A function that fits, and steers along the fit with a small offset."""
    fit, law = fits_of(pieces, count), SlipCompensated(LINCOLN_MKZ)
    place = course(pieces).at(EGO)
    yaw_rate = SPEED * place.curvature
    pose = Pose(place.east + 0.02, place.north - 0.01, place.yaw + 1e-3, SPEED, yaw_rate)

    def work(k: int) -> object:
        fit_result = fit(k)
        assert fit_result is not None
        return law.steer(track(fit_result.spline, pose), SPEED)

    return work


def main() -> int:
    print("code:", "interpreted" if arc_spline.__file__.endswith(".py") else "compiled")
    print(f"{'µs':26s}{'fit: best':>12s}{'median':>12s}{'with law':>12s}{'median':>12s}")
    for count in (16, 40, 80):
        for name, pieces in SHAPES.items():
            row(f"{name}, {count} samples", fits_of(pieces, count), decisions_of(pieces, count))
        row(f"yardstick, {count} samples", partial(circle, samples(SHAPES["arc"], count, 0)))
    trace = trace_of(2000)
    row("window of a trace", lambda k: trace.window(1000.0 + 0.01 * k, 0.1, 7.5, 24.0))
    return 0


if __name__ == "__main__":
    sys.exit(main())
