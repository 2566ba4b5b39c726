"""The status of a run as tables that refresh in a terminal, or as JSON."""

from collections.abc import Callable, Sequence

import click
from rich.console import Console, Group
from rich.live import Live

from scenarios.cli.columns import Column, table_of, worst_rows
from scenarios.runs.control.run_status import LinkStatus, RunStatus, VehicleStatus
from scenarios.runs.stop import Stop
from transport.bus.bus import BusError
from transport.clock import poll
from transport.texts import printable

POLL_S = 0.05
MOST_ROWS = 10
"""Maximum number of rows in a table that refreshes; the worst are shown."""
HAZARD_M = 1000.0
"""True error (m) that ranks like hazard lights."""


def _sources(vehicle: VehicleStatus) -> str:
    """List hazard lights, and the status of each source that is not fresh."""
    sources = {"lead": vehicle.lead, "ahead": vehicle.predecessor, **vehicle.others}
    unusual = [
        f"{name} {printable(source.status)}"
        for name, source in sources.items()
        if source and source.status not in {"fresh", "unused"}
    ]
    return ", ".join((*(["HAZARD"] if vehicle.hazard else []), *unusual))


VEHICLE_COLUMNS: Sequence[Column[VehicleStatus]] = (
    Column("vehicle", lambda vehicle: printable(vehicle.name), left=True),
    Column("steers\nalong", lambda vehicle: printable(vehicle.mode), left=True),
    Column("speed\nm/s", lambda vehicle: vehicle.speed_mps, ".1f"),
    Column("error\ncm", lambda vehicle: vehicle.true_error_m, ".1f", 100),
    Column("gap\nm", lambda vehicle: vehicle.true_gap_m, ".1f"),
    Column("known\npath m", lambda vehicle: vehicle.known_m, ".1f"),
    Column("lead\nage s", lambda vehicle: vehicle.lead.age_s if vehicle.lead else None, ".2f"),
    Column(
        "rec.\n%", lambda vehicle: vehicle.lead.received_ratio if vehicle.lead else None, ".0f", 100
    ),
    Column(
        "ahead\nage s",
        lambda vehicle: vehicle.predecessor.age_s if vehicle.predecessor else None,
        ".2f",
    ),
    Column(
        "rec.\n%",
        lambda vehicle: vehicle.predecessor.received_ratio if vehicle.predecessor else None,
        ".0f",
        100,
    ),
    Column("sources", _sources, left=True, wraps=True),
)
LINK_COLUMNS: Sequence[Column[LinkStatus]] = (
    Column("link", lambda link: printable(f"{link.sender} → {link.receiver}"), left=True),
    Column("lost in\n3 s, %", lambda link: link.loss_ratio, ".0f", 100),
    Column("", lambda link: "changed" if link.changed else "", left=True),
)


def show(
    read: Callable[[], RunStatus | None],
    console: Console,
    stop: Stop,
    *,
    every_s: float | None,
    as_json: bool,
) -> bool:
    """Show the status every `every_s` seconds until the run ends, or once.

    Returns whether the run has a status, which it lacks before its start.
    """
    first = read()
    if every_s is None or as_json or not console.is_terminal:
        has_status = _print(first, console, as_json=as_json)
        while every_s is not None and not _wait(stop, every_s):
            try:
                has_status |= _print(read(), console, as_json=as_json)
            except BusError:
                return has_status
        return has_status
    with Live(console=console, auto_refresh=False) as live:
        live.update(tables(first, MOST_ROWS), refresh=True)
        while not _wait(stop, every_s):
            try:
                live.update(tables(read(), MOST_ROWS), refresh=True)
            except BusError:
                return True
    return True


def _wait(stop: Stop, seconds: float) -> bool:
    return poll(lambda: stop.requested, every_s=POLL_S, at_most_s=seconds)


def _print(status: RunStatus | None, console: Console, *, as_json: bool) -> bool:
    if status is not None and as_json:
        click.echo(status.text)
    elif status is not None:
        console.print(tables(status))
    return status is not None


def tables(status: RunStatus | None, most: int | None = None) -> Group:
    """Return tables of the vehicles and links of a run: all of them, or the `most` worst."""
    if status is None:
        return Group("the run has not started yet")
    shown = worst_rows(status.vehicles, _trouble, most)
    lossy = worst_rows(status.links, lambda link: link.loss_ratio or 0.0, most)
    title = f"{printable(status.run)}: {status.at_s:.1f} of {status.duration_s:.1f} s"
    caption = _left_out("vehicles", len(shown), len(status.vehicles))
    vehicles = table_of(VEHICLE_COLUMNS, shown, title=title, caption=caption, box=None)
    caption = _left_out("links", len(lossy), len(status.links))
    width = len(caption or "")
    links = table_of(LINK_COLUMNS, lossy, caption=caption, min_width=width, box=None)
    return Group(vehicles, links)


def _trouble(vehicle: VehicleStatus) -> float:
    return (HAZARD_M if vehicle.hazard else 0.0) + abs(vehicle.true_error_m or 0.0)


def _left_out(name: str, shown: int, total: int) -> str | None:
    return f"the worst {shown} of {total} {name}" if shown < total else None
