"""Drawn lines: the path passes through vertices that are far apart."""

import math
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.scenario import Scenario, scenario_from_text


def arc(radius: float, apart: float, turn: float = 0.5 * math.pi) -> np.ndarray:
    """Vertices `apart` (m) along a straight of 200 m, an arc to the left, and a straight."""
    s = np.arange(0.0, 400.0 + radius * turn, apart)
    angle = np.clip((s - 200.0) / radius, 0.0, turn)
    before, after = np.minimum(s, 200.0), np.maximum(s - 200.0 - radius * turn, 0.0)
    east = before + radius * np.sin(angle) + after * math.cos(turn)
    north = radius * (1.0 - np.cos(angle)) + after * math.sin(turn)
    return np.stack((east, north))


def drawn(folder: Path, points: np.ndarray, keys: str = "") -> Scenario:
    rows = "\n".join(f"{x:.3f},{y:.3f}" for x, y in points.T.tolist())
    (folder / "line.csv").write_text(f"x_m,y_m\n{rows}\n")
    text = f'name = "line"\n[path]\nkind = "trace"\nfile = "line.csv"\n{keys}\n'
    return scenario_from_text(text, label="line.toml", folder=folder)


@pytest.mark.parametrize(("radius", "apart"), [(150.0, 40.0), (80.0, 25.0), (400.0, 60.0)])
def test_the_path_of_a_drawn_arc_has_its_radius(
    tmp_path: Path, radius: float, apart: float
) -> None:
    scenario = drawn(tmp_path, arc(radius, apart))
    smoothed = scenario.route.smoothed
    assert smoothed is not None
    path = smoothed.path
    on_arc = (path.north > 0.1 * radius) & (path.north < 0.8 * radius)
    from_centre = np.hypot(path.east - 200.0, path.north - radius)
    inside = on_arc & (path.east > 200.0 + 0.3 * radius)
    assert np.max(np.abs(from_centre[inside] - radius)) < 0.3
    assert np.median(1.0 / path.curvature[inside]) == pytest.approx(radius, rel=0.05)
    road = scenario.route.smoothed
    assert road is not None
    assert road.noise == pytest.approx(0.0, abs=0.02)
    assert road.half_width == 8.0
    assert road.deviation_max == pytest.approx(0.0, abs=0.3)
    assert not road.holes


def test_a_long_straight_between_vertices_is_no_hole(tmp_path: Path) -> None:
    east = [0.0, 30.0, 60.0, 90.0, 120.0, 520.0, 550.0, 580.0, 610.0, 640.0]
    scenario = drawn(tmp_path, np.stack((np.array(east), np.zeros(10))))
    report = report_of(scenario)
    assert report.radius_m_min is None
    assert scenario.route.smoothed is not None
    assert not scenario.route.smoothed.holes
    assert report.path_length_m == pytest.approx(640.0, abs=1.0)
