import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from scenarios.cli.common_options import Tables
from scenarios.cli.summary_tables import print_summary
from scenarios.results.link_account import accounts
from scenarios.results.links import link_summaries
from scenarios.results.outcome import with_outcome_line
from scenarios.results.reaction import ReactionSummary
from scenarios.results.run_event import RunEvent
from scenarios.results.summary import ClockName, RunIdentity, RunSummary
from scenarios.results.vehicle_figures import vehicle_summaries
from tests.made.scenarios import recorded_run
from tests.made.scenarios.messages import gps, health, tracking, truth, verdict
from tests.made.scenarios.tables import straight_scenario
from vehicles.messages import Message

REQUESTED = 'link=[{sender="v1", receiver="v2", jitter_ms=80.0, loss_ratio=0.4}]'

EVENTS = (
    RunEvent(kind="near_miss", at_s=1.5, vehicles=("v1", "v2"), figures={"gap_m_min": 0.25}),
    RunEvent(
        kind="collision", at_s=3.25, vehicles=("v2", "v3"), figures={"closing_speed_mps": 6.4}
    ),
    RunEvent(
        kind="lane_departure", at_s=4.0, vehicles=("v3",),
        figures={"excess_m_max": 0.5, "duration_s": 1.25},
    ),
)  # fmt: skip


def summary(reason: str = "", clock: ClockName = "wall") -> RunSummary:
    """Figures of two followers behind a lead, of which v3 has been silent."""
    messages: list[Message] = [truth("v1", -1, -20.0, 0.0)]  # v2 begins after the start of the path
    for seq in range(21):
        lost = "" if seq % 3 else "loss"
        messages += [
            truth("v1", seq, 0.6 * seq, 0.0),
            truth("v2", seq, 0.6 * seq - 15.0, 0.125),
            tracking(
                "v2",
                seq,
                lateral_error_m=-0.09,
                estimated_gap_m=14.0 + seq,
                lateral_deviation_m=0.04,
            ),
            gps("v1", seq),
            verdict("v1", "v2", seq, latency_ms=42.0, dropped=lost),
        ]
    counters = health(
        "v2",
        1,
        ticks=1050,
        late_ticks=12,
        rejected_messages=7,
        memory_bytes=64_000_000,
        cpu_ratio=0.043,
    )
    messages += [gps("v2", 2), counters]
    recorded = [(0, message) for message in messages]
    run = recorded_run.tables_of(recorded, straight_scenario(3, (REQUESTED,)), ran_s=1.0)
    return RunSummary(
        identity=RunIdentity(scenario="trial", seed=11, clock=clock, run_id="x", versions={}),
        outcome="failed" if reason else "completed",
        reason=reason,
        duration_s=5.0,
        ran_s=1.0,
        recorder_rejected_messages={},
        vehicles=vehicle_summaries(run, {}),
        links=tuple(row for row in link_summaries(run, accounts(run)) if row.receiver != "v1"),
    )


def printed(
    figures: RunSummary, log: Path | None = None, width: int = 80, tables: Tables = "all"
) -> str:
    out = io.StringIO()
    print_summary(figures, log, Console(file=out, width=width), tables)
    return out.getvalue()


def tables_of(text: str) -> int:
    return len(re.findall(r"^ *─+ *$", text, re.MULTILINE))


def row(text: str, begin: str, table: int = 0) -> list[str]:
    lines = [line for line in text.splitlines() if line.strip(" │┃").startswith(begin)]
    return re.sub("[│┃]", " ", lines[table]).split()


def test_a_vehicle_s_row_has_true_figures_next_to_estimates() -> None:
    text = printed(summary())
    assert "trial, seed 11, wall clock, 1.0 s" in text
    figures = "v2 12.5 / 12.5 12.5 10.0 / 10.0 9.0 / 9.0 14.0 0"
    assert row(text, "v2 ") == figures.split()
    headings = [re.split(r"  +", line.strip()) for line in text.splitlines()[2:5]]
    assert headings == [
        ["true", "road", "true", "estimated", "estimated", "friction"],
        ["error, cm", "error", "gap, m", "error, cm", "gap, m", "used, %"],
        ["vehicle", "max / rms", "max, cm", "min / max", "max / rms", "min", "max"],
    ]


def test_degradation_has_its_own_table() -> None:
    figures = summary()
    assert "degradation" not in printed(figures)
    did = ReactionSummary(
        mode_changes=7, recoveries=2, recovery_s_mean=3.25, recovery_s_max=4.0, stops=1,
        blind_m=12.34, predicted_blind_m_max=12.5, hazards=1,
    )  # fmt: skip
    lead, second, third = figures.vehicles
    second = replace(second, reaction=did, overridden_ratio=0.254, overrides={"alone": 0.254})
    text = printed(replace(figures, vehicles=(lead, second, third)))
    table = text[text.index("degradation") : text.index("links:")]
    assert row(table, "v2 ") == ["v2", "7", "2", "3.2", "/", "4.0", "25", "1", "12.3", "/", "12.5"]
    assert row(table, "v3 ") == ["v3", "0", "0", "-", "/", "-", "-", "0", "0.0", "/", "-"]
    assert "v1" not in table


def test_events_are_rows_with_their_figures() -> None:
    text = printed(replace(summary(), events=EVENTS))
    assert "events: 1 near miss, 1 collision, 1 lane departure" in text
    rows = [" ".join(line.split()) for line in text.splitlines()]
    assert "1.50 near miss v1, v2 gap 0.25 m" in rows
    assert "3.25 collision v2, v3 closing at 6.4 m/s" in rows
    assert "4.00 lane departure v3 up to 0.50 m outside the lane; lasted 1.2 s" in rows
    assert "…" not in text
    many = printed(replace(summary(), events=EVENTS[:1] * 50))
    assert "10 more" in many
    assert "events: 50 near misses" in many
    assert "events:" not in printed(summary())


def test_a_link_s_row_puts_achieved_beside_requested() -> None:
    text = printed(summary())
    assert " ".join(row(text, "v1 → v2")[3:]) == "40 / 33.3 1.67 / 1 60 / 42.0"
    assert " ".join(row(text, "v1 → v3")[3:]) == "0 / 0.0 - / - 20 / -"
    assert " ".join(row(text, "v1 → v2", 1)[3:]) == "21 14 0 0 7 loss 0 0"
    assert " ".join(row(text, "v1 → v3", 1)[3:7]) == "21 0 0 0"
    assert text.count("requested / achieved") == 3


def test_tables_fit_a_terminal_of_eighty_columns() -> None:
    busy = ReactionSummary(mode_changes=12, stops=2, blind_m=12.34)
    figures = summary()
    lead, *followers = figures.vehicles
    followers = [
        replace(one, reaction=busy, cross_track_error_m_max=3.733, cross_track_error_m_rms=1.12)
        for one in followers
    ]
    for vehicles in (figures.vehicles, (lead, *followers)):
        text = printed(replace(figures, vehicles=vehicles))
        assert max(map(len, text.splitlines()[:-1])) <= 80  # without the outcome line
        assert "…" not in text


def test_the_outcome_line_and_the_log_come_last() -> None:
    failed = summary("v2 failed 3.0 s after the start")
    *_, outcome, log = printed(failed, Path("runs/today/run.mcap")).splitlines()
    assert outcome == with_outcome_line(failed).outcome_line
    assert outcome.startswith("FAILED: v2 failed 3.0 s after the start")
    assert log == "log: runs/today/run.mcap"
    assert "failed: " not in printed(failed)
    two = printed(summary("v2 failed; limits.collisions_max = 0: v2"))
    assert "failed: v2 failed\nfailed: limits.collisions_max = 0: v2\nFAILED: v2 failed; " in two


def test_a_quiet_run_prints_one_table_and_others_only_with_news() -> None:
    figures = summary()
    lead, second, third = (
        replace(one, late_ticks=0, missing_poses=0, rejected_messages=0) for one in figures.vehicles
    )
    calm = replace(figures, vehicles=(lead, second, third))
    assert tables_of(printed(calm)) == 6
    assert tables_of(printed(calm, tables="news")) == 1

    def news(**changed: Any) -> int:
        return tables_of(printed(replace(calm, **changed), tables="news"))

    assert news(events=EVENTS) == 2
    assert news(warnings=("v1 → v2: lost 33 % of 21 messages",)) == 3
    assert news(links=(replace(calm.links[0], dropped={"cut": 3}),)) == 3
    assert news(links=(replace(calm.links[0], late=4),)) == 3
    disturbed = replace(third, ticks=1000, late_ticks=12)
    for one in (disturbed, replace(third, missing_poses=1), replace(third, rejected_messages=1)):
        assert news(vehicles=(lead, second, one)) == 2
    few, stop = ReactionSummary(mode_changes=1), ReactionSummary(stops=1)
    assert news(vehicles=(lead, replace(second, reaction=few), third)) == 1
    assert news(vehicles=(lead, replace(second, reaction=stop), third)) == 2
