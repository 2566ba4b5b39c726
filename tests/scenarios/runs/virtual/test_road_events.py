"""What communication loss does to a convoy that brakes, and that no run keeps it to itself."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import summary_of, tables_of
from scenarios.results.record import record_holes
from scenarios.results.run_event import run_events
from scenarios.results.summary import RunSummary
from scenarios.results.tables import RunTables, common
from scenarios.results.true_motion import bodies, sizes_of
from scenarios.results.vehicle_figures import vehicle_summaries
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual import run_virtual
from tests.made.scenarios.polygons import common_area
from tests.made.scenarios.shipped import whole_run
from transport.log.reader import LogReader
from vehicles.messages import LogText
from vehicles.schedule import SECOND

BRAKING = """
name = "braking"
duration_s = 14.0
[convoy]
vehicles = 3
[path]
kind = "segments"
segments = [{ length_m = 1000.0 }]
[speed]
lead = "profile"
followers = "gap"
profile = [
    { at_s = 0.0, speed_mps = 25.0 }, { at_s = 4.0, speed_mps = 25.0 },
    { at_s = 8.0, speed_mps = 5.0 },
]
[links]
loss_ratio = 0.9
[control.degradation]
reaction = "extrapolate"        # no others drive through each other
"""


def ran(folder: Path, *overrides: str, seed: int = 1) -> tuple[RunSummary, Stop]:
    stop = Stop()
    scenario = scenario_from_text(BRAKING, overrides=overrides, seed=seed)
    return run_virtual(scenario, folder, stop), stop


@pytest.fixture(scope="module")
def crashed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RunSummary, Stop]:
    """Seed 1 of the convoy that brakes and receives little: its folder and summary."""
    folder = tmp_path_factory.mktemp("crashed")
    return folder, *ran(folder)


def overlapping(log: Path) -> set[tuple[str, str]]:
    """Pairs that ever share an area, by cutting each body with each other one at each instant."""
    run = tables_of(log)
    truths = [run.table(name, "truth") for name in run.names]
    _, rows = common(*(truth.at_ns for truth in truths))
    found = set()
    for step in np.transpose(rows):
        body = {
            name: bodies(truth.of(step[[place]]), sizes_of(run.scenario)[name])
            for place, (name, truth) in enumerate(zip(run.names, truths, strict=True))
        }
        found |= {
            (one, other)
            for one, other in combinations(run.names, 2)
            if common_area(body[one], body[other]) > 1e-6
        }
    return found


@pytest.mark.parametrize("seed", [1, 10])
def test_collisions_are_reported_everywhere(
    crashed: tuple[Path, RunSummary, Stop], tmp_path: Path, seed: int
) -> None:
    folder, summary, stop = crashed if seed == 1 else (tmp_path, *ran(tmp_path, seed=seed))
    collisions = [one for one in summary.events if one.kind == "collision"]
    assert collisions
    assert {one.vehicles for one in collisions} == overlapping(folder / LOG_NAME)
    assert (summary.outcome, stop.exit_code) == ("completed", 0)  # without limits
    assert min(row.true_gap_m_min or 0.0 for row in summary.vehicles[1:]) == 0.0
    reported = {
        (message.text, message.level)
        for _, _, message in LogReader(folder / LOG_NAME).messages(["log"])
        if isinstance(message, LogText)
    }
    assert {(one.line, "error") for one in collisions} <= reported


def test_a_limit_on_collisions_ends_the_run_there_and_fails_it(
    crashed: tuple[Path, RunSummary, Stop], tmp_path: Path
) -> None:
    _, free, _ = crashed
    first = next(one for one in free.events if one.kind == "collision")
    summary, stop = ran(tmp_path / "limited", "limits.collisions_max=0")
    assert (summary.outcome, stop.exit_code) == ("failed", EXIT_FAILED)
    assert summary.reason == f"limits.collisions_max = 0: {first.line}"
    assert summary.ran_s == first.at_s
    assert [one for one in summary.events if one.kind == "collision"] == [first]
    on, stop = ran(tmp_path / "on", "limits.collisions_max=0", 'limits.after_collision="continue"')
    assert (on.outcome, on.ran_s, stop.exit_code) == ("failed", 14.0, EXIT_FAILED)
    assert on.events == free.events


def test_a_figure_s_limit_fails_a_run_that_went_on_to_its_end(tmp_path: Path) -> None:
    summary, stop = ran(tmp_path, "duration_s=2", "limits.true_gap_m_min=50")
    assert (summary.outcome, summary.ran_s, stop.exit_code) == ("failed", 2.0, EXIT_FAILED)
    assert summary.reason.startswith("limits.true_gap_m_min = 50: v2 was ")


def test_a_log_gives_the_same_summary_as_the_run(
    crashed: tuple[Path, RunSummary, Stop],
) -> None:
    folder, summary, _ = crashed
    run = tables_of(folder / LOG_NAME)
    assert run_events(run) == summary.events
    assert vehicle_summaries(run, {}) == summary.vehicles


@pytest.mark.spread(1)
@pytest.mark.parametrize("name", ["church_lot", "highway", "lane_change"])
def test_shipped_scenarios_report_nothing_on_clean_links(
    tmp_path_factory: pytest.TempPathFactory, name: str
) -> None:
    summary = summary_of(whole_run(name, tmp_path_factory) / LOG_NAME)
    slides = [event for event in summary.events if event.kind == "slide"]
    assert (list(summary.events), summary.holes) == (slides, ())
    # In the car park's tightest bends followers turn their wheels in jerks, and slide for moments.
    assert not slides or (
        name == "church_lot" and all(event.figures["duration_s"] < 0.5 for event in slides)
    )


def test_without_loss_nothing_happens(tmp_path: Path) -> None:
    summary, _ = ran(tmp_path, "links.loss_ratio=0")
    assert (summary.events, summary.holes) == ((), ())
    assert min(row.true_gap_m_min or 99.0 for row in summary.vehicles) > 3.0


def test_a_log_whose_messages_were_lost_names_the_hole(tmp_path: Path) -> None:
    """Five seconds of a recorded run taken out again: the figures stay those of the rest."""
    scenario = load_scenario("lane_change", ["duration_s=12"])
    whole = run_virtual(scenario, tmp_path, Stop())
    start = scenario.start_at_ns
    log = tables_of(tmp_path / LOG_NAME)
    begin, end = start + 5 * SECOND, start + 10 * SECOND
    rest = {
        key: rows.of((rows.logged_at_ns < begin) | (rows.logged_at_ns >= end))
        for key, rows in log.tables.items()
    }
    run = RunTables(scenario, rest, log.ran_ns)
    rows = vehicle_summaries(run, {})
    assert [row.missing_poses for row in rows] == [100] * 4
    assert [(one.vehicle, one.from_s, one.to_s, one.poses) for one in record_holes(run)] == [
        (name, 5.0, 9.95, 100) for name in scenario.vehicle_names
    ]
    for row, full in zip(rows[1:], whole.vehicles[1:], strict=True):
        assert (row.cross_track_error_m_max or 9.0) <= (full.cross_track_error_m_max or 0.0) + 1e-3
    assert run_events(run) == ()
    assert rows[0].silent_from_s is None
