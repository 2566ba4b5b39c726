"""Errors of the fit alone, passed on along a chain of cars that follow their fits exactly.

In a convoy each car adds what its steering is off by; with a composite trajectory half of that is
passed on, so it grows to twice the first one's. Here nothing steers: whatever grows is the fit's.
"""

import numpy as np
import pytest

from tests.made.transport.received_poses import received
from tests.made.vehicles.fusions import fit_two
from vehicles.geometry.arc_spline import ArcSpline, Piece
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.samples import Window
from vehicles.preview.trace import Trace
from vehicles.schedule import SECOND

SETTINGS = FitSettings()
SPEED, STEP_S, CARS = 5.0, 0.04, 6
BEGIN, END = 12.0, 68.0
Drive = list[tuple[float, float, float]]


def corner(radius: float = 8.0, ramp: float = 6.0) -> ArcSpline:
    """A street corner of 90°: a ramp of curvature into the bend, and one out of it."""
    arc, rate = 0.5 * np.pi * radius - ramp, 1.0 / (radius * ramp)
    ends = (0.0, 34.0, 0.0)
    bend = ((0.0, ramp, rate), (1 / radius, arc, 0.0), (1 / radius, ramp, -rate))
    pieces, east, north, yaw = [], 0.0, 0.0, 0.0
    for curvature, length, change in (ends, *bend, ends):
        pieces.append(Piece(east, north, yaw, curvature, length, change))
        end = pieces[-1].at(length)
        east, north, yaw = end.east, end.north, end.yaw
    return ArcSpline(pieces)


def with_noise(drive: Drive, noise: float, random: np.random.Generator) -> Drive:
    """Add noise to the positions of a drive."""
    off = noise * random.standard_normal((len(drive), 2))
    return [
        (east + by_east, north + by_north, yaw)
        for (east, north, yaw), (by_east, by_north) in zip(drive, off.tolist(), strict=True)
    ]


def trace_of(drive: Drive) -> Trace:
    """Trace of a completely received drive."""
    trace = Trace()
    for k, (east, north, yaw) in enumerate(drive):
        trace.add(received(round((k + 1) * STEP_S * SECOND), east, north, yaw, SPEED))
    return trace


def seen(trace: Trace, east: float, north: float) -> Window:
    return trace.window(east, north, SETTINGS.behind(SPEED), SETTINGS.ahead(SPEED))


def driven(lead: Drive, predecessor: Drive | None) -> Drive:
    """Drive along successive fits to the received samples."""
    first, second = trace_of(lead), None if predecessor is None else trace_of(predecessor)
    east, north, drive = BEGIN, 0.0, []
    for _ in range(round((END - BEGIN) / (SPEED * STEP_S))):
        other = None if second is None else seen(second, east, north)
        fit = fit_two(seen(first, east, north), other, alpha=0.5, settings=SETTINGS)
        assert fit is not None
        there = fit.spline.at(fit.spline.project(east, north).station + SPEED * STEP_S)
        east, north = there.east, there.north
        drive.append((east, north, there.yaw))
    return drive


@pytest.mark.parametrize(("noise", "within"), [(0.0, 0.02), (0.02, 0.045)])
def test_errors_of_the_fit_do_not_grow_along_a_convoy(noise: float, within: float) -> None:
    path, random = corner(), np.random.default_rng(11)
    stations = np.arange(0.0, path.length, SPEED * STEP_S).tolist()
    course = [(place.east, place.north, place.yaw) for place in map(path.at, stations)]
    lead, predecessor, largest = with_noise(course, noise, random), None, []
    for _ in range(CARS):
        drive = driven(lead, predecessor)
        # Before its own drive a predecessor was on the lead's course.
        before = [place for place in course if place[0] < BEGIN and place[2] == 0.0]
        predecessor = with_noise(before + drive, noise, random)
        largest.append(max(abs(path.project(east, north).lateral) for east, north, _ in drive))
    assert max(largest) < within
    assert np.mean(largest[3:]) < np.mean(largest[:3]) + 0.01
