"""Commands for a running convoy: link, cut, gnss, stall, crash, speed, status."""

import sys
from pathlib import Path
from typing import Any

import click

from scenarios.cli.common_options import (
    FiniteRange,
    Ratio,
    json_option,
    open_run_options,
    output_option,
    partial_option,
    print_or_write,
    time_option,
)
from scenarios.cli.output import clear_errors, print_error, warn_of_log
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED

REFRESH_S = 0.5


def _change(run_name: str | None, flags: dict[str, Any], kind: str, **keys: object) -> None:
    from scenarios.cli import change_requests

    entry = {"kind": kind, **{key: value for key, value in keys.items() if value is not None}}
    with clear_errors():
        with change_requests.joined(run_name, flags) as (bus, run):
            if run_name is None:
                click.echo(f"run {run} in {change_requests.folder_of(run)}")
            replies = change_requests.request_change(bus, run, entry)
        answers = [reply.answer for reply in replies if reply.answer]
        refusals = dict.fromkeys(line for answer in answers for line in answer.refused)
        silent = [reply.vehicle for reply in replies if reply.answer is None]
        for reply in replies:
            if reply.answer and reply.answer.does:
                effect = f"{reply.answer.does}, {reply.answer.from_s:.2f} s after the start"
                click.echo(f"{reply.vehicle}: {effect} (confirmed in {reply.took_ms:.1f} ms)")
        for line in refusals:
            print_error(line)
        for vehicle in silent:
            print_error(f"{vehicle}: no answer within {change_requests.ANSWER_TIMEOUT_S:g} s")
        if not any(answer.does or answer.refused for answer in answers):
            print_error("nothing changed: the request concerns no vehicle of the run")
            sys.exit(EXIT_FAILED)
    if refusals:
        sys.exit(EXIT_BAD_INPUT)
    if silent:
        sys.exit(EXIT_FAILED)


@click.command(
    epilog="""\b
Examples:
  convoy link v1 v3 --loss 0.3
  convoy link lead follower --latency-ms 200 --jitter-ms 50 --for 5s
"""
)
@click.argument("sender")
@click.argument("receiver")
@click.option(
    "--loss", "loss_ratio", type=Ratio(), metavar="RATIO", help="Loss ratio of the links, 0 to 1."
)
@click.option("--latency-ms", type=FiniteRange(min=0.0), metavar="MS", help="Minimum delay.")
@click.option(
    "--jitter-ms",
    type=FiniteRange(min=0.0),
    metavar="MS",
    help="Additional random delay, uniform from 0 to MS.",
)
@time_option(
    "--for",
    help_text="Duration of the change. Default: until `convoy cut --heal`. A later change of the"
    " same value replaces it.",
)
@open_run_options
def link(
    *,
    sender: str,
    receiver: str,
    loss_ratio: float | None,
    latency_ms: float | None,
    jitter_ms: float | None,
    for_s: float | None,
    run_name: str | None,
    **flags: Any,
) -> None:
    """Change links between vehicles.

    Changes the links from SENDER to RECEIVER of a running convoy. Each end is a vehicle name, a
    role (lead, predecessor, follower), or "*" for any vehicle. Options that are not given keep
    their values.
    """
    _change(
        run_name, flags, "link", sender=sender, receiver=receiver, loss_ratio=loss_ratio,
        latency_ms=latency_ms, jitter_ms=jitter_ms, for_s=for_s,
    )  # fmt: skip


@click.command(
    epilog="""\b
Examples:
  convoy cut --for 2s
  convoy cut v1 v3
  convoy cut v1 v3 --heal
"""
)
@click.argument("sender", default="*")
@click.argument("receiver", default="*")
@time_option("--for", help_text="Duration of the cut. Default: until `convoy cut --heal`.")
@click.option("--heal", is_flag=True, help="Restore the links to the values in the scenario.")
@open_run_options
def cut(
    *,
    sender: str,
    receiver: str,
    for_s: float | None,
    heal: bool,
    run_name: str | None,
    **flags: Any,
) -> None:
    """Cut links between vehicles, or restore them.

    Cuts the links from SENDER to RECEIVER of a running convoy, by default all links. With --heal,
    also ends changes by `convoy link`. Each end is a vehicle name, a role (lead, predecessor,
    follower), or "*" for any vehicle.
    """
    if heal and for_s is not None:
        raise click.UsageError("--heal and --for: give one of them")
    kind = "heal" if heal else "cut"
    _change(run_name, flags, kind, sender=sender, receiver=receiver, for_s=for_s)


@click.command(epilog="Example: convoy gnss v2 --fix float --for 10s")
@click.argument("vehicle")
@click.option(
    "--fix",
    type=click.Choice(["fixed", "float", "single", "none", "auto"]),
    required=True,
    help="State of the fix. With auto, the receiver follows the scenario again.",
)
@time_option("--for", help_text="Duration of the change. Default: until the next `convoy gnss`.")
@open_run_options
def gnss(
    *, vehicle: str, fix: str, for_s: float | None, run_name: str | None, **flags: Any
) -> None:
    """Change the fix of a GNSS receiver.

    Changes the emulated receiver of VEHICLE in a running convoy.
    """
    _change(run_name, flags, "gnss", vehicle=vehicle, fix=fix, for_s=for_s)


@click.command(epilog="Example: convoy stall v3 --for 500ms")
@click.argument("vehicle")
@time_option("--for", required=True, help_text="Duration of the stall.")
@open_run_options
def stall(*, vehicle: str, for_s: float, run_name: str | None, **flags: Any) -> None:
    """Stall the control of a vehicle.

    While stalled, the software of VEHICLE decides and sends nothing, and arriving messages wait.
    The car keeps its last command.
    """
    _change(run_name, flags, "stall", vehicle=vehicle, for_s=for_s)


@click.command(
    epilog="""\b
Examples:
  convoy crash v3
  convoy crash v3 --for 3s
"""
)
@click.argument("vehicle")
@time_option("--for", help_text="Restart the process after TIME. Default: no restart.")
@open_run_options
def crash(*, vehicle: str, for_s: float | None, run_name: str | None, **flags: Any) -> None:
    """Crash the process of a vehicle.

    With --for, the process restarts without data from before the crash. Until then the car brakes
    with its last steering angle. Without --for, VEHICLE fails: the run ends or continues without
    it, as configured by convoy.on_vehicle_failure.
    """
    _change(run_name, flags, "crash", vehicle=vehicle, for_s=for_s)


@click.command(epilog="Example: convoy speed 15")
@click.argument("speed_mps", type=float, metavar="M_PER_S")
@click.option(
    "--acceleration-mps2",
    type=float,
    metavar="MPS2",
    help="Acceleration and braking towards that speed, in m/s². Default: 1.5.",
)
@open_run_options
def speed(
    *, speed_mps: float, acceleration_mps2: float | None, run_name: str | None, **flags: Any
) -> None:
    """Change the set speed of the lead.

    The lead of a running convoy accelerates or brakes to M_PER_S, in m/s. So do followers with
    speed.followers = "same".
    """
    _change(run_name, flags, "speed", speed_mps=speed_mps, acceleration_mps2=acceleration_mps2)


@click.command(
    epilog="""\b
Examples:
  convoy status
  convoy status --once --json
"""
)
@click.option("--once", is_flag=True, help="Print the status once and exit.")
@json_option("Print JSON, one line for each update.")
@open_run_options
def status(*, once: bool, as_json: bool, run_name: str | None, **flags: Any) -> None:
    """Show the status of a running convoy.

    Lists each vehicle's mode, speed, error, gap and known path, the age of its data, and the loss
    of each link. Refreshes twice a second until the run ends.
    """
    from rich.console import Console

    from scenarios.cli import change_requests
    from scenarios.cli.change_requests import show
    from scenarios.runs.stop import stop_on_signals

    with clear_errors(), change_requests.joined(run_name, flags) as (bus, run):
        stop = stop_on_signals()
        stop.begun = True
        started = show(
            lambda: change_requests.status(bus, run),
            Console(),
            stop,
            every_s=None if once else REFRESH_S,
            as_json=as_json,
        )
        if not started:
            print_error(f"run {run}: has not started yet")
            sys.exit(EXIT_FAILED)


@click.command(
    "scenario-from",
    epilog="""\b
Examples:
  convoy scenario-from runs/20260101-120000-lane_change
  convoy scenario-from run.mcap -o session.toml
  convoy run session.toml --clock virtual
""",
)
@click.argument("log", type=click.Path(path_type=Path))
@output_option("Write the scenario to this new file instead of standard output.")
@partial_option
def scenario_from(log: Path, *, output: Path | None, partial: bool) -> None:
    """Turn a recorded run into a scenario.

    LOG is a run.mcap or its folder. The scenario repeats the run, including all changes made by
    hand.
    """
    from scenarios.results.log_summary import log_in
    from scenarios.runs.replayed import session_of

    with clear_errors():
        faults: list[str] = []
        text = session_of(log_in(log), faults.append, partial=partial).text
        for line in faults:
            warn_of_log(line)
        print_or_write("".join([*(f"# {line}\n" for line in faults), text]), output)
