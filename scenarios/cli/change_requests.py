"""Requests to the vehicles of a run, and their answers."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from threading import Event
from typing import Any

import click
from rich.console import Console, Group
from rich.live import Live

from scenarios.cli.common_options import zenoh_from
from scenarios.cli.output import table_of, worst_rows
from scenarios.definition.changes import ChangeRequest
from scenarios.results.summary_columns import Column
from scenarios.runs.end_confirmation import addressed
from scenarios.runs.live_control import Confirmation
from scenarios.runs.open_runs import OpenRun, open_runs
from scenarios.runs.processes.membership import RECORDER, VEHICLE, checked_run_name, shown
from scenarios.runs.run_status import LinkStatus, RunStatus, VehicleStatus
from scenarios.runs.stop import Stop
from transport.bus.bus import Bus, BusError, Member
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.clock import SYSTEM_TIME, SystemTime, poll
from transport.texts import printable
from transport.topics import RUN_SENDER, control_key
from vehicles.schedule import MILLISECOND

ANSWER_TIMEOUT_S = 5.0
"""Timeout of an answer, which usually takes a few milliseconds."""
AHEAD_S = (0.1, 0.3, 1.0, 3.0)
"""Time of each attempt from the first possible instant to the change."""
PASSES = 2
"""The change lies at least this multiple of the slowest answering time after the first answers:
promise and confirmation have to arrive."""
GRID_S = 0.02
"""Changes take effect at multiples of this time, which most control rates meet."""


@dataclass(frozen=True, slots=True)
class VehicleAnswer:
    """Answer of a vehicle and its delay; the answer is None after the timeout."""

    vehicle: str
    answer: Confirmation | None
    took_ms: float


def run_to_join(
    run_name: str | None, flags: dict[str, Any], runs: Sequence[OpenRun]
) -> ZenohOptions:
    """Return the Zenoh options to join a run: those of the flags, or of an open run.

    Raises BusError if no run, or several runs, match.
    """
    if run_name is not None:
        checked_run_name(run_name)
    has_flags = any(flags[key] for key in ("connect", "listen", "config", "cfg", "mode"))
    matching = [open_run for open_run in runs if run_name in {None, open_run.run}]
    if run_name is not None and has_flags:
        return zenoh_from(flags, run_name)
    if has_flags:
        raise BusError("--run: missing, it is required with -m, -e, -l, -c or --cfg")
    if run_name is not None and not matching:
        running = ", ".join(open_run.run for open_run in runs)
        here = f"allowed {running}" if running else "none is running"
        where = f"--run {printable(run_name)}: no such run on this machine"
        raise BusError(f"{where}, {here}; give -e for another router")
    if not matching:
        raise BusError("no run started by `convoy run` here; give --run, and -e for its router")
    if len(matching) > 1:
        names = ", ".join(open_run.run for open_run in matching)
        raise BusError(f"{len(matching)} runs on this machine; give one by --run: {names}")
    return replace(zenoh_from(flags, matching[0].run), connect=(matching[0].endpoint,))


def folder_of(run: str) -> str:
    """Return the folder of a run on this machine; empty for an unknown run."""
    return next((open_run.folder for open_run in open_runs() if open_run.run == run), "")


@contextmanager
def joined(run_name: str | None, flags: dict[str, Any]) -> Iterator[tuple[Bus, str]]:
    options = replace(run_to_join(run_name, flags, open_runs()), connect_timeout_s=2.0)
    with open_bus(options) as bus:
        yield bus, options.run


def request_change(
    bus: Bus, run: str, entry: Mapping[str, Any], system: SystemTime = SYSTEM_TIME
) -> list[VehicleAnswer]:
    """Request a change, an entry of `[[change]]` without `at_s`; raises BusError.

    The request goes to the vehicle that the entry names, or to all vehicles. Each promises the
    change for one instant and makes it when that is confirmed; if one refuses, none makes it. A
    vehicle without an answer to the first message gets no more, so that it delays the others once.
    """
    members = bus.members()
    vehicles, run_id = _concerned(members, run, entry), _run_id(members, run)
    started = system.monotonic()
    answers = partial(_answers, bus, run_id=run_id, started=started, system=system)
    result: dict[str, VehicleAnswer] = {}
    for margin_s in AHEAD_S:
        asked_ms = (system.monotonic() - started) / MILLISECOND
        offers = answers(vehicles, ChangeRequest())
        result.update(offers)
        vehicles = [each.vehicle for each in offers.values() if each.answer]
        first_s = max((each.answer.from_s for each in offers.values() if each.answer), default=0.0)
        slowest_ms = max((offers[each].took_ms for each in vehicles), default=asked_ms) - asked_ms
        waited_ms = (system.monotonic() - started) / MILLISECOND - asked_ms
        ahead_s = margin_s + (waited_ms + PASSES * slowest_ms) / 1000.0
        at_s = ceil((first_s + ahead_s) / GRID_S) * GRID_S
        promises = answers(vehicles, ChangeRequest(dict(entry), at_s))
        if not any(each.answer and each.answer.can_be_later for each in promises.values()):
            break
    result.update(promises)
    if any(each.answer and each.answer.refused for each in promises.values()):
        return [_without_promise(each) for each in result.values()]
    promised = [each.vehicle for each in promises.values() if each.answer]
    result.update(answers(promised, ChangeRequest({}, at_s, confirms=True)))
    return list(result.values())


def _without_promise(each: VehicleAnswer) -> VehicleAnswer:
    """Answer of a vehicle to a change that another vehicle refused: it makes none."""
    if each.answer is None or each.answer.refused:
        return each
    return replace(each, answer=Confirmation(each.vehicle))


def _run_id(members: Iterable[Member], run: str) -> str:
    """Identifier of a run, the name of its recorder; raises BusError without exactly one."""
    recorders = [member for member in members if member.role == RECORDER]
    if len(recorders) != 1:
        count = len(recorders) or "no"
        sessions = ", ".join(shown(member.session) for member in recorders)
        which = f"s: sessions {sessions}" if recorders else ""
        raise BusError(f"run {run}: has {count} recorder{which}")
    return recorders[0].name


def _concerned(members: Iterable[Member], run: str, entry: Mapping[str, Any]) -> list[str]:
    present = sorted({member.name for member in members if member.role == VEHICLE})
    if not present:
        raise BusError(f"run {run}: has no vehicle")
    named = entry.get("vehicle")
    if named is None:
        return present
    if named not in present:
        known = ", ".join(map(shown, present))
        raise BusError(f"run {run}: has no vehicle {printable(str(named))}, allowed {known}")
    return [named]


def _answers(
    bus: Bus,
    vehicles: Sequence[str],
    request: ChangeRequest,
    *,
    run_id: str,
    started: int,
    system: SystemTime,
) -> dict[str, VehicleAnswer]:
    """Send a request to vehicles at once and wait for their answers."""
    received: dict[str, VehicleAnswer] = {}
    complete = Event()

    def elapsed_ms() -> float:
        return (system.monotonic() - started) / MILLISECOND

    query = addressed(run_id, request.text)

    def receive(vehicle: str, answer: bytes) -> None:
        if not answer:  # from a vehicle of another run
            return
        confirmation = None
        with suppress(ValueError):
            confirmation = Confirmation.of(answer)
        received[vehicle] = VehicleAnswer(vehicle, confirmation, elapsed_ms())
        if len(received) == len(vehicles):
            complete.set()

    if not vehicles:
        return {}
    for vehicle in vehicles:
        handler = partial(receive, vehicle)
        bus.request(control_key(vehicle), handler, ANSWER_TIMEOUT_S, query)
    system.wait(complete, ANSWER_TIMEOUT_S)
    absent_ms = elapsed_ms()
    return {
        vehicle: received.get(vehicle) or VehicleAnswer(vehicle, None, absent_ms)
        for vehicle in vehicles
    }


def status(bus: Bus, run: str) -> RunStatus | None:
    """Request the status of the run; None before its start. Raises BusError without an answer."""
    answer = bus.query(control_key(RUN_SENDER), ANSWER_TIMEOUT_S)
    if answer is None:
        raise BusError(f"run {run}: has no recorder")
    try:
        return RunStatus.of(answer) if answer else None
    except ValueError as error:
        raise BusError(f"run {run}: {error}, from its recorder") from error


# ---- The status of a run as tables that refresh in a terminal, or as JSON


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
