"""A log that holds only part of its messages, as `[log]` of its scenario requests."""

from functools import cache
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import summary_of
from scenarios.results.summary import RunSummary
from scenarios.runs.live import LiveRun
from scenarios.runs.run_log import RunLog
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.scenarios.messages import START, at, truth
from transport.codec import encode
from transport.log.reader import LogReader

DURATION_S = 4
SETTINGS = (f"duration_s={DURATION_S}", "convoy.vehicles=3", "links.loss_ratio=0.2")
THINNED = (
    "log.truth_rate_hz=10", "log.trajectory_rate_hz=2", "log.tracking_rate_hz=5",
    "log.command_rate_hz=0", "log.verdicts=false",
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("thinned")


@cache
def run(folder: Path, *settings: str) -> tuple[Path, RunSummary]:
    """Log and summary of a run with these settings."""
    place = folder / ("thinned" if settings else "whole")
    summary = run_virtual(load_scenario("lane_change", [*SETTINGS, *settings]), place, Stop())
    return place / LOG_NAME, summary


def held(log: Path) -> dict[tuple[str, str], list[bytes]]:
    """Messages by vehicle and kind, as bytes: a NaN in them equals no other."""
    found: dict[tuple[str, str], list[bytes]] = {}
    for _, vehicle, message in LogReader(log).messages():
        found.setdefault((vehicle, type(message).__name__), []).append(encode(message))
    return found


def test_the_log_holds_the_requested_messages_and_nothing_else_changes(folder: Path) -> None:
    whole, thinned = held(run(folder)[0]), held(run(folder, *THINNED)[0])
    assert {kind for _, kind in thinned} == {kind for _, kind in whole} - {"Command", "LinkVerdict"}
    per_second = {"TruePose": 10, "CompositeTrajectory": 2, "Tracking": 5}
    for (vehicle, kind), messages in thinned.items():
        if kind not in per_second:
            names_the_run = kind in {"RunStart", "RunEnd"}
            assert names_the_run or messages == whole[vehicle, kind]
            continue
        assert all(message in whole[vehicle, kind] for message in messages)
        # The first in each period; a follower's trajectory begins with its first messages.
        assert 0 <= per_second[kind] * DURATION_S + 1 - len(messages) <= 1


def test_the_figures_are_those_of_all_messages(folder: Path) -> None:
    def figures(summary: RunSummary) -> dict[str, Any]:
        rows = summary.vehicles, summary.links, summary.events, summary.holes, summary.limits
        return {"rows": rows, "outcome": summary.outcome, "warnings": summary.warnings}

    log, thinned = run(folder, *THINNED)
    assert figures(thinned) == figures(run(folder)[1])
    assert not thinned.holes
    assert summary_of(log) == thinned


@pytest.mark.parametrize(
    ("arguments", "topic", "holds"),
    [
        (["explain", "LOG", "--vehicle", "v2", "--at", "2"], "truth", "at most 10"),
        (["blame", "LOG", "--limit", "lane"], "truth", "at most 10"),
        (["channel", "fit", "LOG"], "truth", "at most 10"),
        (
            ["run", "lane_change", "--clock", "virtual", "--out", "OUT", "--set",
             'links.loss={kind="log", file="LOG"}'],
            "verdict", "no messages",
        ),
    ],
)  # fmt: skip
def test_queries_that_need_whole_topics_refuse_a_thinned_log(
    folder: Path, tmp_path: Path, arguments: list[str], topic: str, holds: str
) -> None:
    log, _ = run(folder, *THINNED)
    places = {"LOG": str(log), "OUT": str(tmp_path / "run")}
    for word, place in places.items():
        arguments = [argument.replace(word, place) for argument in arguments]
    found = CliRunner().invoke(cli, arguments)
    assert found.exit_code == 2, found.output
    lines = [line for line in found.output.splitlines() if "[log]" in line]
    assert len(lines) == 1
    assert holds in lines[0]
    assert topic in lines[0]
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("rates", [(), ("log.truth_rate_hz=5",)])
def test_thinned_topics_are_no_holes_of_an_incomplete_log(
    tmp_path: Path, rates: tuple[str, ...]
) -> None:
    scenario = load_scenario("lane_change", [*SETTINGS, *rates])
    live = LiveRun(scenario)
    recorder_is_killed = RunLog(scenario, tmp_path / "run", clock="wall", run_id="x", live=live)
    recorder_is_killed.start(START, START)
    for tick in range(100):
        if 30 <= tick < 60:
            continue  # these never came
        message = truth("v1", tick, 0.6 * tick, 0.0)
        recorder_is_killed.recorder.accept("convoy/v1/truth", encode(message), at(2.5))
    recorder_is_killed.flush()
    warnings: list[str] = []
    found = summary_of(tmp_path / "run" / LOG_NAME, warnings.append)
    assert found.reason == "the log breaks off"
    true_holes = [hole.poses for hole in found.holes if hole.kind == "true pose"]
    if rates:
        assert true_holes == []
        assert "holds only part" in warnings[1]
        assert "missing" not in warnings[0]
    else:
        assert true_holes == [30]
        assert [line.endswith("30 of 100 truth messages are missing") for line in warnings] == [
            True
        ]


def test_the_log_is_smaller(folder: Path) -> None:
    assert run(folder, *THINNED)[0].stat().st_size < 0.55 * run(folder)[0].stat().st_size
