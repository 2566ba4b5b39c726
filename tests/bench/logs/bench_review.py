"""Cost of reading a log: `python -m tests.bench.logs.bench_review LOG`.

Measures a review, a review of a twentieth of the run, an explanation, the derived columns of the
Python interface, and reading every field, each against a simpler method that gives the same; prints
processor times and ratios. Each measurement has a process of its own, so that its largest memory
counts. Ratios are independent of the machine; a long log takes minutes by the simple methods.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from scenarios.results.log_queries.explain import RecordedKnowledge, explain
from scenarios.results.log_summary import scenario_in
from scenarios.results.metrics import Metrics
from scenarios.results.pictures.log_drawing import Excerpt
from scenarios.results.pictures.review import review
from scenarios.results.pictures.run_drawing import open_drawing
from scenarios.results.recorded.run_record import RunRecord
from transport.log.reader import LogReader
from transport.picture.option import parse_rerun_option
from transport.topics import TOPICS
from vehicles.schedule import SECOND


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


def draw_span(log: Path, picture: Path) -> None:
    middle_s, length_s = _middle(log)
    part = Excerpt(middle_s, middle_s + length_s / 20)
    review(log, parse_rerun_option(f"save={picture}"), wait=lambda _: None, excerpt=part)


def explain_whole(log: Path, _picture: Path) -> None:
    RecordedKnowledge(log, RunRecord(log).vehicle_names[-1]).at(_middle(log)[0], whole=True)


def explain_instant(log: Path, _picture: Path) -> None:
    explain(log, RunRecord(log).vehicle_names[-1], _middle(log)[0])


def derive_messages(log: Path, _picture: Path) -> None:
    reader = LogReader(log)
    metrics = Metrics.of(scenario_in(reader))
    for at, _, message in reader.messages(metrics.topics):
        metrics.listen(at, message)
    metrics.accounts(reader.last_at - (metrics.start_at or 0))


def derive_columns(log: Path, _picture: Path) -> None:
    run = RunRecord(log)
    for vehicle in run.vehicles.values():
        _ = vehicle.true.error_m, vehicle.true.gap_m
    for link in run.links.values():
        _ = link.outcomes


def _middle(log: Path) -> tuple[float, float]:
    """Middle of a run and its duration (s)."""
    reader = LogReader(log)
    length_s = (reader.last_at - reader.first_at) / SECOND
    return length_s / 2, length_s


RATIOS_MIN = (
    (draw_messages, draw_columns, 4.0),
    (draw_columns, draw_span, 2.0),
    (explain_whole, explain_instant, 3.0),
    (derive_messages, derive_columns, 2.0),
    (read_messages, read_columns, 2.0),
)
"""Limits: processor time of the simpler method over that of the other one."""
CASES = {case.__name__: case for row in RATIOS_MIN for case in row[:2]}


def measure(name: str, log: Path) -> float:
    """Processor time (s) of a case in a new process."""
    command = [sys.executable, "-m", "tests.bench.logs.bench_review", str(log), "--case", name]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    seconds, megabytes = map(float, done.stdout.split()[-2:])
    print(f"{name:<15} {seconds:7.1f} s of processor time, {megabytes:6.0f} MB")
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
    seconds_of = {name: measure(name, given.log) for name in CASES}
    for slow, fast, least in RATIOS_MIN:
        ratio = seconds_of[slow.__name__] / seconds_of[fast.__name__]
        print(f"{fast.__name__:<15} ratio {ratio:5.1f}, at least {least:g}: {ratio >= least}")


if __name__ == "__main__":
    main()
