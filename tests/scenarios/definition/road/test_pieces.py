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
from tests.made.scenarios.rough_drives import FORMATS, ON_THE_SPOT, Course, Rough, path_errors

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
    assert report.smoothing_m == road.half_width
    assert (road.half_width, 1.0 / np.max(np.abs(road.path.curvature))) == (
        width,
        pytest.approx(radius, abs=0.4),
    )
    driven = road.path.station >= road.start
    errors = path_errors(rough, road.path.east[driven], road.path.north[driven])
    assert np.max(errors) < off
    assert any("half width of" in line for line in report.warnings) == (width > 8.0 or off > 1.0)


def test_a_given_half_width_is_kept(tmp_path: Path) -> None:
    scenario = read(driven(((200.0, 0.0, 1),)), tmp_path, keys="smoothing_m = 12.0")
    assert report_of(scenario).smoothing_m == 12.0


def test_the_log_of_a_scenario_has_the_same_path(tmp_path: Path) -> None:
    rough = Rough(course=turn(8.0), noise=2.0, rate_hz=1.0, speed=4.0)
    scenario = read(rough.points(), tmp_path)
    again = scenario_from_text(scenario.text).route.path
    assert np.array_equal(again.east, scenario.route.path.east)


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


def test_the_longest_three_of_many_parts_are_named(tmp_path: Path) -> None:
    legs = [(60.0 + 10.0 * k, 0.0, 1) if k % 2 == 0 else (10.0, 0.0, -1) for k in range(11)]
    line = refusal(driven(tuple(legs)), tmp_path)
    ends = [(90.7, 129.0), (133.9, 179.1), (184.0, 236.7)]
    assert parts_of(line) == [pytest.approx(end, abs=0.5) for end in ends]
    assert "and 3 more" in line


def test_a_turn_on_the_spot_is_not_a_road(tmp_path: Path) -> None:
    line = refusal(Rough(course=ON_THE_SPOT, speed=2.0).points(), tmp_path)
    assert parts_of(line) == [pytest.approx(end, abs=0.3) for end in ((0.0, 74.4), (76.4, 150.9))]


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


def with_replay(drive: Drive, folder: Path, keys: str = "") -> Scenario:
    """A straight lead, and a follower that replays `drive`."""
    (folder / "lead.csv").write_bytes(FORMATS["csv"](driven(((400.0, 0.0, 1),))))
    (folder / "own.csv").write_bytes(FORMATS["csv"](drive))
    text = 'name = "a"\n[path]\nkind = "trace"\nfile = "lead.csv"\n'
    return scenario_from_text(f'{text}[vehicle.v2]\nreplay = "own.csv"\n{keys}\n', folder=folder)


def test_the_named_parts_of_a_replay_are_replayed(tmp_path: Path) -> None:
    drive = driven(THREE_POINT_TURN)
    with pytest.raises(ScenarioError) as caught:
        with_replay(drive, tmp_path)
    (line,) = caught.value.lines
    keys = dict(re.findall(r"vehicle\.v2\.(replay_\w+) = ([\d.]+)", line))
    assert {key: float(value) for key, value in keys.items()} == {
        "replay_to_s": pytest.approx(104.4, abs=0.3),
        "replay_from_s": pytest.approx(107.9, abs=0.3),
    }
    assert "path." not in line
    for (key, value), lasts in zip(keys.items(), (104.4, 167.8), strict=True):
        table = with_replay(drive, tmp_path, f"{key} = {value}").tables.vehicle["v2"].drive
        assert table is not None
        assert table.time_s[-1] == pytest.approx(lasts, abs=0.3)
