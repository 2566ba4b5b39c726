"""Virtual runs per minute and core: `python -m tests.bench.bench_virtual [--against COMMIT]`.

Prints for `lane_change` the runs per minute on one core without and with a log, the cost of a
vehicle in convoys of four and of twenty, and the time of set-up and summary. `--against` measures
another commit in turn, in a folder and a process of its own, so that other load affects both alike;
then the ratio counts. A commit that cannot run without a log is measured with one. Times are
processor times, medians over the rounds; for the whole command `convoy run --clock virtual` it is
the elapsed time. The yardstick is a plain Python loop.
"""

import argparse
import inspect
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import Any, Self

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from tests.bench.bench_run import LOOP, plain_loop, timed

HERE = Path(__file__).parents[2]
FOUR, LOGGED, COMMAND, MANY, SET_UP = "four", "logged", "command", "many", "set-up"
"""Cases: without a log, with one, the whole command, a longer convoy without a log, and a minimal
run."""
MANY_VEHICLES = 20
UNLOGGED_RATIO_MIN, LOGGED_RATIO_MIN, VEHICLE_COST_MAX, SET_UP_MS = 2.0, 1.3, 1.2, 40.0
"""Limits of compiled code: ratios of runs per minute, of costs per vehicle, and milliseconds."""
ELAPSED_RATIO_MIN = 1.0 / 1.15
"""Limit of any code: ratio of whole commands per minute."""


def serve() -> None:
    """Time the case of each line of standard input with the imported tree.

    Runs in a new process from its source text, also with commits without this file.
    """
    import json  # noqa: PLC0415
    import subprocess  # noqa: PLC0415
    import sys  # noqa: PLC0415
    import tempfile  # noqa: PLC0415
    import time  # noqa: PLC0415
    from contextlib import suppress  # noqa: PLC0415
    from importlib import import_module  # noqa: PLC0415
    from pathlib import Path  # noqa: PLC0415
    from typing import Any  # noqa: PLC0415

    from scenarios.definition.scenario import load_scenario, scenario_from_text  # noqa: PLC0415
    from scenarios.results.summary import to_json  # noqa: PLC0415
    from scenarios.runs.stop import Stop  # noqa: PLC0415

    def find(name: str, *modules: str) -> Any:
        for module in modules:
            with suppress(ImportError, AttributeError):
                return getattr(import_module(module), name)
        return None

    run_virtual = find("run_virtual", "scenarios.runs.virtual", "scenarios.runs.virtual")
    run_unlogged = find("run_unlogged", "scenarios.runs.virtual", "scenarios.runs.unlogged")
    text = load_scenario("lane_change").text
    for line in sys.stdin:
        case, seed, overrides = json.loads(line)
        with tempfile.TemporaryDirectory() as folder:
            clock = time.perf_counter if case == "command" else time.process_time
            began, run = clock(), Path(folder) / "run"
            if case == "command":
                command = [sys.executable, "-m", "scenarios.cli", "run", "lane_change"]
                flags = ["--clock=virtual", f"--seed={seed}", f"--out={run}"]
                settings = [f"--set={override}" for override in overrides]
                done = subprocess.run(
                    [*command, *flags, *settings], check=False, capture_output=True
                )
                reason = done.stderr.decode() if done.returncode else ""
                print(json.dumps([clock() - began, reason]), flush=True)
                continue
            scenario = scenario_from_text(text, label="bench", overrides=overrides, seed=seed)
            if case == "logged" or run_unlogged is None:
                summary = run_virtual(scenario, run, Stop())
            else:
                summary = run_unlogged(scenario)
            to_json(summary)
            print(json.dumps([clock() - began, summary.reason]), flush=True)


def code(folder: Path) -> str:
    found = any((folder / "vehicles" / "geometry").glob("arc_spline.*.so"))
    return "compiled" if found else "interpreted"


class LineServer:
    def __init__(self, folder: Path, serve: Callable[[], None]) -> None:
        environment = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", f"{inspect.getsource(serve)}\n{serve.__name__}()"],
            cwd=folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def request(self, *values: object) -> list[Any]:
        requests, responses = self._process.stdin, self._process.stdout
        assert requests is not None
        assert responses is not None
        print(json.dumps(values), file=requests, flush=True)
        response = responses.readline()
        if not response:
            raise SystemExit(f"a run ended with exit code {self._process.wait()}")
        return list(json.loads(response))


class Tree(LineServer):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder, serve)

    def time_s(self, case: str, seed: int, overrides: Sequence[str]) -> float:
        """Time (s) of a run with its set-up; exit the bench if it fails."""
        spent, reason = self.request(case, seed, list(overrides))
        if reason:
            raise SystemExit(f"{case}: the run failed: {reason}")
        return float(spent)


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    git = ("git", "-C", str(HERE), "worktree")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "tree"
        made = subprocess.run(
            [*git, "add", "--detach", str(folder), commit],
            check=False,
            capture_output=True,
            text=True,
        )
        if made.returncode:
            raise SystemExit(made.stderr.strip())
        try:
            yield folder
        finally:
            subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def cases(seconds: float) -> dict[str, list[str]]:
    drive = [f"duration_s={seconds}"]
    return {
        FOUR: drive,
        LOGGED: drive,
        COMMAND: drive,
        MANY: [*drive, f"convoy.vehicles={MANY_VEHICLES}"],
        SET_UP: ["duration_s=0.02"],
    }


def measured(
    trees: Mapping[str, Tree], seconds: float, rounds: int
) -> tuple[dict[str, dict[str, float]], float]:
    """Median time (s) of each case by tree, and of the yardstick."""
    samples: dict[str, dict[str, list[float]]] = {case: {} for case in cases(seconds)}
    loops = []
    for tree in trees.values():  # excludes one-time work of a process
        tree.time_s(LOGGED, 1, ["duration_s=1.0"])
        tree.time_s(FOUR, 1, ["duration_s=1.0"])
    for seed in range(1, rounds + 1):
        loops.append(timed(plain_loop).processor_s)
        for case, overrides in cases(seconds).items():
            for name, tree in trees.items():
                samples[case].setdefault(name, []).append(tree.time_s(case, seed, overrides))
    times = {
        case: {name: median(values) for name, values in by.items()} for case, by in samples.items()
    }
    return times, median(loops)


def rows(times: Mapping[str, Mapping[str, float]], *, fast: bool) -> Iterator[tuple[str, ...]]:
    """Rows: figure, this tree, other tree, ratio, limit, verdict.

    Limits of compiled code are judged only if this tree is compiled (`fast`).
    """
    (here, *others) = times[FOUR]

    def row(
        label: str,
        value: Mapping[str, float],
        limit: float,
        *,
        ratio: bool = False,
        up: bool = True,
    ) -> tuple[str, ...]:
        comparison = value[here] / value[others[0]] if others else None
        judged = comparison if ratio else value[here]
        verdict = "" if judged is None else "ok" if (judged >= limit) == up else "MISSED"
        limit_text = f"{'ratio ' if ratio else ''}{'≥' if up else '≤'} {limit:.3g}"
        if not fast and limit != ELAPSED_RATIO_MIN:
            limit_text, verdict = f"compiled {limit_text}", ""
        other = f"{value[others[0]]:.2f}" if others else "-"
        return (
            label,
            f"{value[here]:.2f}",
            other,
            "-" if comparison is None else f"{comparison:.2f}",
            limit_text,
            verdict,
        )

    minute = {case: {tree: 60.0 / t for tree, t in by.items()} for case, by in times.items()}
    share = {
        name: times[MANY][name] / MANY_VEHICLES / (times[FOUR][name] / 4) for name in minute[FOUR]
    }
    yield row("runs a minute per core, without a log", minute[FOUR], UNLOGGED_RATIO_MIN, ratio=True)
    yield row("runs a minute per core, with a log", minute[LOGGED], LOGGED_RATIO_MIN, ratio=True)
    yield row("whole commands a minute, elapsed", minute[COMMAND], ELAPSED_RATIO_MIN, ratio=True)
    yield row(
        f"cost of a vehicle, {MANY_VEHICLES} relative to 4 vehicles",
        share,
        VEHICLE_COST_MAX,
        up=False,
    )
    set_up = {name: 1000.0 * time_s for name, time_s in times[SET_UP].items()}
    yield row("set-up and summary, ms", set_up, SET_UP_MS, up=False)


def main() -> None:
    parser = argparse.ArgumentParser(description="Virtual runs per minute and core.")
    parser.add_argument("--against", metavar="COMMIT", help="measure this commit as well")
    parser.add_argument("--seconds", type=float, default=35.0, help="how long a run drives")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    print(f"{os.cpu_count()} cores; load over 1, 5, 15 minutes before: {load}")
    with ExitStack() as stack:
        folders = {"this tree": HERE}
        if given.against:
            folders[given.against] = stack.enter_context(checked_out(given.against))
        trees = {name: stack.enter_context(Tree(folder)) for name, folder in folders.items()}
        times, loop = measured(trees, given.seconds, given.rounds)
        print("code:", ", ".join(f"{name} {code(folder)}" for name, folder in folders.items()))
    table = Table(box=SIMPLE_HEAD)
    for heading in ("", "this tree", given.against or "-", "ratio", "limit", ""):
        table.add_column(heading)
    for row in rows(times, fast=code(HERE) == "compiled"):
        table.add_row(*row)
    Console(width=110).print(table)
    print(
        f"yardstick: {LOOP // 1_000_000} million additions take {loop:.2f} s, a run of four "
        f"{times[FOUR]['this tree'] / loop:.1f} of them without a log, "
        f"{times[LOGGED]['this tree'] / loop:.1f} with one"
    )


if __name__ == "__main__":
    main()
