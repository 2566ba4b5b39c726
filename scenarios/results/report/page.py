"""The report of a run as one HTML file: no request to a network, light and dark."""

import shlex
from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from scenarios.results.figure_style import vehicle_colour
from scenarios.results.files import write_whole
from scenarios.results.outcome import with_outcome_line
from scenarios.results.record import hole_lines
from scenarios.results.run_event import RunEvent
from scenarios.results.run_figures import MOST_CURVES, report_figures, vehicles_with_truth
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import LimitFigure, RunChange, RunSummary
from scenarios.results.summary_columns import EVENT_COLUMNS, Column, SummaryTable, tables_of

MOST_ROWS, MOST_WARNINGS, MOST_HOLES = 60, 50, 10
CHANGE_COLUMNS: Sequence[Column[RunChange]] = (
    Column("at, s", lambda row: row.at_s, ".2f"),
    Column("change", lambda row: f"{row.kind} {row.target}", left=True),
    Column("for, s", lambda row: row.for_s, "g"),
    Column("by hand", lambda row: "yes" if row.by_hand else "", left=True),
)
LIMIT_COLUMNS: Sequence[Column[LimitFigure]] = (
    Column("limit", lambda row: f"{row.vehicle} {row.limit} {row.action}".strip(), left=True),
    Column("allowed", lambda row: row.bound, ".4g"),
    Column("value", lambda row: row.value, ".4g"),
    Column("result", lambda row: row.message or "kept", left=True),
)


def write_report(record: RunRecord, path: Path, summary: RunSummary | None = None) -> None:
    """Write the report of a run; `summary` is by default that of its log.

    An existing file is replaced. Raises LogError or OSError.
    """
    write_whole(path, report_page(record, summary or record.summary).encode())


def report_page(record: RunRecord, summary: RunSummary) -> str:
    about, outcome = summary.identity, with_outcome_line(summary).outcome_line
    environment = Environment(
        loader=PackageLoader("scenarios.results.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.globals["exact"] = exact_value
    return environment.get_template("page.html").render(
        title=about.title or f"{about.scenario}, seed {about.seed}",
        about=about,
        summary=summary,
        outcome=outcome,
        verdict={"OK": "good", "FAILED": "bad"}.get(outcome.split(":")[0], ""),
        log=shlex.quote(str(record.log)),
        warnings=_warnings(record, summary),
        tables=list(_tables(record, summary)),
        most_rows=MOST_ROWS,
        colours={name: vehicle_colour(place) for place, name in enumerate(record.vehicle_names)},
        figures=list(report_figures(record, summary)),
        left_out=max(len(vehicles_with_truth(record)) - MOST_CURVES, 0),
    )


def exact_value(column: Column[Any], row: Any) -> str:
    """Numbers of a cell as in `summary.json`, with slashes between them; empty for a text."""
    value = column.value(row)
    values = value if isinstance(value, tuple) else (value,)
    known = [one for one in values if isinstance(one, int | float) and isfinite(one)]
    return " / ".join(map(repr, known))


def _warnings(record: RunRecord, summary: RunSummary) -> list[str]:
    """Reasons of a failure, what is missing in the log and so in the metrics, and warnings."""
    lines = [f"failed: {reason}" for reason in summary.reason.split("; ") if reason]
    lines += filter(None, [summary.log_faults or record.faults])
    lines += hole_lines(summary.holes, MOST_HOLES)
    for row in summary.vehicles:
        if row.silent_from_s is not None:
            lines.append(f"silent: {row.name} from {row.silent_from_s:.2f} s after the start on")
    lines += summary.warnings
    if len(lines) > MOST_WARNINGS:
        more = len(lines) - MOST_WARNINGS
        lines = [*lines[:MOST_WARNINGS], f"{more} more warnings are in summary.json"]
    return lines


def _tables(record: RunRecord, summary: RunSummary) -> Iterator[SummaryTable]:
    yield from tables_of(summary)
    log = shlex.quote(str(record.log))
    command: Column[RunEvent] = Column(
        "command that shows it",
        lambda event: f"convoy review {log} --at {event.at_s:.2f}",
        left=True,
    )
    for table in (
        SummaryTable("events", [*EVENT_COLUMNS, command], summary.events),
        SummaryTable("changes", CHANGE_COLUMNS, summary.changes),
        SummaryTable("limits", LIMIT_COLUMNS, summary.limits),
    ):
        if table.rows:
            yield table
