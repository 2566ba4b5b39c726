"""How long a composite fit takes: `python -m tests.bench.bench_trajectory`.

Prints microseconds per fit for each shape and number of samples, and beside it a baseline measured
in the same run: numpy's own least-squares solver on the paper's three equations for one circle,
without any choice of shape. Times are of the processor, so that busy neighbours matter less.
"""

import sys
import timeit
from collections.abc import Callable
from functools import partial
from time import process_time

import numpy as np

from tests.vehicles.arc_courses import course, shaken, window
from vehicles.samples import Window
from vehicles.trace import Trace
from vehicles.trajectory import FitSettings, fit_composite

SHAPES = {
    "line": [(0.0, 32.0)],
    "arc": [(1 / 300, 32.0)],
    "line-arc": [(0.0, 14.0), (1 / 150, 18.0)],
    "arc-line": [(1 / 150, 16.0), (0.0, 16.0)],
}
LENGTH, EGO = 30.0, 7.0
ROUNDS = 7


def microseconds(work: Callable[[], object], calls: int = 500) -> tuple[float, float]:
    """Best and median time of one call over several rounds."""
    rounds = sorted(timeit.repeat(work, timer=process_time, number=calls, repeat=ROUNDS))
    return rounds[0] / calls * 1e6, rounds[ROUNDS // 2] / calls * 1e6


def samples(pieces: list[tuple[float, float]], count: int) -> tuple[Window, Window]:
    """Half of the samples from the lead, half from the predecessor, 2 cm of noise."""
    random, path = np.random.default_rng(4), course(pieces)
    lead = window(path, np.linspace(0.0, LENGTH, count - count // 2), EGO)
    predecessor = window(path, np.linspace(0.7, LENGTH - 0.4, count // 2), EGO)
    return shaken(lead, random), shaken(predecessor, random)


def circle(lead: Window, predecessor: Window) -> object:
    """The paper's circle alone, by a general solver."""
    east = np.concatenate((lead.east, predecessor.east))
    north = np.concatenate((lead.north, predecessor.north))
    design = np.stack((east, north, np.ones(len(east))), axis=1)
    return np.linalg.lstsq(design, east * east + north * north, rcond=None)


def trace_of(count: int) -> Trace:
    """A straight trace at 30 m/s and 20 Hz."""
    trace = Trace()
    for k in range(count):
        trace.add((k + 1) * 50_000_000, 1.5 * k, 0.0, 0.0, 30.0)
    return trace


def main() -> int:
    """Print the table."""
    print(f"{'':26s}{'best, µs':>10s}{'median, µs':>12s}")
    settings = FitSettings()
    for count in (16, 40, 80):
        for name, pieces in SHAPES.items():
            lead, predecessor = samples(pieces, count)
            best, median = microseconds(
                partial(fit_composite, lead, predecessor, alpha=0.5, settings=settings)
            )
            print(f"{name + f', {count} samples':26s}{best:10.1f}{median:12.1f}")
        best, median = microseconds(partial(circle, lead, predecessor))
        print(f"{f'baseline, {count} samples':26s}{best:10.1f}{median:12.1f}")
    trace, place = trace_of(2000), iter(range(10**9))
    best, median = microseconds(
        lambda: trace.window(1000.0 + 0.01 * next(place), 0.1, 7.5, 24.0), 1000
    )
    print(f"{'window of a trace':26s}{best:10.1f}{median:12.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
