"""The part of a drive that is driven, and pauses that are kept or cut."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.path_tables import PointsPath

SPEED, BEFORE, LASTS = 10.0, 20.0, 300.0


def rows(lasts: float = LASTS) -> list[tuple[float, float]]:
    """Time and distance of 60 s at SPEED, 5 points a second, paused for `lasts` s at BEFORE s."""
    at = [0.2 * k for k in range(301)]
    return [(t + (lasts if t > BEFORE else 0.0), SPEED * t) for t in at]


def load(folder: Path, keys: str = "", *, timed: bool = True, lasts: float = LASTS) -> Scenario:
    lines = [f"{t:.3f},{x:.3f},0.0" for t, x in rows(lasts)]
    if timed:
        text = "\n".join(["t_s,x_m,y_m", *lines])
    else:
        text = "\n".join(["x_m,y_m", *(line.split(",", 1)[1] for line in lines)])
    (folder / "a.csv").write_text(text)
    lead = "recorded" if timed else "set"
    return scenario_from_text(
        f'name = "a"\n[path]\nkind = "trace"\nfile = "a.csv"\n{keys}\n[speed]\nlead = "{lead}"\n',
        label="a.toml",
        folder=folder,
    )


def points(scenario: Scenario) -> PointsPath:
    table = scenario.tables.path
    assert isinstance(table, PointsPath)
    return table


@pytest.mark.parametrize(
    ("keys", "first_m", "last_m", "lasts_s"),
    [
        ("", 0.0, 600.0, 360.0),
        ("from_s = 5.0", 50.0, 600.0, 355.0),
        ("to_s = 12.0", 0.0, 120.0, 12.0),
        ("from_s = 5.0\nto_s = 12.0", 50.0, 120.0, 7.0),
        ("from_m = 250.0", 250.0, 600.0, 35.0),
        ("to_m = 150.1", 0.0, 150.0, 15.0),
        ("from_s = 5.0\nto_m = 150.0", 50.0, 150.0, 10.0),
        ("from_s = 325.0", 250.0, 600.0, 35.0),
    ],
)
def test_a_part_has_its_points(
    tmp_path: Path, keys: str, first_m: float, last_m: float, lasts_s: float
) -> None:
    scenario = load(tmp_path, keys)
    table = points(scenario)
    assert (table.east_m[0], table.east_m[-1]) == pytest.approx((first_m, last_m), abs=1e-3)
    assert table.time_s[0] == 0.0
    assert table.time_s[-1] == pytest.approx(lasts_s, abs=1e-6)
    assert scenario.duration_s == pytest.approx(lasts_s, abs=0.2)
    assert table.begin_m == pytest.approx(first_m, abs=1e-3)


def test_a_part_of_a_drive_without_times_is_given_in_metres(tmp_path: Path) -> None:
    table = points(load(tmp_path, "from_m = 100.0\nto_m = 300.0", timed=False))
    assert (table.east_m[0], table.east_m[-1]) == pytest.approx((100.0, 300.0), abs=1e-3)


@pytest.mark.parametrize(
    ("keys", "timed", "key", "why"),
    [
        ("from_s = 1.0", False, "path.from_s", "from_m"),
        ("from_s = 360.0", True, "path.from_s", "360.0 s"),
        ("from_m = 700.0", True, "path.from_m", "600.0 m"),
        ("from_s = 9.0\nto_s = 8.0", True, "path.to_s", "more than 9 s"),
        ("from_s = -1.0", True, "path.from_s", "-1"),
    ],
)
def test_a_part_that_the_drive_does_not_have_is_refused(
    tmp_path: Path, keys: str, timed: bool, key: str, why: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, keys, timed=timed)
    (line,) = caught.value.lines
    assert key in line
    assert why in line


@pytest.mark.parametrize(("rule", "lasts_s"), [("keep", 360.0), ("cut", 60.0)])
def test_a_pause_is_kept_or_cut(tmp_path: Path, rule: str, lasts_s: float) -> None:
    scenario = load(tmp_path, f'pauses = "{rule}"')
    table = points(scenario)
    assert table.time_s[-1] == pytest.approx(lasts_s, abs=1e-6)
    assert (table.pause_points, table.pauses) == ((100,), rule)
    assert table.pause_lasts_s == pytest.approx((LASTS + 0.2,))
    (warning,) = [line for line in report_of(scenario).warnings if "path.pauses" in line]
    assert "300.2 s" in warning
    assert "line 102 (20.0 s)" in warning


def test_places_after_a_cut_pause_are_those_of_the_record(tmp_path: Path) -> None:
    """A part given by the times that check prints has the same points with and without pauses."""
    kept, cut = (
        points(load(tmp_path, f'from_s = 330.0\npauses = "{rule}"')) for rule in ("keep", "cut")
    )
    assert np.allclose(kept.east_m, cut.east_m)
    assert kept.begin_s == cut.begin_s == pytest.approx(330.0)
