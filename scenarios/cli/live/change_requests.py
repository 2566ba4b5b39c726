"""The requested run, and the answers of its vehicles to a change."""

import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from scenarios.cli.common_options import zenoh_from
from scenarios.definition.changing.live_change import ChangeRequest
from scenarios.runs.control.live_control import Confirmation
from scenarios.runs.control.open_runs import OpenRun, open_runs
from scenarios.runs.control.run_status import RunStatus
from scenarios.runs.processes.membership import VEHICLE, checked_run_name, shown
from transport.bus.bus import Bus, BusError
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.texts import printable
from transport.topics import RUN_SENDER, control_key

ANSWER_TIMEOUT_S = 1.0
"""Timeout of an answer, which usually takes some milliseconds."""
PARALLEL_REQUESTS_MAX = 32
"""Vehicles that receive a request at the same time."""


@dataclass(frozen=True, slots=True)
class VehicleAnswer:
    """The answer of one vehicle and its delay; None if none came in time."""

    vehicle: str
    answer: Confirmation | None
    took_ms: float


def run_to_join(
    run_name: str | None, flags: dict[str, Any], runs: Sequence[OpenRun]
) -> ZenohOptions:
    """Return how to join the requested one of the open runs; raises BusError.

    Zenoh's flags locate the router; without them the run does.
    """
    if run_name is not None:
        checked_run_name(run_name)
    elsewhere = any(flags[key] for key in ("connect", "listen", "config", "cfg", "mode"))
    found = [one for one in runs if run_name in {None, one.run}]
    if run_name is not None and (elsewhere or not found):
        return zenoh_from(flags, run_name)
    if elsewhere:
        raise BusError("--run: missing, it is required with -m, -e, -l, -c or --cfg")
    if not found:
        raise BusError("no run started by `convoy run` here; give --run, and -e for its router")
    if len(found) > 1:
        names = ", ".join(one.run for one in found)
        raise BusError(f"{len(found)} runs on this machine; give one by --run: {names}")
    return replace(zenoh_from(flags, found[0].run), connect=(found[0].endpoint,))


@contextmanager
def joined(run_name: str | None, flags: dict[str, Any]) -> Iterator[tuple[Bus, str]]:
    """Join the requested run; yields the bus and the run's name."""
    options = replace(run_to_join(run_name, flags, open_runs()), connect_timeout_s=2.0)
    with open_bus(options) as bus:
        yield bus, options.run


def request_change(bus: Bus, run: str, entry: Mapping[str, Any]) -> list[VehicleAnswer]:
    """Request a change, given as an entry of `[[change]]` without `at_s`; raises BusError.

    The request goes to the vehicle that it names, or to all.
    """
    present = sorted({one.name for one in bus.members() if one.role == VEHICLE})
    if not present:
        raise BusError(f"run {run}: has no vehicle")
    wanted = entry.get("vehicle")
    if wanted is not None and wanted not in present:
        known = ", ".join(map(shown, present))
        raise BusError(f"run {run}: has no vehicle {printable(str(wanted))}, allowed {known}")
    vehicles = present if wanted is None else [wanted]
    begun = time.monotonic()
    # All change at the earliest instant that the first of them offers.
    first = (
        _request_of_vehicle(bus, vehicles[0], ChangeRequest(), begun).answer
        if len(vehicles) > 1
        else None
    )
    at_s = first.from_s if first and not first.refused else None
    question = ChangeRequest(dict(entry), at_s)
    with ThreadPoolExecutor(min(len(vehicles), PARALLEL_REQUESTS_MAX)) as pool:
        return list(
            pool.map(lambda name: _request_of_vehicle(bus, name, question, begun), vehicles)
        )


def _request_of_vehicle(
    bus: Bus, vehicle: str, question: ChangeRequest, begun: float
) -> VehicleAnswer:
    answer = bus.query(control_key(vehicle), ANSWER_TIMEOUT_S, question.text)
    took_ms = 1000.0 * (time.monotonic() - begun)
    try:
        confirmation = None if answer is None else Confirmation.of(answer)
    except ValueError:
        confirmation = None
    return VehicleAnswer(vehicle, confirmation, took_ms)


def status(bus: Bus, run: str) -> RunStatus | None:
    """Request the status of the run, None before its start; raises BusError without an answer."""
    answer = bus.query(control_key(RUN_SENDER), ANSWER_TIMEOUT_S)
    if answer is None:
        raise BusError(f"run {run}: has no recorder")
    try:
        return RunStatus.of(answer) if answer else None
    except ValueError as error:
        raise BusError(f"run {run}: {error}, from its recorder") from error
