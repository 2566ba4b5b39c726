"""Time of the parts of a vehicle's tick: `python -m tests.bench.bench_tick [--against COMMIT]`.

Steps the four vehicles of `lane_change` in one process at full speed. Prints the processor time of
each part of a tick in microseconds: with warm caches, and with cold ones, as in a process that
shares its cores. Values are means over ticks with a decision, without the slowest 2 %, which are
disturbed by other programs. The yardstick is a plain Python loop.
`--against` measures another commit in turn.
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
from tests.bench.bench_virtual import HERE, LineServer, checked_out, code

PARTS = {
    "receive": "messages delivered by the links",
    "measure": "fix and inertial sensor",
    "decide": "estimate, trajectory, steering, speed",
    "send": "pose, reports, their bytes",
    "move": "the car to the next tick",
    "rest": "scheduled changes, and the schedule",
    "all": "",
}
EVICTED_MB = 64
"""More than the size of the caches."""


def serve() -> None:
    """Time the ticks of a run for each line of standard input, with warm or cold caches.

    Runs in a new process from its source text, also with commits without this file.
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
    from scenarios.runs.virtual import VirtualConvoy  # noqa: PLC0415
    from transport.links.inbox import Inbox  # noqa: PLC0415
    from vehicles.driver.follower import Follower  # noqa: PLC0415
    from vehicles.driver.leader import Leader  # noqa: PLC0415

    tick = dict.fromkeys(("receive", "measure", "decide", "send", "move"), 0)

    def time_calls(kind: Any, name: str, part: str) -> None:
        inner = getattr(kind, name)

        def timed_call(*args: Any, **keys: Any) -> Any:
            started = thread_time_ns()
            measured = inner(*args, **keys)
            tick[part] += thread_time_ns() - started
            return measured

        setattr(kind, name, timed_call)

    time_calls(Inbox, "take", "receive")
    time_calls(phases.Car, "measure", "measure")
    time_calls(Follower, "step", "decide")
    time_calls(Leader, "step", "decide")
    time_calls(Outbox, "publish", "send")
    time_calls(phases.Car, "advance", "move")

    for line in sys.stdin:
        seconds, evicted_mb = json.loads(line)
        scenario = load_scenario("lane_change", [f"duration_s={seconds}"])
        evicted = np.zeros(evicted_mb * 2**17)
        ticks: list[list[int]] = []
        convoy = VirtualConvoy(scenario)

        def sink(vehicle: str, convoy: VirtualConvoy = convoy) -> Any:
            if hasattr(sinks, "BatchingSink"):
                return sinks.BatchingSink(vehicle, convoy.bus, convoy.clock.now)
            return sinks.BusSink(vehicle, convoy.bus)

        step = Node.step

        def timed_step(
            node: Any, at: Any, step: Any = step, evicted: Any = evicted, ticks: Any = ticks
        ) -> None:
            evicted += 1.0
            for part in tick:
                tick[part] = 0
            started = thread_time_ns()
            step(node, at)
            total = thread_time_ns() - started
            if tick["decide"]:
                ticks.append([*tick.values(), total - sum(tick.values()), total])

        kind: Any = Node
        kind.step = timed_step
        convoy.build(sink)
        takes = signature(convoy.run).parameters
        drive_all: Any = convoy.run
        drive_all(*[Stop() for name in takes if name == "stop"])  # of earlier commits
        kind.step = step
        ticks.sort(key=lambda row: row[-1])
        typical = ticks[: len(ticks) * 49 // 50]
        print(json.dumps([mean(column) / 1e3 for column in zip(*typical, strict=True)]), flush=True)


class Ticks(LineServer):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder, serve)

    def parts_us(self, seconds: float, evicted_mb: int) -> list[float]:
        """Time (µs) of each part of a tick, in the order of PARTS."""
        return [float(value) for value in self.request(seconds, evicted_mb)]


def columns(
    trees: dict[str, Ticks], seconds: float, rounds: int
) -> Iterator[tuple[str, list[float]]]:
    kinds = {"warm": (seconds, 0), "cold": (seconds / 5, EVICTED_MB)}
    measured: dict[str, list[list[float]]] = {}
    for _ in range(rounds):
        for kind, (span, evicted_mb) in kinds.items():
            for name, tree in trees.items():
                measured.setdefault(f"{name}\n{kind}", []).append(tree.parts_us(span, evicted_mb))
    for heading, rows in measured.items():
        yield heading, [median(column) for column in zip(*rows, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of the parts of a vehicle's tick.")
    parser.add_argument("--against", metavar="COMMIT", help="measure this commit as well")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long a run drives")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    if code(HERE) == "compiled":
        raise SystemExit("parts cannot be timed in compiled code; use interpreted code")
    loop_s = median(timed(plain_loop).processor_s for _ in range(given.rounds))
    with ExitStack() as stack:
        folders = {"here": HERE}
        if given.against:
            folders[given.against] = stack.enter_context(checked_out(given.against))
        trees = {name: stack.enter_context(Ticks(folder)) for name, folder in folders.items()}
        measured = dict(columns(trees, given.seconds, given.rounds))
    table = Table(title="a vehicle's tick, µs", box=SIMPLE_HEAD, title_justify="left")
    table.add_column("")
    for heading in measured:
        table.add_column(heading, justify="right")
    table.add_column("")
    for place, (part, meaning) in enumerate(PARTS.items()):
        table.add_row(part, *(f"{figures[place]:.1f}" for figures in measured.values()), meaning)
    Console(width=100).print(table)
    print(f"yardstick: {LOOP // 1_000_000} million additions in {loop_s:.2f} s of the processor")


if __name__ == "__main__":
    main()
