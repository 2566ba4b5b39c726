"""How a convoy goes, as tables of a terminal that refresh, or as JSON."""

from collections.abc import Callable

import click
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table

from scenarios.cli.tables import worst_rows
from scenarios.runs.control.status import RunStatus, SourceFigures, VehicleFiguresNow
from scenarios.runs.stop import Stop
from transport.bus.bus import BusError
from transport.clock import poll
from transport.texts import printable

POLL_S = 0.05
MOST_ROWS = 10
"""Of more vehicles, or links, than this a table that refreshes has only the worst."""
HAZARD_M = 1000.0
"""True error of which hazard lights are worth more."""
NUMBERS = (
    "speed\nm/s", "error\ncm", "gap\nm", "knows\nm", "lead\nage s", "rec.\n%", "ahead\nage s",
    "rec.\n%",
)  # fmt: skip
"""Headings of the figures: true error and gap, known path, age and received share of a source."""


def show(
    read: Callable[[], RunStatus | None],
    console: Console,
    stop: Stop,
    *,
    every_s: float | None,
    as_json: bool,
) -> bool:
    """Show the status that is read every so often, or once; returns whether there was one.

    A run that ends ends this, too.
    """
    first = read()
    if every_s is None or as_json or not console.is_terminal:
        found = _print(first, console, as_json=as_json)
        while every_s is not None and not _wait(stop, every_s):
            try:
                found |= _print(read(), console, as_json=as_json)
            except BusError:
                return found
        return found
    with Live(console=console, auto_refresh=False) as live:
        live.update(tables(first, MOST_ROWS), refresh=True)
        while not _wait(stop, every_s):
            try:
                live.update(tables(read(), MOST_ROWS), refresh=True)
            except BusError:
                return True
    return True


def _wait(stop: Stop, seconds: float) -> bool:
    """Wait, and say whether it is enough."""
    return poll(lambda: stop.asked, every_s=POLL_S, at_most_s=seconds)


def _print(status: RunStatus | None, console: Console, *, as_json: bool) -> bool:
    if status is not None and as_json:
        click.echo(status.text)
    elif status is not None:
        console.print(tables(status))
    return status is not None


def tables(status: RunStatus | None, most: int | None = None) -> Group:
    """The vehicles and the links of a run, or the worst of them, `most` of each."""
    if status is None:
        return Group("has not started yet")
    shown = worst_rows(status.vehicles, _trouble, most)
    lossy = worst_rows(status.links, lambda link: link.loss_ratio or 0.0, most)
    title = f"{printable(status.run)}: {status.at_s:.1f} of {status.duration_s:.1f} s"
    caption = _left_out("vehicles", len(shown), len(status.vehicles))
    vehicles = Table(title=title, caption=caption, box=None, padding=(0, 1, 0, 0))
    for heading in ("vehicle", "steers\nalong"):
        vehicles.add_column(heading, no_wrap=True)
    for heading in NUMBERS:
        vehicles.add_column(heading, justify="right", no_wrap=True)
    vehicles.add_column("sources")
    for one in shown:
        vehicles.add_row(*_row(one))
    caption = _left_out("links", len(lossy), len(status.links))
    links = Table(caption=caption, min_width=len(caption or ""), box=None, padding=(0, 1, 0, 0))
    links.add_column("link", no_wrap=True)
    links.add_column("lost in\n3 s, %", justify="right", no_wrap=True)
    links.add_column("", no_wrap=True)
    for link in lossy:
        lost = "-" if link.loss_ratio is None else f"{100 * link.loss_ratio:.0f}"
        name = printable(f"{link.sender} → {link.receiver}")
        links.add_row(name, lost, "changed" if link.changed else "")
    return Group(vehicles, links)


def _trouble(one: VehicleFiguresNow) -> float:
    """How much a vehicle wants to be looked at: with hazard lights most, then by its true error."""
    return (HAZARD_M if one.hazard else 0.0) + abs(one.true_error_m or 0.0)


def _left_out(what: str, shown: int, there: int) -> str | None:
    return f"the worst {shown} of {there} {what}" if shown < there else None


def _row(one: VehicleFiguresNow) -> tuple[str, ...]:
    error = None if one.true_error_m is None else 100 * one.true_error_m
    sources = {"lead": one.lead, "ahead": one.predecessor}
    unusual = [
        f"{name} {printable(source.status)}"
        for name, source in sources.items()
        if source and source.status != "fresh"
    ]
    return (
        printable(one.name),
        printable(one.mode),
        f"{one.speed_mps:.1f}",
        _number(error),
        _number(one.true_gap_m),
        _number(one.known_m),
        *_source(one.lead),
        *_source(one.predecessor),
        ", ".join((*(["HAZARD"] if one.hazard else []), *unusual)),
    )


def _source(one: SourceFigures | None) -> tuple[str, str]:
    """Age of a source and share received of it."""
    if one is None:
        return "-", "-"
    share = None if one.received_ratio is None else 100 * one.received_ratio
    return _number(one.age_s, 2), _number(share, 0)


def _number(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
