"""Memory of a recorder in a long run: `python -m tests.bench.bench_memory [--minutes 10]`.

Feeds log, figures, events and live table with messages of four vehicles at full speed, and prints
the resident memory after some minutes of the run. The growth per minute excludes the first minute,
and is printed with the bytes received per minute. Use `--vehicles` and `--minutes 60` for more.
"""

import argparse
import gc
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from scenarios.cli.running.progress import Progress
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.metrics import Metrics
from scenarios.runs.run_log import RunLog
from tests.bench.bench_run import Row, print_rows
from tests.made.scenarios.long_drive import TENTH_S, sent_in
from tests.made.scenarios.messages import START, STRAIGHT, at
from transport.codec import encode
from transport.topics import TOPIC_OF, key

FLUSHED = 4
"""Tenths of a second between flushes of the log, as on the wall clock."""
GROWTH_MB = 0.8
"""Limit of the growth per minute; 0.4 MB is the chunk index of the mcap package."""


def straight(vehicles: int, minutes: int) -> Scenario:
    """A scenario on a straight road that is long enough."""
    text = STRAIGHT.replace("20.0", f"{60.0 * minutes}").replace("1000.0", f"{1500.0 * minutes}")
    return scenario_from_text(f"{text}\n[convoy]\nvehicles = {vehicles}\n", label="bench")


def memory_mb() -> float:
    """Resident memory (MB) of this process."""
    gc.collect()
    return float(psutil.Process().memory_info().rss) * 1e-6


def record(folder: Path, vehicles: int, minutes: int) -> Iterator[Row]:
    """Rows of the recorder's memory after some minutes, and at the end."""
    scenario = straight(vehicles, minutes)
    metrics = Metrics.of(scenario)
    progress = Progress(metrics, scenario.duration_s)
    run = RunLog(
        scenario,
        folder,
        clock="wall",
        run_id="bench",
        metrics=metrics,
        observers=(progress,),
    )
    run.start(START, START)
    received, started = 0, time.process_time()
    for minute in range(1, minutes + 1):
        for tenth in range(600 * (minute - 1), 600 * minute):
            for message in sent_in(tenth, vehicles):
                data = encode(message)
                received += len(data)
                now = at((tenth + 1) * TENTH_S)
                run.recorder.accept(key(message.vehicle, TOPIC_OF[type(message)]), data, now)
            if tenth % FLUSHED == 0:
                run.flush()
        if minute == 1:
            first, received_first = memory_mb(), received
        if minute in {1, 2, 5, minutes} or minute % 10 == 0:
            yield Row(f"memory after {minute} min, MB", f"{memory_mb():.1f}")
    assert not run.recorder.rejected, run.recorder.rejected
    if minutes > 1:
        grown = (memory_mb() - first) / (minutes - 1)
        arrived = (received - received_first) * 1e-6 / (minutes - 1)
        label = f"growth, MB a minute ({arrived:.1f} MB received)"
        yield Row(label, f"{grown:.2f}", f"{GROWTH_MB}", grown < GROWTH_MB)
    run.end(at(60.0 * minutes), "")
    run.close(at(60.0 * minutes))
    yield Row("memory after completion of the log, MB", f"{memory_mb():.1f}")
    seconds = (time.process_time() - started) / minutes
    yield Row("processor, s a minute, including message creation", f"{seconds:.2f}")
    yield Row("log, MB", f"{(folder / 'run.mcap').stat().st_size * 1e-6:.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Memory of a recorder in a long run.")
    parser.add_argument("--vehicles", type=int, default=4)
    parser.add_argument("--minutes", type=int, default=10)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = list(record(Path(name) / "run", given.vehicles, given.minutes))
    print_rows(f"a recorder of {given.vehicles} vehicles, {given.minutes} min", rows)


if __name__ == "__main__":
    main()
