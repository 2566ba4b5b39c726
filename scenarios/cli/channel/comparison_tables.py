"""The laws of a link against a sample of them, for a terminal of 80 columns."""

from collections.abc import Iterator, Sequence

from rich.console import Console

from scenarios.cli.columns import Column, figure, table_of
from scenarios.definition.check.link_forecast import link_forecast
from scenarios.definition.scenario import Scenario
from scenarios.studies.channel.comparison import Compared, Comparison

WIDEST = 28
"""Characters of a bar that stands for all."""
EIGHTHS = " ▏▎▍▌▋▊▉"


def print_comparison(name: str, scenario: Scenario, found: Comparison, console: Console) -> None:
    """Print the laws and their figures next to those of the sample."""
    link = link_forecast(scenario, (found.sender, found.receiver))
    about = f"{name}, {found.sender} → {found.receiver}"
    console.print(about, style="bold", highlight=False, markup=False)
    for line in _about(link.preset_source, [law.words for law in link.laws], found):
        console.print(line, highlight=False, markup=False)
    console.print(table_of(FIGURE_COLUMNS, found.figures))
    _print_shares("messages lost in a row", found.bursts, console)
    _print_shares("received over", found.distances, console)
    if found.dropped:
        counts = ", ".join(f"{reason} {count}" for reason, count in found.dropped.items())
        console.print(f"dropped: {counts}", highlight=False, markup=False)


def _about(source: str | None, laws: Sequence[str], found: Comparison) -> Iterator[str]:
    if source:
        yield f"source: {source}"
    yield f"laws: {'; '.join(laws)}"
    between = f", {found.vehicles_between} vehicles in between" if found.vehicles_between else ""
    yield (
        f"sample: {found.messages} messages, {found.rate_hz:g} a second, {found.distance_m:g} m "
        f"apart at {found.speed_mps:.3g} m/s{between}"
    )


def _unit(one: Compared) -> tuple[str, float]:
    """Unit of a figure, and the factor from its own unit to that."""
    if one.figure == "loss":
        return " %", 100.0
    return ("" if one.figure == "lost in a row" else " ms"), 1.0


def _with_unit(one: Compared, value: float | None) -> str | None:
    unit, scale = _unit(one)
    return None if value is None else figure(value, ".4g", scale) + unit


def _interval(one: Compared) -> str:
    unit, scale = _unit(one)
    if one.low is None or one.high is None:
        return ""
    return f"{figure(one.low, '.4g', scale)} to {figure(one.high, '.4g', scale)}{unit}"


FIGURE_COLUMNS: Sequence[Column[Compared]] = (
    Column("", lambda one: one.figure, left=True),
    Column("law", lambda one: _with_unit(one, one.law)),
    Column("sample", lambda one: _with_unit(one, one.sample)),
    Column("95 % of samples like it", _interval, left=True),
)


def _print_shares(heading: str, rows: Sequence[Compared], console: Console) -> None:
    if not rows:
        return
    most = max(max(one.law or 0.0, one.sample or 0.0) for one in rows) or 1.0
    columns: Sequence[Column[Compared]] = (
        Column(heading, lambda one: one.figure, left=True),
        Column("law %", lambda one: one.law, ".2f", 100.0),
        Column("sample %", lambda one: one.sample or 0.0, ".2f", 100.0),
        Column("", lambda one: bar((one.sample or 0.0) / most), left=True),
    )
    console.print(table_of(columns, rows))


def bar(share: float, widest: int = WIDEST) -> str:
    """Bar of block characters for a share of the widest, to an eighth of a character."""
    eighths = round(8 * widest * min(max(share, 0.0), 1.0))
    return "█" * (eighths // 8) + EIGHTHS[eighths % 8].strip()
