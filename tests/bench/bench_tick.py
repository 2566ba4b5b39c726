"""Where a vehicle's tick goes: `python -m tests.bench.bench_tick [--against COMMIT]`.

Steps the four vehicles of `lane_change` in one process, as fast as it goes, and prints what each
part of a tick takes: warm, and after everything else has been driven out of the processor's caches,
which is how a process finds them that shares its cores with many others. Microseconds of the
processor, means over the ticks at which a vehicle decides but for the slowest fiftieth, which
something else held up; the yardstick is a plain Python loop.
With `--against` that commit is measured beside it, by turns.
"""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from statistics import median

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from tests.bench.bench_run import LOOP, plain_loop, timed
from tests.bench.bench_virtual import HERE, Served, checked_out, code

PARTS = {
    "receive": "what came over the links by now",
    "measure": "fix and inertial sensor",
    "decide": "estimate, trajectory, steering, speed",
    "send": "pose, reports, their bytes",
    "move": "the car to the next tick",
    "rest": "what is done to the vehicle, and the schedule",
    "all": "",
}
EVICTED_MB = 64
"""More than the caches hold."""


def serve() -> None:  # noqa: PLR0915 (whole, because its source text is run elsewhere)
    """Time the ticks of one run, warm or cold as the lines of standard input ask.

    Runs in a process of its own by its source text, also of commits that do not have this file.
    """
    import json  # noqa: PLC0415
    import sys  # noqa: PLC0415
    from inspect import signature  # noqa: PLC0415
    from statistics import mean  # noqa: PLC0415
    from time import thread_time_ns  # noqa: PLC0415
    from typing import Any  # noqa: PLC0415

    import numpy as np  # noqa: PLC0415

    from scenarios.definition.scenario import load_scenario  # noqa: PLC0415
    from scenarios.runs.node import phases  # noqa: PLC0415
    from scenarios.runs.node import sink as sinks  # noqa: PLC0415
    from scenarios.runs.node.node import Node  # noqa: PLC0415
    from scenarios.runs.node.outbox import Outbox  # noqa: PLC0415
    from scenarios.runs.stop import Stop  # noqa: PLC0415
    from transport.links.inbox import Inbox  # noqa: PLC0415
    from vehicles.driver.follower import Follower  # noqa: PLC0415
    from vehicles.driver.leader import Leader  # noqa: PLC0415

    try:
        from scenarios.runs.virtual.virtual_convoy import VirtualConvoy  # noqa: PLC0415
    except ImportError:  # where it stood in earlier commits
        from scenarios.runs.virtual import (  # type: ignore[attr-defined,no-redef] # noqa: PLC0415
            VirtualConvoy,
        )

    tick = dict.fromkeys(("receive", "measure", "decide", "send", "move"), 0)

    def count(kind: Any, name: str, part: str) -> None:
        inner = getattr(kind, name)

        def counted(*args: Any, **keys: Any) -> Any:
            began = thread_time_ns()
            found = inner(*args, **keys)
            tick[part] += thread_time_ns() - began
            return found

        setattr(kind, name, counted)

    count(Inbox, "take", "receive")
    count(phases.Car, "measure", "measure")
    count(Follower, "step", "decide")
    count(Leader, "step", "decide")
    count(Outbox, "publish", "send")
    count(phases.Car, "advance", "move")

    for line in sys.stdin:
        seconds, evicted_mb = json.loads(line)
        scenario = load_scenario("lane_change", [f"duration_s={seconds}"])
        everything = np.zeros(evicted_mb * 2**17)
        ticks: list[list[int]] = []
        convoy = VirtualConvoy(scenario)

        def sink(vehicle: str, convoy: VirtualConvoy = convoy) -> Any:
            if hasattr(sinks, "BatchingSink"):
                return sinks.BatchingSink(vehicle, convoy.bus, convoy.clock.now)
            return sinks.BusSink(vehicle, convoy.bus)

        step = Node.step

        def timed_step(
            node: Any, at: Any, step: Any = step, everything: Any = everything, ticks: Any = ticks
        ) -> None:
            everything += 1.0
            for part in tick:
                tick[part] = 0
            began = thread_time_ns()
            step(node, at)
            whole = thread_time_ns() - began
            if tick["decide"]:
                ticks.append([*tick.values(), whole - sum(tick.values()), whole])

        kind: Any = Node
        kind.step = timed_step
        convoy.build(sink)
        takes = signature(convoy.run).parameters
        drive_all: Any = convoy.run
        drive_all(*[Stop() for name in takes if name == "stop"])  # of earlier commits
        kind.step = step
        ticks.sort(key=lambda row: row[-1])
        usual = ticks[: len(ticks) * 49 // 50]
        print(json.dumps([mean(column) / 1e3 for column in zip(*usual, strict=True)]), flush=True)


class Ticks(Served):
    """A process that times the ticks of one checkout."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, serve)

    def parts_us(self, seconds: float, evicted_mb: int) -> list[float]:
        """What each part of a tick takes (µs), in the order of PARTS."""
        return [float(one) for one in self.ask(seconds, evicted_mb)]


def columns(
    trees: dict[str, Ticks], seconds: float, rounds: int
) -> Iterator[tuple[str, list[float]]]:
    """Heading and figures of each column: warm and cold of each tree, medians of the rounds."""
    kinds = {"warm": (seconds, 0), "cold": (seconds / 5, EVICTED_MB)}
    found: dict[str, list[list[float]]] = {}
    for _ in range(rounds):
        for kind, (span, evicted_mb) in kinds.items():
            for name, tree in trees.items():
                found.setdefault(f"{name}\n{kind}", []).append(tree.parts_us(span, evicted_mb))
    for heading, rows in found.items():
        yield heading, [median(column) for column in zip(*rows, strict=True)]


def main() -> None:
    """Measure and print the ledger."""
    parser = argparse.ArgumentParser(description="Where a vehicle's tick goes.")
    parser.add_argument("--against", metavar="COMMIT", help="measure this commit as well")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long a run drives")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    if code(HERE) == "compiled":
        raise SystemExit("the parts of compiled code cannot be told apart; take plain Python")
    loop_s = median(timed(plain_loop).processor_s for _ in range(given.rounds))
    with ExitStack() as stack:
        folders = {"here": HERE}
        if given.against:
            folders[given.against] = stack.enter_context(checked_out(given.against))
        trees = {name: stack.enter_context(Ticks(folder)) for name, folder in folders.items()}
        found = dict(columns(trees, given.seconds, given.rounds))
    table = Table(title="a vehicle's tick, µs", box=SIMPLE_HEAD, title_justify="left")
    table.add_column("")
    for heading in found:
        table.add_column(heading, justify="right")
    table.add_column("")
    for place, (part, meaning) in enumerate(PARTS.items()):
        table.add_row(part, *(f"{figures[place]:.1f}" for figures in found.values()), meaning)
    Console(width=100).print(table)
    print(f"yardstick: {LOOP // 1_000_000} million additions in {loop_s:.2f} s of the processor")


if __name__ == "__main__":
    main()
