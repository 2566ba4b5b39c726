"""The part of a recorded drive that is replayed, and its instant relative to the lead."""

from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text

LATER, SPEED = 2.0, 10.0


def straight(later: float = 0.0, pause: tuple[float, float] = (1e9, 0.0)) -> str:
    """60 s at SPEED, 5 points a second, paused once: at a time, for a time."""
    rows = ["t_s,x_m,y_m"]
    for k in range(301):
        t = 0.2 * k
        at = later + t + (pause[1] if t > pause[0] else 0.0)
        rows.append(f"{at:.3f},{SPEED * t:.3f},{0.1 * (k % 2):.1f}")
    return "\n".join(rows)


def load(folder: Path, replay: str = "", path: str = "", lead: str = "", own: str = "") -> Scenario:
    (folder / "lead.csv").write_text(lead or straight())
    (folder / "second.csv").write_text(own or straight(LATER))
    return scenario_from_text(
        f'name = "a"\n[path]\nkind = "trace"\nfile = "lead.csv"\n{path}\n'
        f'[speed]\nlead = "recorded"\n[vehicle.v2]\nreplay = "second.csv"\n{replay}\n',
        label="a.toml",
        folder=folder,
    )


@pytest.mark.parametrize(
    ("replay", "path", "begun", "east"),
    [
        ("", "", -2.0, -20.0),
        ("replay_from_s = 10.0", "", -12.0, -20.0),
        ("replay_to_s = 50.0", "", -2.0, -20.0),
        ("", "from_s = 20.0", 18.0, 180.0),
        ("replay_from_s = 5.0", "from_s = 20.0", 13.0, 180.0),
        ("replay_from_s = 15.0\nreplay_to_s = 40.0", "from_s = 5.0\nto_s = 35.0", -12.0, 30.0),
    ],
)
def test_a_part_starts_at_its_instant_relative_to_the_lead(
    tmp_path: Path, replay: str, path: str, begun: float, east: float
) -> None:
    """`east` is the place at the instant of the lead's first point."""
    scenario = load(tmp_path, replay, path)
    drive, run_in = scenario.replays["v2"], scenario.route.run_in
    assert drive.common
    assert drive.begun + run_in == pytest.approx(begun, abs=1e-6)
    assert drive.at(run_in + 15.0)[0].east == pytest.approx(east + 150.0, abs=0.1)


def test_the_end_of_a_part_ends_the_run(tmp_path: Path) -> None:
    scenario = load(tmp_path, "replay_to_s = 30.0")
    assert scenario.duration_s == pytest.approx(32.0 + scenario.route.run_in, abs=0.1)


@pytest.mark.parametrize(
    ("replay", "key", "why"),
    [
        ("replay_from_s = 60.0", "vehicle.v2.replay_from_s", "60.0 s"),
        ("replay_from_s = 9.0\nreplay_to_s = 8.0", "vehicle.v2.replay_to_s", "more than 9 s"),
    ],
)
def test_a_part_that_the_replayed_drive_does_not_have_is_refused(
    tmp_path: Path, replay: str, key: str, why: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, replay)
    (line,) = caught.value.lines
    assert key in line
    assert why in line
