"""`convoy blame`: its table, files and errors, and the scenario of the smallest set."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.results.limits import broken_by
from scenarios.results.log_summary import summary_of
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.many import blame
from scenarios.studies.many.losses import read_run
from scenarios.studies.many.trials import FigureName, RerunCriteria, result_of
from tests.made.many.planted_losses import TINY, planted

CAUSE = planted(TINY, 3)


def convoy(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


def refused(result: Result) -> str:
    assert result.exit_code == 2, result.output
    (line,) = result.output.splitlines()
    return line.removeprefix("error: ")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planted")
    run_virtual(CAUSE.scenario, folder, Stop())
    return folder / "run.mcap"


@pytest.mark.parametrize("figure", ["error", "gap"])
def test_worst_figure_and_breach_equal_those_of_the_summary(log: Path, figure: FigureName) -> None:
    run, rows = read_run(log), summary_of(log).vehicles
    errors = [row.cross_track_error_m_max for row in rows if row.cross_track_error_m_max]
    gaps = [row.true_gap_m_min for row in rows if row.true_gap_m_min]
    worst = max(errors) if figure == "error" else min(gaps)
    key = "cross_track_error_m_max" if figure == "error" else "true_gap_m_min"
    for limit in (Limit("lane_departures_max", 0), Limit(key, worst - 0.001), Limit(key, worst)):
        criteria = RerunCriteria(figure=figure, limit=limit)
        result = result_of(run.tables, criteria)
        assert result.figure_m == worst
        assert (result.broken_at is not None) == broken_by(limit, summary_of(log))


def test_the_scenario_of_the_smallest_set_breaks_the_limit(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "why"
    done = convoy("blame", log.parent, "--out", out, "--workers", "0")
    assert done.exit_code == 0, done.output
    assert f"convoy run {out / 'smallest.toml'} --clock virtual" in done.output
    assert (out / "blame.png").read_bytes().startswith(b"\x89PNG")

    report: dict[str, Any] = json.loads((out / "blame.json").read_text())
    assert report["schema"] == "convoy.blame/1"
    assert report["recorded"]["broken_at_s"] is not None
    assert report["without_loss"]["broken_at_s"] is None
    (worst, *others) = report["rows"]
    assert worst["reduction_m"] == max(row["reduction_m"] for row in report["rows"])
    assert worst["reduction_m"] <= report["recorded"]["figure_m"]
    assert {burst["receiver"] for burst in worst["bursts"]} == {"v2"}
    bursts = [burst for row in (worst, *others) for burst in row["bursts"]]
    distinct = {(burst["sender"], burst["receiver"], *burst["numbers"]) for burst in bursts}
    assert len(distinct) == report["considered_bursts"]

    smallest = load_scenario(out / "smallest.toml")
    assert smallest.tables.limits.lane_departures_max == 0
    run = convoy("run", out / "smallest.toml", "--clock", "virtual", "--out", tmp_path / "run")
    assert run.exit_code == 1
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["reason"].startswith("limits.lane_departures_max = 0")
    lost = sum(link["sent"] - link["delivered"] for link in summary["links"])
    assert lost - 1 <= report["smallest"]["messages"] <= lost  # one may be in transit at the end

    assert refused(convoy("blame", log, "--out", out)).startswith(f"{out / 'blame.png'}: exists")


@pytest.mark.parametrize(
    ("limit", "why"),
    [
        ("error_m=50", "the limit error_m=50 was not broken"),
        ("error_m=0.001", "the limit error_m=0.001 is broken without any loss"),
    ],
)
def test_without_a_breach_by_losses_bursts_are_only_ranked(
    log: Path, tmp_path: Path, limit: str, why: str
) -> None:
    done = convoy(
        "blame", log, "--limit", limit, "--out", tmp_path, "--workers", "0", "--runs", "10"
    )
    assert done.exit_code == 0, done.output
    assert why in " ".join(done.output.split())
    assert not (tmp_path / "smallest.toml").exists()
    report = json.loads((tmp_path / "blame.json").read_text())
    assert report["smallest"] is None
    assert report["not_reduced_reason"].startswith(why)
    assert report["rows"][0]["reduction_m"] > 0.1


def test_an_irreproducible_log_is_refused(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    def read_altered(path: Path) -> Any:
        run = read_run(path)
        truth = run.tables.table("v2", "truth")
        truth["east_m"][truth.at_ns - run.tables.beginning == 2_000_000_000] += 1e-9
        return replace(run, late=3)

    monkeypatch.setattr(blame, "read_run", read_altered)
    line = refused(convoy("blame", log, "--out", tmp_path, "--workers", "0"))
    assert line.startswith(f"{log}: ")
    for fact in ("v2", "2.00 s", "3 messages were late", "--clock virtual"):
        assert fact in line


def test_a_log_without_losses_is_refused(tmp_path: Path) -> None:
    run_virtual(load_scenario("lane_change", ["duration_s=0.5"]), tmp_path, Stop())
    log = tmp_path / "run.mcap"
    line = refused(convoy("blame", log, "--out", tmp_path / "out"))
    assert line == f"{log}: no message was lost"
    assert not (tmp_path / "out").exists()


def test_a_damaged_log_is_refused(log: Path, tmp_path: Path) -> None:
    half = tmp_path / "half.mcap"
    data = log.read_bytes()
    half.write_bytes(data[:-100])
    line = refused(convoy("blame", half, "--out", tmp_path / "out"))
    assert line.startswith(f"{half}: truncated")
    other = tmp_path / "text.mcap"
    other.write_text("no log")
    assert str(other) in refused(convoy("blame", other, "--out", tmp_path / "out"))
    assert "No such file" in refused(convoy("blame", tmp_path / "none.mcap"))


def test_a_replayed_vehicle_is_refused(log: Path, tmp_path: Path) -> None:
    text = {
        "extends": "lane_change",
        "duration_s": 0.5,
        "links": {"loss_ratio": 0.5},
        "convoy": {"vehicles": 3},
        "vehicle": {"v2": {"replay": str(log), "replay_vehicle": "v2"}},
    }
    run_virtual(scenario_from_text(tomli_w.dumps(text), folder=log.parent), tmp_path, Stop())
    line = refused(convoy("blame", tmp_path, "--out", tmp_path / "out"))
    assert line.startswith(f"{tmp_path / 'run.mcap'}: v2 ")


def test_an_unknown_limit_is_refused(log: Path, tmp_path: Path) -> None:
    line = refused(convoy("blame", log, "--limit", "speed", "--out", tmp_path / "out"))
    assert line.startswith("--limit: given 'speed', allowed ")
