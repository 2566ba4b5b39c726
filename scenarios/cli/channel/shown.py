"""The laws of a link against a sample of them, for a terminal of 80 columns."""

from collections.abc import Iterator, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from scenarios.definition.check.links import asked_link
from scenarios.definition.scenario import Scenario
from scenarios.studies.channel.comparison import Compared, Comparison

WIDEST = 28
"""Characters of a bar that stands for all."""
EIGHTHS = " ▏▎▍▌▋▊▉"


def print_comparison(name: str, scenario: Scenario, found: Comparison, console: Console) -> None:
    """Print the laws in words, and each figure of theirs beside the sample's."""
    asked = asked_link(scenario, (found.sender, found.receiver))
    about = f"{name}, {found.sender} → {found.receiver}"
    console.print(about, style="bold", highlight=False, markup=False)
    for line in _told(asked.preset_source, [law.words for law in asked.laws], found):
        console.print(line, highlight=False, markup=False)
    figures = _table("", "law", "sample", "95 % of samples like it")
    for one in found.figures:
        figures.add_row(one.figure, *_figures(one))
    console.print(figures)
    _print_shares("messages lost in a row", found.bursts, console)
    _print_shares("received over", found.distances, console)
    if found.dropped:
        said = ", ".join(f"{reason} {count}" for reason, count in found.dropped.items())
        console.print(f"dropped: {said}", highlight=False, markup=False)


def _told(source: str | None, laws: Sequence[str], found: Comparison) -> Iterator[str]:
    if source:
        yield f"source: {source}"
    yield f"laws: {'; '.join(laws)}"
    between = f", {found.vehicles_between} vehicles in between" if found.vehicles_between else ""
    yield (
        f"sample: {found.messages} messages, {found.rate_hz:g} a second, {found.distance_m:g} m "
        f"apart at {found.speed_mps:.3g} m/s{between}"
    )


def _table(*headings: str) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="right" if place in {1, 2} else "left", no_wrap=True)
    return table


def _figures(one: Compared) -> tuple[str, str, str]:
    """Law, sample and interval; a loss in per cent, delays in ms."""
    unit, times = ("", 1.0) if one.figure == "lost in a row" else (" ms", 1.0)
    unit, times = (" %", 100.0) if one.figure == "loss" else (unit, times)
    law, sample = (
        "-" if value is None else f"{times * value:.4g}{unit}" for value in (one.law, one.sample)
    )
    if one.low is None or one.high is None:
        return law, sample, ""
    return law, sample, f"{times * one.low:.4g} to {times * one.high:.4g}{unit}"


def _print_shares(heading: str, rows: Sequence[Compared], console: Console) -> None:
    """Print shares with a bar for each of the sample's, drawn to the largest."""
    if not rows:
        return
    table = _table(heading, "law %", "sample %", "")
    most = max(max(one.law or 0.0, one.sample or 0.0) for one in rows) or 1.0
    for one in rows:
        law = "-" if one.law is None else f"{100.0 * one.law:.2f}"
        value = one.sample or 0.0
        table.add_row(one.figure, law, f"{100.0 * value:.2f}", bar(value / most))
    console.print(table)


def bar(share: float, widest: int = WIDEST) -> str:
    """Bar of block characters for a share of the widest, to an eighth of a character."""
    eighths = round(8 * widest * min(max(share, 0.0), 1.0))
    return "█" * (eighths // 8) + EIGHTHS[eighths % 8].strip()
