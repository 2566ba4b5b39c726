import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from scenarios.cli.tables import print_summary
from scenarios.definition.schema.tables import LinkTable
from scenarios.results.metrics import Metrics
from scenarios.results.summary import ClockName, RunIdentity, RunSummary
from tests.made.scenarios.messages import gps, health, tracking, truth, verdict

NO_ERROR = ("0.0", "/", "0.0")
NO_FAULTS = ("0", "0", "0")


def summary(reason: str = "", clock: ClockName = "wall") -> RunSummary:
    """Figures of two followers behind a lead, of which v3 has been silent."""
    asked, plain = LinkTable(jitter_ms=80.0, loss_ratio=0.4), LinkTable()
    metrics = Metrics(
        ("v1", "v2", "v3"), {("v1", "v2"): asked, ("v1", "v3"): plain, ("v2", "v3"): plain}
    )
    for seq in range(21):
        metrics.add(truth("v1", seq, 0.6 * seq, 0.0))
        metrics.add(truth("v2", seq, 0.6 * seq - 15.0, 0.125))
        metrics.add(tracking("v2", seq, lateral_error_m=-0.09, gap_m=14.0 + seq))
        metrics.add(gps("v1", seq))
        metrics.add(verdict("v1", "v2", seq, latency_ms=42.0, dropped="" if seq % 3 else "loss"))
    metrics.add(gps("v2", 2))
    metrics.add(
        health("v2", 1, ticks=1050, late_ticks=12, rejected_messages=7, memory_bytes=64_000_000,
               cpu_ratio=0.043)
    )  # fmt: skip
    return RunSummary(
        identity=RunIdentity(scenario="trial", seed=11, clock=clock, run_id="x", versions={}),
        outcome="failed" if reason else "completed",
        reason=reason,
        duration_s=5.0,
        ran_s=1.0,
        recorder_rejected_messages={},
        vehicles=metrics.vehicle_summaries(),
        links=metrics.link_summaries(),
    )


def printed(figures: RunSummary, log: Path | None = None, width: int = 80) -> str:
    out = io.StringIO()
    print_summary(figures, log, Console(file=out, width=width))
    return out.getvalue()


def row(text: str, begin: str) -> list[str]:
    """Words of the table's row that begins so."""
    line = next(line for line in text.splitlines() if line.strip(" │┃").startswith(begin))
    return re.sub("[│┃]", " ", line).split()


def test_a_vehicle_s_row_tells_errors_gap_and_counts() -> None:
    text = printed(summary())
    assert "trial, wall clock, seed 11, 1.0 s" in text
    v2 = row(text, "v2 ")
    assert v2[1:4] == ["9.0", "/", "9.0"]
    assert v2[4:7] == ["12.5", "/", "12.5"]
    assert v2[7:] == ["14.0", "1", "2", "12", "7", "64", "4.3"]


def test_a_lead_has_no_distance_from_its_own_path() -> None:
    assert row(printed(summary()), "v1 ") == ["v1", *NO_ERROR, "-", "-", "21", *NO_FAULTS]


def test_nor_has_a_follower_that_was_never_on_the_road() -> None:
    assert row(printed(summary()), "v3 ") == ["v3", *NO_ERROR, "-", "-", "0", *NO_FAULTS]


def test_a_link_s_row_puts_achieved_beside_requested() -> None:
    text = printed(summary())
    assert row(text, "v1 → v2")[3:] == [
        "40",
        "/",
        "33.3",
        "20+80",
        "/",
        "42.0",
        "21",
        "14",
        "7",
        "loss",
        "0",
    ]
    assert row(text, "v1 → v3")[3:] == ["0", "/", "0.0", "20", "/", "0.0", "21", "0", "0", "0"]


def test_tables_fit_a_terminal_of_eighty_columns() -> None:
    text = printed(summary())
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text


def test_in_virtual_time_no_process_is_measured() -> None:
    figures = summary(clock="virtual")
    vehicles = tuple(replace(vehicle, memory_bytes_max=0) for vehicle in figures.vehicles)
    figures = replace(figures, vehicles=vehicles)
    assert row(printed(figures), "v2 ")[7:] == ["14.0", "1", "2", "12", "7"]


def test_one_vehicle_alone_has_no_table_of_links() -> None:
    assert "links" not in printed(replace(summary(), links=()))


def test_why_it_ended_and_where_the_log_is() -> None:
    text = printed(summary("v2 died 3.0 s after the start"), Path("runs/today/run.mcap"))
    assert "ended early: v2 died 3.0 s after the start" in text
    assert text.endswith("log: runs/today/run.mcap\n")
    assert "ended early" not in printed(summary())


@pytest.mark.parametrize("folder", ["runs[old]", "a[/b]", ":smile:", "x" * 120])
def test_a_path_is_printed_as_it_is(folder: str) -> None:
    text = printed(summary("stopped [/early]"), Path(folder) / "run.mcap")
    assert f"log: {folder}/run.mcap\n" in text
    assert "stopped [/early]" in text
