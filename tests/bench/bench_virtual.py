"""How many virtual runs a core makes: `python -m tests.bench.bench_virtual [--against COMMIT]`.

Prints, of `lane_change`, the runs a minute on one core without a log and with one, what a vehicle
costs in a convoy of four and in one of twenty, and what it takes to set a run up and to sum it up.
With `--against` all of it is measured of that commit as well, which is checked out into a folder
of its own: by turns with this tree, each in a process of its own, so that a busy machine slows both
alike. What counts then is the ratio; where the commit cannot run without a log, its run with one
stands there. Times are of the processor, medians over the rounds; of the whole command `convoy run
--clock virtual` it is the elapsed time, which a user waits for. The yardstick is a plain Python
loop timed beside them.
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
"""What is measured: without a log, with one, the whole command, a longer convoy without a log, and
hardly any run."""
MANY_VEHICLES = 20
WITHOUT, WITH, PER_VEHICLE, SET_UP_MS = 2.0, 1.3, 1.2, 40.0
"""Limits for the compiled code: ratios of runs a minute, of costs per vehicle, and milliseconds."""
ELAPSED = 1.0 / 1.15
"""Limit for any: ratio of runs a minute that a user waits for."""


def serve() -> None:
    """Time the cases named on standard input, one a line, by the tree that is imported.

    Runs in a process of its own by its source text, also of commits that do not have this file.
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

    def found(name: str, *modules: str) -> Any:
        """Find what is called so in one of the modules, wherever it stood in this commit."""
        for module in modules:
            with suppress(ImportError, AttributeError):
                return getattr(import_module(module), name)
        return None

    run_virtual = found(
        "run_virtual", "scenarios.runs.virtual.logged_run", "scenarios.runs.virtual"
    )
    run_unlogged = found(
        "run_unlogged", "scenarios.runs.virtual.unlogged_run", "scenarios.runs.unlogged"
    )
    text = load_scenario("lane_change").text
    for line in sys.stdin:
        case, seed, overrides = json.loads(line)
        with tempfile.TemporaryDirectory() as folder:
            clock = time.perf_counter if case == "command" else time.process_time
            began, run = clock(), Path(folder) / "run"
            if case == "command":
                command = [sys.executable, "-m", "scenarios.cli", "run", "lane_change"]
                flags = ["--clock=virtual", f"--seed={seed}", f"--out={run}"]
                settings = [f"--set={one}" for one in overrides]
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
    """How the code in a folder runs: `compiled` in place by setup.py, or `interpreted`."""
    found = any((folder / "vehicles" / "geometry").glob("arc_spline.*.so"))
    return "compiled" if found else "interpreted"


class Served:
    """A process that does in one checkout what `serve` does: it answers each line with a line."""

    def __init__(self, folder: Path, serve: Callable[[], None]) -> None:
        """`serve` is run by its source text, with the modules of `folder`."""
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

    def ask(self, *question: object) -> list[Any]:
        """Its answer to a question; ends the bench if it has none."""
        to_it, of_it = self._process.stdin, self._process.stdout
        assert to_it is not None
        assert of_it is not None
        print(json.dumps(question), file=to_it, flush=True)
        answer = of_it.readline()
        if not answer:
            raise SystemExit(f"a run ended with exit code {self._process.wait()}")
        return list(json.loads(answer))


class Tree(Served):
    """A process that times runs of one checkout."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, serve)

    def time_s(self, case: str, seed: int, overrides: Sequence[str]) -> float:
        """Time (s) of one run, its set-up included; ends the bench if it fails."""
        spent, reason = self.ask(case, seed, list(overrides))
        if reason:
            raise SystemExit(f"{case}: the run failed: {reason}")
        return float(spent)


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """Give a temporary folder with the tree of a commit, which is removed afterwards."""
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
    """What is laid over `lane_change` in each case."""
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
    found: dict[str, dict[str, list[float]]] = {case: {} for case in cases(seconds)}
    loops = []
    for tree in trees.values():  # what a process does only once does not count
        tree.time_s(LOGGED, 1, ["duration_s=1.0"])
        tree.time_s(FOUR, 1, ["duration_s=1.0"])
    for seed in range(1, rounds + 1):
        loops.append(timed(plain_loop).processor_s)
        for case, overrides in cases(seconds).items():
            for name, tree in trees.items():
                found[case].setdefault(name, []).append(tree.time_s(case, seed, overrides))
    times = {case: {name: median(one) for name, one in by.items()} for case, by in found.items()}
    return times, median(loops)


def rows(times: Mapping[str, Mapping[str, float]], *, fast: bool) -> Iterator[tuple[str, ...]]:
    """Rows of the table: figure, this tree, the other one, ratio, limit, verdict.

    If this tree is not `fast`, limits of the compiled code are not judged.
    """
    (here, *others) = times[FOUR]

    def row(
        what: str, value: Mapping[str, float], limit: float, *, ratio: bool = False, up: bool = True
    ) -> tuple[str, ...]:
        held = value[here] / value[others[0]] if others else None
        judged = held if ratio else value[here]
        verdict = "" if judged is None else "ok" if (judged >= limit) == up else "MISSED"
        asked = f"{'ratio ' if ratio else ''}{'≥' if up else '≤'} {limit:.3g}"
        if not fast and limit != ELAPSED:
            asked, verdict = f"compiled {asked}", ""
        other = f"{value[others[0]]:.2f}" if others else "-"
        return (
            what,
            f"{value[here]:.2f}",
            other,
            "-" if held is None else f"{held:.2f}",
            asked,
            verdict,
        )

    minute = {case: {tree: 60.0 / one for tree, one in by.items()} for case, by in times.items()}
    share = {
        name: times[MANY][name] / MANY_VEHICLES / (times[FOUR][name] / 4) for name in minute[FOUR]
    }
    yield row("runs a minute per core, without a log", minute[FOUR], WITHOUT, ratio=True)
    yield row("runs a minute per core, with a log", minute[LOGGED], WITH, ratio=True)
    yield row("whole commands a minute, elapsed", minute[COMMAND], ELAPSED, ratio=True)
    yield row(f"a vehicle of {MANY_VEHICLES} costs one of four times", share, PER_VEHICLE, up=False)
    set_up = {name: 1000.0 * one for name, one in times[SET_UP].items()}
    yield row("set-up and summary, ms", set_up, SET_UP_MS, up=False)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description="How many virtual runs a core makes.")
    parser.add_argument("--against", metavar="COMMIT", help="measure this commit as well")
    parser.add_argument("--seconds", type=float, default=35.0, help="how long a run drives")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    print(f"{os.cpu_count()} cores; load over 1, 5, 15 minutes before: {load}")
    with ExitStack() as stack:
        folders = {"this tree": HERE}
        if given.against:
            folders[given.against] = stack.enter_context(checked_out(given.against))
        trees = {name: stack.enter_context(Tree(folder)) for name, folder in folders.items()}
        times, loop = measured(trees, given.seconds, given.rounds)
        print("code:", ", ".join(f"{name} {code(folder)}" for name, folder in folders.items()))
    table = Table(box=SIMPLE_HEAD)
    for heading in ("", "this tree", given.against or "-", "ratio", "asked", ""):
        table.add_column(heading)
    for one in rows(times, fast=code(HERE) == "compiled"):
        table.add_row(*one)
    Console(width=110).print(table)
    print(
        f"yardstick: {LOOP // 1_000_000} million additions take {loop:.2f} s, a run of four "
        f"{times[FOUR]['this tree'] / loop:.1f} of them without a log, "
        f"{times[LOGGED]['this tree'] / loop:.1f} with one"
    )


if __name__ == "__main__":
    main()
