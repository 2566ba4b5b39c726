"""Number of vehicles for two cores: `python -m tests.bench.bench_scale [--against COMMIT]`.

Runs `lane_change` on the wall clock with 10, 20 and 40 vehicles. Prints start-up time, proportional
memory (PSS) of a vehicle, late ticks, losses, and processor shares of all processes.
`--against` runs 10 and 20 vehicles of another commit, too: compare the number of vehicles at the
same share of late ticks. Use an idle machine; the load by other programs is printed.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.bench.bench_run import (
    OWN_MB,
    SETTLED_S,
    Row,
    Usage,
    plain_loop,
    print_rows,
    readiness,
    timed,
    watch,
)
from tests.bench.bench_virtual import HERE, checked_out, code
from tests.system.logs import Run
from tests.system.processes import start

LATE_RATIO = {10: None, 20: 0.001, 40: 0.01}
"""Limits of the share of late ticks."""
OTHERS = (10, 20)
"""Numbers of vehicles of the other commit."""


@contextmanager
def imported_from(folder: Path) -> Iterator[None]:
    before = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONPATH"]
        else:
            os.environ["PYTHONPATH"] = before


def drive(folder: Path, vehicles: int, seconds: float, *, serve: bool) -> tuple[Run, Usage, bool]:
    settings = (f"--set=convoy.vehicles={vehicles}", f"--set=duration_s={seconds}")
    out = f"run{time.monotonic_ns()}"
    with start(
        "run", "lane_change", *settings, *["--serve"] * serve, "--out", out, folder=folder
    ) as convoy:
        convoy.await_start()
        time.sleep(SETTLED_S)
        usage = watch(convoy, seconds - 2.0 * SETTLED_S)
        failed = convoy.wait() != 0
    return Run(folder / out), usage, failed


def rows(run: Run, usage: Usage, *, failed: bool, limit: float | None) -> Iterator[Row]:
    vehicles = run.summary["vehicles"]
    ticks = sum(row["ticks"] for row in vehicles)
    late = sum(row["late_ticks"] for row in vehicles)
    missing = sum(row["missing_poses"] for row in vehicles)
    refused = sum(run.summary["recorder_rejected_messages"].values())
    yield Row(
        "late ticks, %",
        f"{100 * late / max(ticks, 1):.2f} ({late} of {ticks})" + (", FAILED" if failed else ""),
        "" if limit is None else f"{100 * limit:g}",
        None if limit is None else late < limit * ticks and not failed,
    )
    worst = max(row["lateness_ms_max"] for row in vehicles)
    yield Row("latest tick, ms", f"{worst:.1f}")
    yield Row(
        "poses not recorded, messages refused, holes",
        f"{missing}, {refused}, {len(run.summary['holes'])}",
        "0, 0, 0",
        missing == refused == len(run.summary["holes"]) == 0,
    )
    names = [name for name in usage.cpu if name not in {"recorder", "router", "launcher", ""}]
    if names:
        mean = sum(usage.cpu[name] for name in names) / len(names)
        yield Row("processor, a vehicle, % of a core", f"{100 * mean:.2f}")
        own = max(usage.own[name] for name in names) / 1e6
        limit_mb = OWN_MB
        yield Row(
            "proportional memory at the end, MB",
            f"{own:.1f} at most",
            f"{limit_mb}",
            own < limit_mb,
        )
    for name in ("recorder", "router"):
        if name in usage.cpu:
            memory = usage.memory[name] / 1e6
            yield Row(f"{name}, % of a core, MB", f"{100 * usage.cpu[name]:.1f}, {memory:.0f}")
    yield Row("others, % of a core", f"{100 * usage.others_cpu:.0f}" if names else "")


def main() -> None:
    parser = argparse.ArgumentParser(description="Number of vehicles for two cores.")
    parser.add_argument("--against", metavar="COMMIT", help="drive this commit's convoys as well")
    parser.add_argument("--seconds", type=float, default=35.0, help="how long they drive")
    parser.add_argument("--vehicles", type=int, nargs="*", default=list(LATE_RATIO))
    parser.add_argument("--serve", action="store_true", help="with a picture")
    given = parser.parse_args()
    loop_s = min(timed(plain_loop).processor_s for _ in range(3))
    print(f"{os.cpu_count()} cores, {code(HERE)}; yardstick: plain loop {loop_s:.2f} s")
    with tempfile.TemporaryDirectory() as name:
        for vehicles in given.vehicles:
            folder = Path(name) / f"{vehicles}"
            folder.mkdir()
            ready = readiness(folder, vehicles)
            run, usage, failed = drive(folder, vehicles, given.seconds, serve=given.serve)
            table_rows = rows(run, usage, failed=failed, limit=LATE_RATIO.get(vehicles))
            print_rows(f"{vehicles} vehicles, {given.seconds:g} s", [*ready, *table_rows])
        if given.against:
            folder = Path(name)
            with checked_out(given.against) as other, imported_from(other):
                for vehicles in OTHERS:
                    run, usage, failed = drive(folder, vehicles, given.seconds, serve=False)
                    table_rows = rows(run, usage, failed=failed, limit=None)
                    print_rows(f"{given.against}: {vehicles} vehicles", list(table_rows))


if __name__ == "__main__":
    main()
