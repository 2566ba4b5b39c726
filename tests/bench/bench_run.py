"""Cost and punctuality of a run: `python -m tests.bench.bench_run [--seconds 35]`.

Prints figures with their limits:
- memory and processor time of each vehicle process at 50 Hz and 20 Hz
- start-up time and memory of ten vehicles, and their late ticks
- duration of `lane_change` in virtual time, also as a multiple of a plain Python loop
- number of true poses equal on both clocks

The load by other programs is printed, too: on a busy machine only equality, memory and multiple are
meaningful.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import psutil
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.system.logs import Run, agreement
from tests.system.processes import Process, run_to_the_end, start

MEMORY_MB, CPU_RATIO, LATE_RATIO, VIRTUAL_S = 80.0, 0.06, 0.01, 1.5
READY_S = ((10, 1.5), (40, 2.5))
"""Limits of the start-up time of forked vehicles, by their largest number."""
OWN_MB = 15.0
"""Limit of the proportional memory (PSS) of a vehicle."""
SETTLED_S = 1.0
"""Time after the start until one-time work is over."""
ROUNDS = 5
LOOP = 10_000_000


@dataclass(frozen=True)
class Row:
    label: str
    measured: str
    limit: str = ""
    good: bool | None = None


@dataclass(frozen=True)
class Usage:
    """Use of the processes of a run, by name: shares of one core, and bytes.

    `memory` is resident (RSS), `own` memory is proportional (PSS).
    """

    cpu: dict[str, float]
    memory: dict[str, int]
    own: dict[str, int]
    others_cpu: float


def watch(convoy: Process, seconds: float) -> Usage:
    parts = convoy.parts()
    before = {name: used_s(part) for name, part in parts.items()}
    busy_before, started = busy_s(), time.monotonic()
    time.sleep(seconds)
    busy, span = busy_s() - busy_before, time.monotonic() - started
    cpu = {name: (used_s(part) - before[name]) / span for name, part in parts.items()}
    memory = {name: part.memory_info().rss for name, part in parts.items()}
    own = {name: part.memory_full_info().pss for name, part in parts.items()}
    return Usage(cpu, memory, own, max(busy / span - sum(cpu.values()), 0.0))


def used_s(process: psutil.Process) -> float:
    """Processor time (s) of a process so far."""
    times = process.cpu_times()
    return times.user + times.system


def busy_s() -> float:
    """Processor time (s) of this machine so far."""
    times = psutil.cpu_times()
    return sum(times) - times.idle - getattr(times, "iowait", 0.0)


def drive(folder: Path, name: str, vehicles: int, seconds: float) -> tuple[Run, Usage]:
    settings = (f"--set=convoy.vehicles={vehicles}", f"--set=duration_s={seconds}")
    with start("run", "lane_change", *settings, "--out", name, folder=folder) as convoy:
        convoy.await_start()
        time.sleep(SETTLED_S)
        usage = watch(convoy, seconds - 2.0 * SETTLED_S)
        if convoy.wait() != 0:
            raise SystemExit(convoy.err)
    return Run(folder / name), usage


def readiness(folder: Path, vehicles: int) -> Iterator[Row]:
    settings = (f"--set=convoy.vehicles={vehicles}", "--set=duration_s=5")
    started = time.monotonic()
    with start("run", "lane_change", *settings, "--out", "ready", folder=folder) as convoy:
        convoy.await_start()
        took = time.monotonic() - started
        time.sleep(SETTLED_S)
        own = [
            part.memory_full_info().pss
            for name, part in convoy.parts().items()
            if name.startswith("v")
        ]
        convoy.popen.terminate()
        convoy.wait()
    within = (limit for largest, limit in READY_S if vehicles <= largest)
    limit = next(within, None)
    yield Row(
        "command to all present, s",
        f"{took:.1f}",
        "" if limit is None else f"{limit}",
        None if limit is None else took < limit,
    )
    largest = max(own) * 1e-6
    yield Row(
        "proportional memory, MB",
        f"{largest:.1f} at most",
        f"{OWN_MB}",
        largest < OWN_MB,
    )


def costs(run: Run, usage: Usage) -> Iterator[Row]:
    vehicles = [name for name in usage.cpu if name in run.truths]
    largest = max(run.vehicle(name)["memory_bytes_max"] for name in vehicles) * 1e-6
    yield Row(
        "memory of a vehicle, MB",
        f"{largest:.0f} at most",
        f"{MEMORY_MB:.0f}",
        largest < MEMORY_MB,
    )
    for name in vehicles:
        share = usage.cpu[name]
        yield Row(
            f"processor, {name}, % of a core",
            f"{share * 100:.1f}",
            f"{CPU_RATIO * 100:.0f}",
            share < CPU_RATIO,
        )
    for name in ("recorder", "router"):
        memory = usage.memory[name] * 1e-6
        yield Row(f"{name}: % of a core, MB", f"{usage.cpu[name] * 100:.1f}, {memory:.0f}")


def equality(run: Run, virtual: Run) -> Iterator[Row]:
    agreed = agreement(run, virtual)
    late = run.late_messages_at
    yield Row("late ticks, late messages", f"{run.late_ticks}, {len(late)}")
    explained = agreed.differ_at is None or (bool(late) and late[0] < agreed.differ_at)
    yield Row(
        "true poses equal to the bit",
        f"{agreed.equal} of {agreed.compared}",
        "all, or until a late message",
        explained,
    )
    yield Row(
        "distance of true paths, cm",
        f"{agreed.distance_m_max * 100:.4f}",
        "2",
        agreed.distance_m_max <= 0.02,
    )


def punctuality(run: Run, usage: Usage) -> Iterator[Row]:
    ticks = sum(run.vehicle(name)["ticks"] for name in run.truths)
    share = run.late_ticks / ticks
    count = len(run.truths)
    yield Row(
        f"late ticks of {count} vehicles, %",
        f"{share * 100:.2f} ({run.late_ticks} of {ticks})",
        f"{LATE_RATIO * 100:.0f}",
        share < LATE_RATIO,
    )
    worst = max(run.vehicle(name)["lateness_ms_max"] for name in run.truths)
    yield Row("latest tick, ms; late messages", f"{worst:.1f}; {len(run.late_messages_at)}")
    mean = sum(usage.cpu[name] for name in run.truths) / count
    yield Row(f"processor, each of {count}, % of a core", f"{mean * 100:.1f} on average")


def virtual_time(folder: Path) -> Iterator[Row]:
    scenario = load_scenario("lane_change")
    loops = [timed(plain_loop) for _ in range(ROUNDS)]
    runs = [
        timed(partial(run_virtual, scenario, folder / f"virtual{k}", Stop())) for k in range(ROUNDS)
    ]
    best, loop = min(run.wall_s for run in runs), min(loop.wall_s for loop in loops)
    yield Row(
        "lane_change in virtual time, s",
        f"{best:.2f} best of {ROUNDS}, {max(run.wall_s for run in runs):.2f} worst",
        f"{VIRTUAL_S}",
        best < VIRTUAL_S,
    )
    yield Row("  of the processor, s", f"{min(run.processor_s for run in runs):.2f}")
    yield Row(
        f"  in loops of {LOOP // 1_000_000} million additions",
        f"{best / loop:.1f} (a loop takes {loop:.2f} s)",
    )


@dataclass(frozen=True)
class Time:
    wall_s: float
    processor_s: float


def timed(work: Callable[[], object]) -> Time:
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return Time(time.perf_counter() - wall, time.process_time() - processor)


def plain_loop() -> float:
    total = 0.0
    for k in range(LOOP):
        total += k * 0.5
    return total


def print_rows(title: str, rows: list[Row]) -> None:
    table = Table(title=title, box=SIMPLE_HEAD, title_justify="left")
    for heading in ("", "measured", "limit", ""):
        table.add_column(heading)
    for row in rows:
        verdict = "" if row.good is None else "ok" if row.good else "OVER"
        table.add_row(row.label, row.measured, row.limit, verdict)
    Console(width=100).print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description="Cost and punctuality of a run.")
    parser.add_argument("--seconds", type=float, default=35.0, help="how long the runs drive")
    parser.add_argument("--vehicles", type=int, default=10, help="in the larger run")
    given = parser.parse_args()
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    print(f"{os.cpu_count()} cores; load over 1, 5, 15 minutes before: {load}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print_rows("virtual time", list(virtual_time(folder)))
        rows = list(readiness(folder, given.vehicles))
        print_rows(f"start of {given.vehicles} vehicles", rows)
        run, usage = drive(folder, "four", 4, given.seconds)
        run_to_the_end(
            *("run", "lane_change", f"--set=duration_s={given.seconds}", "--clock=virtual"),
            *("--quiet", "--out", "virtual"),
            folder=folder,
        )
        rows = [*costs(run, usage), *equality(run, Run(folder / "virtual"))]
        print_rows(f"four vehicles, others used {usage.others_cpu * 100:.0f} % of a core", rows)
        run, usage = drive(folder, "many", given.vehicles, given.seconds)
        title = f"{given.vehicles} vehicles, others used {usage.others_cpu * 100:.0f} % of a core"
        print_rows(title, list(punctuality(run, usage)))


if __name__ == "__main__":
    main()
