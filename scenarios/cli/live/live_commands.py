"""Commands for a convoy that drives: link, cut, heal, gnss, stall, kill, speed, status."""

import sys
from pathlib import Path
from typing import Any

import click

from scenarios.cli.common_options import (
    new_file_option,
    open_run_options,
    print_or_write,
    span_option,
)
from scenarios.cli.error_lines import clear_errors
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED

REFRESH_S = 0.5


def _change(run_name: str | None, flags: dict[str, Any], kind: str, **keys: object) -> None:
    """Request a change and print the answers."""
    from scenarios.cli.live import change_requests

    entry = {"kind": kind, **{key: value for key, value in keys.items() if value is not None}}
    with clear_errors():
        with change_requests.joined(run_name, flags) as (bus, run):
            answers = change_requests.request_change(bus, run, entry)
        refused = dict.fromkeys(
            line for one in answers if one.answer for line in one.answer.refused
        )
        silent = [one.vehicle for one in answers if one.answer is None]
        for one in answers:
            if one.answer and one.answer.does:
                text = (
                    f"{one.vehicle}: {one.answer.does}, {one.answer.from_s:.2f} s after the start"
                )
                click.echo(f"{text} (confirmed in {one.took_ms:.1f} ms)")
        for line in refused:
            click.echo(line, err=True)
        for vehicle in silent:
            click.echo(
                f"{vehicle}: no answer within {change_requests.ANSWER_TIMEOUT_S:g} s", err=True
            )
        if not any(one.answer and (one.answer.does or one.answer.refused) for one in answers):
            click.echo("nothing changed: no vehicle carries this out", err=True)
            sys.exit(EXIT_FAILED)
    if refused:
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
@click.option("--loss", "loss_ratio", type=float, metavar="RATIO", help="Share lost, 0 to 1.")
@click.option("--latency-ms", type=float, help="Least delay.")
@click.option("--jitter-ms", type=float, help="Further delay, uniform between 0 and this.")
@span_option(help_text="For how long, such as 5s; without it until the next change.")
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
    """Change the links from SENDER to RECEIVER of a convoy that drives.

    Each end is a vehicle's name, a role (lead, predecessor, follower), or "*" for any. What is not
    given stays as it is.
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
"""
)
@click.argument("sender", default="*")
@click.argument("receiver", default="*")
@span_option(help_text="For how long, such as 5s; without it until healed.")
@open_run_options
def cut(
    *, sender: str, receiver: str, for_s: float | None, run_name: str | None, **flags: Any
) -> None:
    """Cut the links from SENDER to RECEIVER of a convoy that drives, by default all.

    Each end is a vehicle's name, a role (lead, predecessor, follower), or "*" for any.
    """
    _change(run_name, flags, "cut", sender=sender, receiver=receiver, for_s=for_s)


@click.command(
    epilog="""\b
Examples:
  convoy heal
  convoy heal v1 v3
"""
)
@click.argument("sender", default="*")
@click.argument("receiver", default="*")
@open_run_options
def heal(*, sender: str, receiver: str, run_name: str | None, **flags: Any) -> None:
    """Give the links from SENDER to RECEIVER back as the scenario has them, by default all.

    Each end is a vehicle's name, a role (lead, predecessor, follower), or "*" for any.
    """
    _change(run_name, flags, "heal", sender=sender, receiver=receiver)


@click.command(epilog="Example: convoy gnss v2 --fix float --for 10s")
@click.argument("vehicle")
@click.option(
    "--fix",
    type=click.Choice(["fixed", "float", "single", "none", "auto"]),
    required=True,
    help="Which fix; auto gives the receiver back to its own law.",
)
@span_option(help_text="For how long, such as 5s; without it until the next change.")
@open_run_options
def gnss(
    *, vehicle: str, fix: str, for_s: float | None, run_name: str | None, **flags: Any
) -> None:
    """Change the fix of the receiver of VEHICLE."""
    _change(run_name, flags, "gnss", vehicle=vehicle, fix=fix, for_s=for_s)


@click.command(epilog="Example: convoy stall v3 --for 500ms")
@click.argument("vehicle")
@span_option(required=True, help_text="For how long, such as 500ms.")
@open_run_options
def stall(*, vehicle: str, for_s: float, run_name: str | None, **flags: Any) -> None:
    """Hold up the control of VEHICLE: it hears, decides and sends nothing."""
    _change(run_name, flags, "stall", vehicle=vehicle, for_s=for_s)


@click.command(
    epilog="""\b
Examples:
  convoy kill v3
  convoy kill v3 --for 3s
"""
)
@click.argument("vehicle")
@span_option(help_text="Start anew after so long, such as 3s; without it never.")
@open_run_options
def kill(*, vehicle: str, for_s: float | None, run_name: str | None, **flags: Any) -> None:
    """Let the process of VEHICLE crash; the car brakes to a standstill with its wheels as they are.

    With --for it starts anew, without memory.
    """
    _change(run_name, flags, "crash", vehicle=vehicle, for_s=for_s)


@click.command(epilog="Example: convoy speed 15")
@click.argument("speed_mps", type=float, metavar="M_PER_S")
@click.option("--acceleration-mps2", type=float, help="How hard the lead gets there.")
@open_run_options
def speed(
    *, speed_mps: float, acceleration_mps2: float | None, run_name: str | None, **flags: Any
) -> None:
    """Let the lead drive at another set speed."""
    _change(run_name, flags, "speed", speed_mps=speed_mps, acceleration_mps2=acceleration_mps2)


@click.command(
    epilog="""\b
Examples:
  convoy status
  convoy status --once --json
"""
)
@click.option("--once", is_flag=True, help="One picture, and end.")
@click.option("--json", "as_json", is_flag=True, help="As JSON, a line for each picture.")
@open_run_options
def status(*, once: bool, as_json: bool, run_name: str | None, **flags: Any) -> None:
    """Show how a convoy that drives goes: what it steers along, knows, hears, errs and keeps."""
    from rich.console import Console

    from scenarios.cli.live import change_requests
    from scenarios.cli.live.status_tables import show
    from scenarios.runs.stop import stop_on_signals

    with clear_errors(), change_requests.joined(run_name, flags) as (bus, run):
        stop = stop_on_signals()
        stop.begun = True
        found = show(
            lambda: change_requests.status(bus, run),
            Console(),
            stop,
            every_s=None if once else REFRESH_S,
            as_json=as_json,
        )
        if not found:
            click.echo(f"run {run}: has not started yet", err=True)
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
@new_file_option
def scenario_from(log: Path, *, out: Path | None) -> None:
    """Make a scenario of a recorded LOG that repeats it, with all that was changed by hand."""
    from scenarios.results.log_queries.session import session_of
    from scenarios.results.log_summary import log_in

    with clear_errors():
        print_or_write(session_of(log_in(log)).text, out)
