"""Tables of `convoy diff`."""

from collections import Counter
from collections.abc import Iterator, Sequence

from rich.console import Console
from rich.text import Text

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.studies.comparison.figure_diff import FigureDifference
from scenarios.studies.comparison.message_diff import MessageComparison
from scenarios.studies.comparison.run_diff import RunDiff
from scenarios.studies.comparison.settings_diff import SettingDifference

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
    """Print settings, messages, figures and the result; of the figures the main ones, or all."""
    for name, logs in (("A", diff.a), ("B", diff.b)):
        count = f" and {len(logs) - 1} more runs" if len(logs) > 1 else ""
        _print_line(f"{name}: {logs[0]}{count}", console)
    if diff.settings:
        more = len(diff.settings) - MOST_SETTINGS
        caption = f"{more} more, see --json" if more > 0 else None
        print_whole(
            table_of(SETTING_COLUMNS, diff.settings[:MOST_SETTINGS], caption=caption), console
        )
    elif diff.messages is None or not diff.is_equal:
        _print_line("settings: equal", console)
    if diff.messages is not None:
        for line in _message_lines(diff.messages):
            _print_line(line, console)
    _print_figures(diff, console, all_figures=all_figures)
    result = Text(diff.sentence)
    result.stylize("bold green" if diff.is_equal else "bold red")
    console.print(result, highlight=False, soft_wrap=True)


def _message_lines(messages: MessageComparison) -> Iterator[str]:
    if messages.is_equal:
        return
    if messages.first:
        yield f"first difference: {messages.first.sentence}"
    count = messages.differing.total()
    total = messages.equal + count
    yield f"differing: {count} of {total} messages in both{_by(messages.differing)}"
    for name, counts in (("A", messages.only_in_a), ("B", messages.only_in_b)):
        if counts:
            yield f"only in {name}: {counts.total()} messages{_by(counts)}"


def _by(counts: Counter[str]) -> str:
    listed = ", ".join(f"{count} {topic}" for topic, count in counts.most_common())
    return f" ({listed})" if listed else ""


def _print_figures(diff: RunDiff, console: Console, *, all_figures: bool) -> None:
    shown = [row for row in diff.figures if all_figures or row.is_main]
    hidden = len(diff.figures) - len(shown)
    if diff.messages is None:
        shown = [row for row in shown if all_figures or row.exceeds_noise]
    if shown:
        columns = FIGURE_COLUMNS if diff.messages is not None else NOISE_COLUMNS
        caption = f"{hidden} more differ, see --all or --json" if hidden else None
        print_whole(table_of(columns, shown, caption=caption), console)
        if diff.messages is not None:
            _print_line(
                "With one run a side the noise over seeds is unknown: give folders of runs.",
                console,
            )


def _print_line(line: str, console: Console) -> None:
    console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
