"""Processor time of virtual runs: `python -m tests.bench.bench_virtual [--against COMMIT]`.

Prints the time of `lane_change` without and with a log, of a convoy of twenty, and of set-up and
summary: medians over rounds, each in a process of its own. `--against` measures another commit in
turn, so that other load affects both alike; then the ratio counts.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parents[2]
RATIO_MAX = 1.15
"""Limit of the ratio of times against another commit."""
CASES = {
    "without a log": (False, ()),
    "with a log": (True, ()),
    "twenty vehicles, without a log": (False, ("convoy.vehicles=20",)),
    "set-up and summary": (False, ("duration_s=0.02",)),
}
TIMED = """
import sys, tempfile, time
from pathlib import Path
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_unlogged, run_virtual
seed, is_logged, *overrides = sys.argv[1:]
text = load_scenario("lane_change").text
run_unlogged(scenario_from_text(text, overrides=["duration_s=1"]))  # one-time work
with tempfile.TemporaryDirectory() as folder:
    began = time.process_time()
    scenario = scenario_from_text(text, overrides=overrides, seed=int(seed))
    if is_logged == "True":
        run_virtual(scenario, Path(folder) / "run", Stop())
    else:
        run_unlogged(scenario)
    print(time.process_time() - began)
"""
"""Works with other commits, too: it is passed to the interpreter as text."""


def time_s(tree: Path, seed: int, is_logged: bool, overrides: Sequence[str]) -> float:
    """Processor time (s) of a run with its set-up, by the code of a tree."""
    environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    arguments = [str(seed), str(is_logged), *overrides]
    command = [sys.executable, "-c", TIMED, *arguments]
    done = subprocess.run(
        command, cwd=tree, env=environment, check=True, capture_output=True, text=True
    )
    return float(done.stdout)


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    git = ("git", "-C", str(HERE), "worktree")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "tree"
        subprocess.run([*git, "add", "-q", "--detach", str(folder), commit], check=True)
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Processor time of virtual runs.")
    parser.add_argument("--against", metavar="COMMIT", help="measure this commit as well")
    parser.add_argument("--seconds", type=float, default=35.0, help="how long a run drives")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    print(f"load before: {', '.join(f'{one:.1f}' for one in os.getloadavg())}")
    table = Table(box=SIMPLE_HEAD)
    for heading in ("processor time, s", "this tree", given.against or "-", "ratio", ""):
        table.add_column(heading)
    with ExitStack() as stack:
        trees = [HERE]
        if given.against:
            trees.append(stack.enter_context(checked_out(given.against)))
        for case, (is_logged, overrides) in CASES.items():
            drive = (f"duration_s={given.seconds}", *overrides)
            samples = [
                [time_s(tree, seed, is_logged, drive) for tree in trees]
                for seed in range(1, given.rounds + 1)
            ]
            own, *others = (median(column) for column in zip(*samples, strict=True))
            ratios = [own / other for other in others]
            table.add_row(
                case,
                f"{own:.3f}",
                *[f"{other:.3f}" for other in others] or ["-"],
                *[f"{ratio:.2f}" for ratio in ratios] or ["-"],
                *["ok" if ratio <= RATIO_MAX else "MISSED" for ratio in ratios],
            )
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
