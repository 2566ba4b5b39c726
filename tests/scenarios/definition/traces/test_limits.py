"""Drives beyond what a road or a run can be: one line with the place and a remedy that works."""

from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text

Rows = list[tuple[float, float, float]]
"""Time (s), east and north (m)."""


def load(folder: Path, rows: Rows, keys: str = "", *, timed: bool = True) -> Scenario:
    lines = ["t_s,x_m,y_m", *(f"{t:.3f},{x:.3f},{y:.3f}" for t, x, y in rows)]
    (folder / "a.csv").write_text(
        "\n".join(lines if timed else (line.partition(",")[2] for line in lines))
    )
    text = f'name = "a"\n[path]\nkind = "trace"\nfile = "a.csv"\n{keys}\n[speed]\n'
    return scenario_from_text(f'{text}lead = "{"recorded" if timed else "set"}"', folder=folder)


def refusal(folder: Path, rows: Rows, *, timed: bool = True) -> str:
    with pytest.raises(ScenarioError) as caught:
        load(folder, rows, timed=timed)
    (line,) = caught.value.lines
    return line


def parts(counts: tuple[int, ...], apart: float) -> Rows:
    """Straights of points 1 m and 0.1 s apart, each beginning `apart` m after the one before."""
    ends = [sum(counts[:k]) for k in range(len(counts))]
    return [
        (0.1 * (begin + k), apart * number + begin + k, 0.0)
        for number, (begin, count) in enumerate(zip(ends, counts, strict=True))
        for k in range(count)
    ]


@pytest.mark.parametrize("timed", [True, False])
def test_the_largest_parts_of_a_torn_drive_are_named_and_can_be_driven(
    tmp_path: Path, timed: bool
) -> None:
    rows = parts((1400, 2000, 1500), 50_000.0)
    line = refusal(tmp_path, rows, timed=timed)
    assert "50.0 km" in line
    assert "line 1402" in line
    choices = line.partition(": set ")[2].replace("path.", "").split(", or ")
    lengths = []
    for choice in choices:
        road = load(tmp_path, rows, choice.replace(" and ", "\n"), timed=timed).route.smoothed
        assert road is not None
        lengths.append(road.lap_length)
    assert lengths == pytest.approx([1399.0, 1999.0, 1499.0], abs=1.5)
