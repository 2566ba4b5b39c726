"""The settings of a link and a sample of it, in 80 columns."""

import json
from collections.abc import Iterator, Sequence

from rich.console import Console

from scenarios.cli.output import table_of
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.summary_columns import Column, figure
from scenarios.studies.channel.comparison import ComparedFigure, Comparison

WIDEST = 28
"""Characters of the longest bar."""
EIGHTHS = " ▏▎▍▌▋▊▉"


def print_comparison(
    name: str, scenario: Scenario, comparison: Comparison, console: Console
) -> None:
    link = comparison.sender, comparison.receiver
    about = f"{name}, {comparison.sender} → {comparison.receiver}"
    console.print(about, style="bold", highlight=False, markup=False)
    for line in _about(scenario.links[link], comparison):
        console.print(line, highlight=False, markup=False)
    console.print(table_of(LINK_COLUMNS, comparison.figures))
    _print_shares("messages lost in a row", comparison.bursts, console)
    _print_shares("received over", comparison.distances, console)
    if comparison.dropped:
        counts = ", ".join(f"{reason} {count}" for reason, count in comparison.dropped.items())
        console.print(f"dropped: {counts}", highlight=False, markup=False)


def _about(table: LinkTable, comparison: Comparison) -> Iterator[str]:
    if table.preset_source:
        yield f"source: {table.preset_source}"
    settings = table.model_dump(include=set(LinkTable.model_fields), exclude={"preset_source"})
    for key, value in settings.items():
        if value not in (None, LinkTable.model_fields[key].default):
            yield f"{key} = {json.dumps(value)}"
    between = (
        f", {comparison.vehicles_between} vehicles between" if comparison.vehicles_between else ""
    )
    yield (
        f"sample: {comparison.messages} messages, {comparison.rate_hz:g} per second, "
        f"{comparison.distance_m:g} m apart at {comparison.speed_mps:.3g} m/s{between}"
    )


def _unit(row: ComparedFigure) -> tuple[str, float]:
    """Unit of a figure, and the factor to it."""
    if row.figure == "loss":
        return " %", 100.0
    return ("" if row.figure == "lost in a row" else " ms"), 1.0


def _with_unit(row: ComparedFigure, value: float | None) -> str | None:
    unit, scale = _unit(row)
    return None if value is None else figure(value, ".4g", scale) + unit


def _interval(row: ComparedFigure) -> str:
    unit, scale = _unit(row)
    if row.low is None or row.high is None:
        return ""
    return f"{figure(row.low, '.4g', scale)} to {figure(row.high, '.4g', scale)}{unit}"


LINK_COLUMNS: Sequence[Column[ComparedFigure]] = (
    Column("", lambda row: row.figure, left=True),
    Column("law", lambda row: _with_unit(row, row.law)),
    Column("sample", lambda row: _with_unit(row, row.sample)),
    Column("95 % interval", _interval, left=True),
)


def _print_shares(heading: str, rows: Sequence[ComparedFigure], console: Console) -> None:
    if not rows:
        return
    most = max(max(row.law or 0.0, row.sample or 0.0) for row in rows) or 1.0
    law: Column[ComparedFigure] = Column("law %", lambda row: row.law, ".2f", 100.0)
    columns: Sequence[Column[ComparedFigure]] = (
        Column(heading, lambda row: row.figure, left=True),
        *((law,) if any(row.law is not None for row in rows) else ()),
        Column("sample %", lambda row: row.sample or 0.0, ".2f", 100.0),
        Column("", lambda row: bar((row.sample or 0.0) / most), left=True),
    )
    console.print(table_of(columns, rows))


def bar(share: float, widest: int = WIDEST) -> str:
    """Bar of block characters for a share of the widest, to an eighth of a character."""
    eighths = round(8 * widest * min(max(share, 0.0), 1.0))
    return "█" * (eighths // 8) + EIGHTHS[eighths % 8].strip()
