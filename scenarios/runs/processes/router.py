"""`convoy router`: the Zenoh router of a convoy as a process of its own."""

import time

import click

from scenarios.runs.stop import Stop
from transport.bus.bus import BusError
from transport.bus.zenoh_bus import DEFAULT_ENDPOINT, ZenohOptions, open_router
from transport.clock import poll

LISTENING = "listening on "
"""Begin of the first line of output; the endpoints follow."""
POLL_S = 0.05
EMPTY_S = 2.0
"""Time without clients after which `--until-empty` ends the router."""
AFTER_THE_LAUNCHER_S = 2.0
"""How long a router outlives its launcher, so that the recorder still gets the last messages."""


def route(options: ZenohOptions, stop: Stop, *, until_empty: bool) -> int:
    """Route until a stop is requested or, with `until_empty`, until all clients have left.

    Returns the exit code.
    """
    listen = options.listen or (DEFAULT_ENDPOINT,)
    if options.mode is not None:
        raise BusError(f"--mode {options.mode}: given for the router, whose mode is router")
    with open_router(
        listen, connect=options.connect, config=options.config, cfg=options.cfg
    ) as router:
        stop.begun = True
        click.echo(f"{LISTENING}{', '.join(router.endpoints)}")
        poll(lambda: stop.requested or (until_empty and router.has_clients()), every_s=POLL_S)
        while not stop.requested:
            poll(lambda: stop.requested or not router.has_clients(), every_s=POLL_S)
            someone_came_back = poll(
                lambda: stop.requested or router.has_clients(), every_s=POLL_S, at_most_s=EMPTY_S
            )
            if not someone_came_back:
                return 0
        if stop.orphaned:
            time.sleep(AFTER_THE_LAUNCHER_S)
    return stop.exit_code
