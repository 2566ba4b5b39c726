"""Drives with turns: the half width that a car can drive, and the parts of other drives."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from tests.made.scenarios.recorded_drives import Drive
from tests.made.scenarios.rough_drives import FORMATS, Course, Rough, path_errors

Legs = tuple[tuple[float, float, int], ...]
"""Length (m), curvature (1/m), and direction of driving (1 forwards, -1 in reverse)."""

RADIUS = 5.5
THREE_POINT_TURN: Legs = (
    (310.0, 0.0, 1), (RADIUS, 1 / RADIUS, 1), (6.0, -1 / RADIUS, -1), (6.0, 1 / RADIUS, 1),
    (500.0, 0.0, 1),
)  # fmt: skip
PARKED_BACKWARDS: Legs = ((8.6, -1 / RADIUS, -1), (3.0, 0.0, -1), (300.0, 0.0, 1))


def driven(legs: Legs, noise: float = 0.02, rate_hz: float = 10.0, speed: float = 3.0) -> Drive:
    random = np.random.default_rng(3)
    x = y = yaw = 0.0
    points: Drive = []
    for length, curvature, direction in legs:
        count = round(length * rate_hz / speed)
        for _ in range(count):
            at = len(points) / rate_hz
            east, north = random.normal(0.0, noise, 2).tolist()
            points.append((at, x + east, y + north, speed))
            x += direction * length / count * math.cos(yaw)
            y += direction * length / count * math.sin(yaw)
            yaw += curvature * length / count
    return points


def read(points: Drive, folder: Path, form: str = "csv", keys: str = "") -> Scenario:
    (folder / "drive.csv").write_bytes(FORMATS[form](points))
    text = f'name = "a"\n[path]\nkind = "trace"\nfile = "drive.csv"\n{keys}\n'
    text += "" if form == "places" else '[speed]\nlead = "recorded"\n'
    return scenario_from_text(text, folder=folder)


def refusal(points: Drive, folder: Path, form: str = "csv") -> str:
    with pytest.raises(ScenarioError) as caught:
        read(points, folder, form)
    (line,) = caught.value.lines
    return line


def turn(radius: float) -> Course:
    return ((150.0, 0.0), (math.pi * radius, 1 / radius), (150.0, 0.0))


def headlands(radius: float) -> Course:
    out_and_back = ((120.0, 0.0), (math.pi * radius, 1 / radius))
    return (*out_and_back, (120.0, 0.0), (math.pi * radius, -1 / radius), (120.0, 0.0))


def bulb(radius: float) -> Course:
    """A turn that returns on the same track."""
    out, around = math.radians(60.0) * radius, math.radians(300.0) * radius
    ends = (120.0, 0.0)
    return (ends, (out, -1 / radius), (around, 1 / radius), (out, -1 / radius), ends)


@pytest.mark.parametrize(
    ("rough", "width", "radius", "off"),
    [
        (Rough(course=turn(5.5), speed=5.0), 8.0, 5.2, 0.08),
        (Rough(course=headlands(6.0), speed=3.0), 8.0, 5.5, 0.08),
        (Rough(course=bulb(6.0), speed=3.0), 8.0, 5.2, 0.15),
        (Rough(course=headlands(6.0), noise=0.5, rate_hz=5.0, speed=3.0), 16.0, 5.0, 0.8),
        (Rough(course=turn(8.0), noise=2.0, rate_hz=1.0, speed=4.0), 32.0, 4.5, 4.0),
        (Rough(course=turn(6.0), noise=2.0, rate_hz=1.0, speed=4.0), 32.0, 3.5, 4.0),
    ],
    ids=["U-turn", "headlands", "bulb", "noisy headlands", "phone", "phone, tight"],
)
def test_the_smoothing_holds_a_turn_together(
    tmp_path: Path, rough: Rough, width: float, radius: float, off: float
) -> None:
    """The half width is the first that a car can drive, or has the largest smallest radius."""
    scenario = read(rough.points(), tmp_path)
    report, road = report_of(scenario), scenario.route.smoothed
    assert road is not None
    assert (road.half_width, 1.0 / np.max(np.abs(road.path.curvature))) == (
        width,
        pytest.approx(radius, abs=0.4),
    )
    driven = road.path.station >= road.start
    errors = path_errors(rough, road.path.east[driven], road.path.north[driven])
    assert np.max(errors) < off
    assert any("half width of" in line for line in report.warnings) == (width > 8.0 or off > 1.0)


@pytest.mark.parametrize(
    ("legs", "form", "parts", "keys"),
    [
        (THREE_POINT_TURN, "csv", [(0.0, 104.4), (107.9, 275.7)], {"to_s": 104.4, "from_s": 107.9}),
        (PARKED_BACKWARDS, "csv", [(4.6, 103.8)], {"from_s": 4.6}),
        (PARKED_BACKWARDS, "places", [(13.8, 312.6)], {"from_m": 13.8}),
    ],
    ids=["three-point turn", "parked backwards", "parked backwards, without times"],
)
def test_parts_that_a_car_drives_forwards_are_named(
    tmp_path: Path,
    legs: Legs,
    form: str,
    parts: list[tuple[float, float]],
    keys: dict[str, float],
) -> None:
    line = refusal(driven(legs), tmp_path, form)
    assert parts_of(line) == [pytest.approx(part, abs=0.3) for part in parts]
    named = {key: float(value) for key, value in re.findall(r"path\.(\w+) = ([\d.]+)", line)}
    assert named == pytest.approx(keys, abs=0.3)


def parts_of(line: str) -> list[tuple[float, ...]]:
    return [
        tuple(map(float, ends)) for ends in re.findall(r"([\d.]+) to ([\d.]+) [sm] \(\d+ m\)", line)
    ]


@pytest.mark.parametrize("form", ["csv", "places"])
def test_each_named_part_can_be_driven(tmp_path: Path, form: str) -> None:
    points = driven(THREE_POINT_TURN)
    line = refusal(points, tmp_path, form)
    choices = line.partition(": set ")[2].replace("path.", "").split(", or ")
    lengths = []
    for choice in choices:
        road = read(points, tmp_path, form, choice.replace(" and ", "\n")).route.smoothed
        assert road is not None
        lengths.append(road.lap_length)
    assert lengths == [pytest.approx(313.0, abs=2.0), pytest.approx(502.0, abs=2.0)]
