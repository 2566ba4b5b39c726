"""Cost and punctuality of real-time runs: `python -m tests.bench.bench_run [--vehicles 4 10 40]`.

Prints for each number of vehicles: start-up time, late ticks, poses that were not recorded, memory
and processor time of the processes, and how many true poses equal those of the virtual run. Use an
idle machine; the load by other programs is printed.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from tests.system.logs import Run, agreement
from tests.system.processes import Process, invoke, start

SETTLED_S = 1.0
"""Time after the start until one-time work is over."""
MEMORY_MB, LATE_RATIO, RECORDER_RATIO = 15.0, 0.01, 0.5
"""Limits: proportional memory (PSS) of a vehicle, late ticks, and share of a core."""
Row = tuple[str, str, str]
"""Figure, value, and limit with a verdict."""


@dataclass(frozen=True)
class Usage:
    """Use of the processes of a run, by name: shares of one core, and proportional memory (MB)."""

    cpu: dict[str, float]
    memory_mb: dict[str, float]
    others_cpu: float

    def of(self, name: str) -> str:
        return f"{100.0 * self.cpu[name]:.1f} % of a core, {self.memory_mb[name]:.0f} MB"


def watched(convoy: Process, seconds: float) -> Usage:
    parts = convoy.parts()
    before = {name: used_s(part) for name, part in parts.items()}
    busy_before, began = busy_s(), time.monotonic()
    time.sleep(seconds)
    busy, span = busy_s() - busy_before, time.monotonic() - began
    cpu = {name: (used_s(part) - before[name]) / span for name, part in parts.items()}
    memory = {name: part.memory_full_info().pss * 1e-6 for name, part in parts.items()}
    return Usage(cpu, memory, max(busy / span - sum(cpu.values()), 0.0))


def used_s(process: psutil.Process) -> float:
    """Processor time (s) of a process so far."""
    times = process.cpu_times()
    return times.user + times.system


def busy_s() -> float:
    """Processor time (s) of this machine so far."""
    times = psutil.cpu_times()
    return sum(times) - times.idle - getattr(times, "iowait", 0.0)


def judged(value: float, most: float) -> str:
    return f"{most:g} {'ok' if value <= most else 'MISSED'}"


def measured(folder: Path, vehicles: int, seconds: float, *flags: str) -> Iterator[Row]:
    """Drive a convoy on the wall clock, then the same in virtual time."""
    settings = (f"--set=convoy.vehicles={vehicles}", f"--set=duration_s={seconds}")
    began = time.monotonic()
    with start("run", "lane_change", *settings, *flags, "--out", "wall", folder=folder) as convoy:
        convoy.await_start()
        yield "command to all present, s", f"{time.monotonic() - began:.1f}", ""
        time.sleep(SETTLED_S)
        usage = watched(convoy, seconds - 2.0 * SETTLED_S)
        code = convoy.wait()
    run = Run(folder / "wall")
    rows = run.summary["vehicles"]
    ticks, late = (sum(row[name] for row in rows) for name in ("ticks", "late_ticks"))
    verdict = judged(100.0 * late / ticks, 100.0 * LATE_RATIO)
    yield "late ticks, %", f"{100.0 * late / ticks:.2f} ({late} of {ticks})", verdict
    yield "latest tick, ms", f"{max(row['lateness_ms_max'] for row in rows):.1f}", ""
    missing = sum(row["missing_poses"] for row in rows)
    refused = sum(run.summary["recorder_rejected_messages"].values())
    yield "poses not recorded, messages refused", f"{missing}, {refused}", judged(missing, 0)
    own = [name for name in usage.cpu if name in run.truths]
    mean = 100.0 * sum(usage.cpu[name] for name in own) / len(own)
    yield "a vehicle, % of a core, mean", f"{mean:.1f}", ""
    largest = max(usage.memory_mb[name] for name in own)
    yield "proportional memory of a vehicle, MB", f"{largest:.1f}", judged(largest, MEMORY_MB)
    yield "recorder", usage.of("recorder"), judged(usage.cpu["recorder"], RECORDER_RATIO)
    yield "router", usage.of("router"), ""
    yield "others, % of a core; exit code", f"{100.0 * usage.others_cpu:.0f}; {code}", ""
    virtual = ("--clock=virtual", "--quiet", "--out", "virtual")
    invoke("run", "lane_change", *settings, *virtual, folder=folder)
    same = agreement(run, Run(folder / "virtual"))
    late_at = run.late_messages_at
    is_explained = same.differ_at is None or bool(late_at and late_at[0] < same.differ_at)
    yield (
        "true poses equal to the bit",
        f"{same.equal} of {same.compared}, {len(late_at)} late messages",
        "all, or until a late message " + ("ok" if is_explained else "MISSED"),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Cost and punctuality of real-time runs.")
    parser.add_argument("--seconds", type=float, default=35.0, help="how long the runs drive")
    parser.add_argument("--vehicles", type=int, nargs="*", default=[4, 10, 40])
    parser.add_argument("--serve", action="store_true", help="with a picture")
    given = parser.parse_args()
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    print(f"{os.cpu_count()} cores; load before: {load}")
    for vehicles in given.vehicles:
        table = Table("", "measured", "limit", title=f"{vehicles} vehicles", box=SIMPLE_HEAD)
        with tempfile.TemporaryDirectory() as folder:
            flags = ["--serve"] * given.serve
            for row in measured(Path(folder), vehicles, given.seconds, *flags):
                table.add_row(*row)
        Console(width=100).print(table)


if __name__ == "__main__":
    main()
