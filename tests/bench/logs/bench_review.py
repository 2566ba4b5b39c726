"""Cost of reviewing a log: `python -m tests.bench.logs.bench_review LOG`.

Draws a log message by message, as live, and by columns, as `convoy review`, and reads it both ways;
prints processor times and ratios. Each measurement has a process of its own, so that its largest
memory counts. Ratios are independent of the machine; a long log takes minutes the old way.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from scenarios.results.log_summary import scenario_in
from scenarios.results.metrics import Metrics
from scenarios.results.pictures.review import review
from scenarios.results.pictures.run_drawing import open_drawing
from transport.log.reader import LogReader
from transport.picture.option import parse_rerun_option
from transport.topics import TOPICS

SAVED_RATIO_MIN = 4.0
"""Limit: processor time of the picture message by message over that by columns."""
READ_RATIO_MIN = 5.0
"""The same for reading every field."""


def draw_messages(log: Path, picture: Path) -> None:
    reader = LogReader(log)
    scenario = scenario_in(reader)
    metrics = Metrics.of(scenario)
    option = parse_rerun_option(f"save={picture}")
    with open_drawing(option, scenario, log, metrics) as drawing:
        for now, _, message in reader.messages():
            metrics.listen(now, message)
            drawing.draw(now, message)


def draw_columns(log: Path, picture: Path) -> None:
    review(log, parse_rerun_option(f"save={picture}"), wait=lambda _: None)


def read_messages(log: Path, _picture: Path) -> None:
    for _ in LogReader(log).messages():
        pass


def read_columns(log: Path, _picture: Path) -> None:
    LogReader(log).columns(TOPICS)


CASES = {case.__name__: case for case in (draw_messages, draw_columns, read_messages, read_columns)}


def measure(name: str, log: Path) -> float:
    """Processor time (s) of a case in a new process."""
    command = [sys.executable, "-m", "tests.bench.logs.bench_review", str(log), "--case", name]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, megabytes = map(float, done.stdout.split()[-2:])
    print(f"{name:<14} {seconds:7.1f} s of processor time, {megabytes:6.0f} MB")
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the cost of reviewing a log.")
    parser.add_argument("log", type=Path)
    parser.add_argument("--case", choices=CASES)
    given = parser.parse_args()
    if given.case:
        with tempfile.TemporaryDirectory() as folder:
            before = time.process_time()
            CASES[given.case](given.log, Path(folder) / "run.rrd")
            seconds = time.process_time() - before
        print(seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
        return
    for old, new, least in (
        ("draw_messages", "draw_columns", SAVED_RATIO_MIN),
        ("read_messages", "read_columns", READ_RATIO_MIN),
    ):
        ratio = measure(old, given.log) / measure(new, given.log)
        print(f"{'':<14} ratio {ratio:.1f}, at least {least:g}: {ratio >= least}")


if __name__ == "__main__":
    main()
