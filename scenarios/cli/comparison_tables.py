"""The laws of a link and a sample of them, in 80 columns."""

from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.text import Text

from scenarios.cli.output import Column, figure, print_whole, table_of
from scenarios.definition.check.link_forecast import laws_of
from scenarios.definition.scenario import Scenario
from scenarios.studies.channel.comparison import ComparedFigure, Comparison
from scenarios.studies.comparison.run_diff import FigureDifference, RunDiff, SettingDifference

WIDEST = 28
"""Characters of the longest bar."""
EIGHTHS = " ▏▎▍▌▋▊▉"


def print_comparison(
    name: str, scenario: Scenario, comparison: Comparison, console: Console
) -> None:
    link = comparison.sender, comparison.receiver
    laws = [words for _, words in laws_of(scenario, link)]
    about = f"{name}, {comparison.sender} → {comparison.receiver}"
    console.print(about, style="bold", highlight=False, markup=False)
    for line in _about(scenario.links[link].preset_source, laws, comparison):
        console.print(line, highlight=False, markup=False)
    console.print(table_of(LINK_COLUMNS, comparison.figures))
    _print_shares("messages lost in a row", comparison.bursts, console)
    _print_shares("received over", comparison.distances, console)
    if comparison.dropped:
        counts = ", ".join(f"{reason} {count}" for reason, count in comparison.dropped.items())
        console.print(f"dropped: {counts}", highlight=False, markup=False)


def _about(source: str | None, laws: Sequence[str], comparison: Comparison) -> Iterator[str]:
    if source:
        yield f"source: {source}"
    yield f"laws: {'; '.join(laws)}"
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
    columns: Sequence[Column[ComparedFigure]] = (
        Column(heading, lambda row: row.figure, left=True),
        Column("law %", lambda row: row.law, ".2f", 100.0),
        Column("sample %", lambda row: row.sample or 0.0, ".2f", 100.0),
        Column("", lambda row: bar((row.sample or 0.0) / most), left=True),
    )
    console.print(table_of(columns, rows))


def bar(share: float, widest: int = WIDEST) -> str:
    """Bar of block characters for a share of the widest, to an eighth of a character."""
    eighths = round(8 * widest * min(max(share, 0.0), 1.0))
    return "█" * (eighths // 8) + EIGHTHS[eighths % 8].strip()


# ---- Tables of `convoy diff`


MOST_SETTINGS = 30
"""Printed settings at most; the JSON has them all."""
NOT_SET = "not set"

SETTING_COLUMNS: Sequence[Column[SettingDifference]] = (
    Column("setting", lambda row: row.key, left=True, wraps=True),
    Column("A", lambda row: row.a or NOT_SET, left=True, wraps=True),
    Column("B", lambda row: row.b or NOT_SET, left=True, wraps=True),
)
FIGURE_COLUMNS: Sequence[Column[FigureDifference]] = (
    Column("figure", lambda row: row.name, left=True),
    Column("A", lambda row: row.a, ".4g"),
    Column("B", lambda row: row.b, ".4g"),
    Column("B - A", lambda row: row.difference, "+.3g"),
)
NOISE_COLUMNS: Sequence[Column[FigureDifference]] = (
    Column("figure", lambda row: row.name, left=True),
    Column("mean\nof A", lambda row: row.a, ".4g"),
    Column("mean\nof B", lambda row: row.b, ".4g"),
    Column("B - A", lambda row: row.difference, "+.3g"),
    Column("99 % interval\nof B - A", lambda row: (row.low, row.high), "+.3g"),
    Column("beyond\nnoise", lambda row: "yes" if row.exceeds_noise else "no"),
)


def print_diff(diff: RunDiff, console: Console, *, all_figures: bool) -> None:
    """Print settings, figures and the result; of the figures the main ones, or all."""
    for name, logs in (("A", diff.a), ("B", diff.b)):
        count = f" and {len(logs) - 1} more runs" if len(logs) > 1 else ""
        _print_line(f"{name}: {logs[0]}{count}", console)
    if diff.settings:
        more = len(diff.settings) - MOST_SETTINGS
        caption = f"{more} more, see --json" if more > 0 else None
        print_whole(
            table_of(SETTING_COLUMNS, diff.settings[:MOST_SETTINGS], caption=caption), console
        )
    elif not diff.is_equal:
        _print_line("settings: equal", console)
    _print_figures(diff, console, all_figures=all_figures)
    result = Text(diff.sentence)
    result.stylize("bold green" if diff.is_equal else "bold red")
    console.print(result, highlight=False, soft_wrap=True)


def _print_figures(diff: RunDiff, console: Console, *, all_figures: bool) -> None:
    shown = [row for row in diff.figures if all_figures or row.is_main]
    hidden = len(diff.figures) - len(shown)
    if diff.compared is None:
        shown = [row for row in shown if all_figures or row.exceeds_noise]
    if shown:
        columns = FIGURE_COLUMNS if diff.compared is not None else NOISE_COLUMNS
        caption = f"{hidden} more differ, see --all or --json" if hidden else None
        print_whole(table_of(columns, shown, caption=caption), console)
        if diff.compared is not None:
            _print_line(
                "With one run a side the noise over seeds is unknown: give folders of runs.",
                console,
            )


def _print_line(line: str, console: Console) -> None:
    console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
