"""`convoy channel figure` on a few runs: plot, JSON and table."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from scenarios.cli.main import cli
from scenarios.definition.errors import ScenarioError
from scenarios.runs.virtual.unlogged_run import drive_trial
from scenarios.studies.channel import cost_drives
from scenarios.studies.channel.cost_drives import (
    BURST_LOSS_RATIO,
    QUICK,
    Channel,
    Cost,
    Plan,
    lane_margin_m,
)
from scenarios.studies.channel.cost_report import JSON_FILE, PICTURE, channel_figure
from transport.links.laws.loss.bursts import GilbertElliott

PNG = b"\x89PNG"
SMALL = Plan(
    gaps_m=(8.0,),
    loss_ratios=(0.0, 0.6),
    latencies_ms=(20.0,),
    bursts_messages=(1.25, 16.0),
    map_seeds=1,
    burst_seeds=1,
)


def no_progress(_: str) -> None:
    pass


def test_plot_and_json_hold_the_simulated_errors(tmp_path: Path) -> None:
    progress: list[str] = []
    costs = channel_figure(SMALL, tmp_path / "out", progress.append, workers=0)
    assert progress[-1].endswith("4 of 4 runs")
    assert (tmp_path / "out" / f"{PICTURE}.png").read_bytes().startswith(PNG)
    report = json.loads((tmp_path / "out" / JSON_FILE).read_text())
    assert [row["true_error_m_max"] for row in report["channels"]] == [
        list(cost.errors_m) for cost in costs
    ]
    assert all(row["seeds"] == [1] for row in report["channels"])
    again = drive_trial(Channel(8.0, 0.6, 20.0).scenario(1)).cross_track[-1]
    (lossy,) = [cost for cost in costs if cost.channel == Channel(8.0, 0.6, 20.0)]
    assert lossy.errors_m == (again,)
    (clear,) = [cost for cost in costs if cost.channel == Channel(8.0, 0.0, 20.0)]
    assert clear.median_m < 0.1
    with pytest.raises(ScenarioError, match="exists; give another folder by --out"):
        channel_figure(SMALL, tmp_path / "out", no_progress, workers=0)


def test_an_interrupted_study_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds: list[int] = []

    def error_m(channel: Channel, seed: int) -> float:
        seeds.append(seed)
        if len(seeds) == 3:
            raise KeyboardInterrupt
        return channel.loss_ratio + channel.latency_ms / 7.0

    monkeypatch.setattr(cost_drives, "error_m", error_m)
    with pytest.raises(KeyboardInterrupt):
        channel_figure(SMALL, tmp_path, no_progress, workers=0)
    assert not (tmp_path / f"{PICTURE}.png").exists()
    costs = channel_figure(SMALL, tmp_path, no_progress, workers=0)
    assert len(seeds) == 6, "two of four runs were in progress when it was interrupted"
    assert [cost.errors_m for cost in costs] == [
        (cost.channel.loss_ratio + cost.channel.latency_ms / 7.0,) for cost in costs
    ]
    assert {file.name for file in tmp_path.iterdir()} == {f"{PICTURE}.png", JSON_FILE}


def test_channels_over_bursts_differ_only_in_their_mean_burst() -> None:
    tables = [
        Channel(8.0, BURST_LOSS_RATIO, 20.0, burst).scenario(1).tables.links
        for burst in Plan().bursts_messages
    ]
    assert all(isinstance(table.loss, GilbertElliott) for table in tables)
    assert len({table.model_copy(update={"loss": None}).model_dump_json() for table in tables}) == 1
    first = tables[0].loss
    assert isinstance(first, GilbertElliott)
    # The shortest mean burst is that of independent losses.
    assert first.burst_messages_mean == pytest.approx(1.0 / (1.0 - BURST_LOSS_RATIO))


def test_a_cost_summarises_its_seeds() -> None:
    cost = Cost(Channel(8.0, 0.2, 20.0, 8.0), (0.1, 3.0, 0.2))
    assert (cost.median_m, cost.largest_m) == (0.2, 3.0)
    assert cost.runs_beyond(lane_margin_m()) == 1
    assert lane_margin_m() == pytest.approx(0.5 * (3.5 - 1.86))


def test_quick_simulates_few_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = sum(len(QUICK.seeds(channel)) for channel in QUICK.channels)
    assert few < 0.05 * sum(len(Plan().seeds(channel)) for channel in Plan().channels)
    monkeypatch.setattr(
        cost_drives, "QUICK", replace(SMALL, loss_ratios=(0.6,), bursts_messages=(16.0,))
    )
    monkeypatch.setattr(cost_drives, "Plan", lambda: pytest.fail("the whole figure"))
    arguments = ["channel", "figure", "--quick", "--out", str(tmp_path / "quick")]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    assert "error m" in result.stdout
    assert f"written: {tmp_path / 'quick' / PICTURE}.png" in result.stdout.replace("\n", "")
