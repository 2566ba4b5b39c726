"""Bridges over the path of a source while it was lost."""

import numpy as np
import pytest

from tests.made.transport.received_poses import received
from tests.made.vehicles.fusions import fit_two
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trace import Trace
from vehicles.schedule import SECOND

SPEED, PERIOD = 20.0, SECOND // 20
ROADS = {
    "straight": path_from_segments([Segment(400.0, 0.0)], yaw=1.0),
    "left": path_from_segments([Segment(400.0, 1 / 150)], 5.0, 7.0, 2.0),
    "right": path_from_segments([Segment(400.0, -1 / 150)], yaw=-3.0),
    "into a bend": path_from_segments([Segment(120.0, 0.0), Segment(300.0, 1 / 300)]),
}


def receive_all(
    path: SampledPath, trace: Trace, numbers: range, *, after_hole: bool = False
) -> None:
    for seq in numbers:
        receive(path, trace, seq, after_hole=after_hole and seq == numbers[0])


def receive(path: SampledPath, trace: Trace, seq: int, *, after_hole: bool = False) -> None:
    point = path.at(seq * PERIOD * SPEED / SECOND)
    place = point.east, point.north, point.yaw
    trace.add(received(seq * PERIOD, *place, SPEED), after_hole=after_hole)


def farthest(path: SampledPath, trace: Trace, station: float) -> float:
    """Largest distance (m) from the path of held points within 80 m of `station`."""
    point = path.at(station)
    window = trace.window(point.east, point.north, 80.0, 80.0)
    places = zip(*(one.tolist() for one in window), strict=True)
    return max(
        abs(path.project(east, north, station + along).lateral) for east, north, along in places
    )


@pytest.mark.parametrize("road", ROADS)
@pytest.mark.parametrize("hole", [10, 30, 60])
def test_a_hole_is_bridged_by_a_curve(road: str, hole: int) -> None:
    """One metre per message: on a circle the bridge is exact, otherwise close."""
    path, trace = ROADS[road], Trace()
    receive_all(path, trace, range(100))
    receive_all(path, trace, range(100 + hole, 250), after_hole=True)
    here = 0.0
    for station in range(100 + hole):  # drive there: the station is tracked
        point = path.at(float(station))
        here = trace.known_ahead(point.east, point.north)
    assert here == pytest.approx(249.0 - (99.0 + hole), abs=0.6)
    exact = road != "into a bend"
    sagitta = hole * hole / 8.0 / 150.0
    assert farthest(path, trace, 99.0 + hole) < (0.05 if exact else max(sagitta / 2, 0.1))


def test_late_samples_within_a_hole_are_ignored() -> None:
    path, trace = ROADS["left"], Trace()
    receive_all(path, trace, range(100))
    receive_all(path, trace, range(150, 250), after_hole=True)
    hole, count = trace.holes, len(trace)
    receive_all(path, trace, range(105, 150, 5))
    assert (trace.holes, len(trace)) == (hole, count)


@pytest.mark.spread(3)
@pytest.mark.parametrize("road", ["straight", "left", "right"])
@pytest.mark.parametrize("hole", [6, 9, 13])
def test_in_a_hole_the_trajectory_passes_the_car(road: str, hole: int) -> None:
    """With the few samples ahead alone the error is at least twice as large."""
    path, settings, random = ROADS[road], FitSettings(), np.random.default_rng(hole)
    behind, ahead = settings.behind(SPEED / 2), settings.ahead(SPEED)
    off: dict[str, list[float]] = {"with one behind": [], "by those ahead": []}
    for _ in range(200):
        trace = Trace()
        for seq in (*range(100), *range(99 + hole, 104 + hole)):
            point = path.at(float(seq))
            east, north = (point.east, point.north) + 0.02 * random.standard_normal(2)
            trace.add(received(seq * PERIOD, east, north, point.yaw, SPEED))
        car = path.at(99.0 + hole - 5.0)
        window = trace.window(car.east, car.north, behind, ahead)
        assert window.station[0] < 0.0
        only = Window(*(values[window.station > 0.0] for values in window))
        for name, seen in (("with one behind", window), ("by those ahead", only)):
            fit = fit_two(seen, None, alpha=0.5, settings=settings)
            assert fit is not None
            off[name].append(abs(fit.spline.project(car.east, car.north).lateral))
    assert max(off["with one behind"]) < 0.3
    assert max(off["by those ahead"]) > 2.0 * max(off["with one behind"])
    assert np.median(off["with one behind"]) < 0.05


def test_four_noisy_samples_make_no_bend_by_chance() -> None:
    """With 2 cm of noise 1 % of straight roads would be bends of 340 m at the usual price."""
    random = np.random.default_rng(6)
    station = np.array([-8.5, -5.4, 2.1, 3.6])
    bends = list[float]()
    for _ in range(300):
        seen = Window(station, random.normal(0.0, 0.02, 4), station)
        fitted = fit_two(seen, None, alpha=0.5, settings=FitSettings())
        assert fitted is not None
        bends.append(abs(fitted.spline.at(10.0).curvature))
    assert float(np.quantile(bends, 0.99)) < 1e-5
    assert max(bends) < 1e-3
