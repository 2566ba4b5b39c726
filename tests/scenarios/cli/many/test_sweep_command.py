"""`convoy sweep`: killed and restarted, a run repeated, refusals in one line."""

import csv
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.results.summary import to_json
from scenarios.studies.engine import JOURNAL
from tests.made.ended import has_ended
from tests.made.many.small_sweeps import (
    LIMITS,
    METRICS,
    SETS,
    VARY,
    run_sweep_here,
    small_plan,
    tables,
)

SEEDS = 4
WORDS = ["--vary=links.preset=clear,lossy", "--vary=control.fusion=composite,blend"]
KEYS = ("convoy.gap_m", "gnss.rate_hz", "links.latency_ms")
LINES = 4 * SEEDS + 1
"""Lines of the finished journal."""
ARGUMENTS = [
    "lane_change",
    *(f"--set={text}" for text in SETS),
    *(f"--vary={text}" for text in VARY),
    *(f"--metric={text}" for text in METRICS),
    *(f"--limit={text}" for text in LIMITS),
    f"--seeds={SEEDS}",
]


def convoy(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, list(map(str, arguments)))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole")
    run_sweep_here(small_plan(seeds=SEEDS), out)
    return out


def started(out: Path) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "scenarios.cli", "sweep", *ARGUMENTS, f"--out={out}"]
    return subprocess.Popen(
        [*command, "--workers=1"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def lines(out: Path) -> int:
    journal = out / JOURNAL
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.002)


def ended(processes: Sequence[psutil.Process]) -> bool:
    return all(has_ended(one) for one in processes)


def workers_of(driver: "subprocess.Popen[bytes]") -> list[psutil.Process]:
    found = []
    for child in psutil.Process(driver.pid).children(recursive=True):
        with suppress(psutil.NoSuchProcess):  # one that has just ended
            if "forkserver" in " ".join(child.cmdline()):
                found.append(child)
    return found


@pytest.mark.long
@pytest.mark.campaign(1, 10)
def test_killed_drivers_and_workers_change_no_result(
    whole: Path, campaign: int, tmp_path: Path
) -> None:
    noise = random.Random(17)
    for _ in range(campaign):
        # One run makes the first batch, all others the next one: that is when it is killed.
        wanted = max(lines(tmp_path), 1) + 1
        driver = started(tmp_path)
        wait_for(lambda least=wanted: lines(tmp_path) >= least)  # type: ignore[misc]
        time.sleep(noise.uniform(0.0, 0.05))
        workers = psutil.Process(driver.pid).children(recursive=True)
        driver.send_signal(signal.SIGKILL)
        driver.wait()
        wait_for(lambda them=workers: ended(them))  # type: ignore[misc]
    assert not (tmp_path / "sweep.csv").exists(), "killed too late to show anything"
    before = lines(tmp_path)
    driver = started(tmp_path)
    wait_for(lambda: lines(tmp_path) > before)
    for worker in workers_of(driver):
        with suppress(psutil.NoSuchProcess):  # one that ended with what it was forked from
            worker.kill()
    assert driver.wait(120.0) == 0
    assert tables(tmp_path) == tables(whole)
    assert lines(tmp_path) == LINES


def test_ctrl_c_prints_one_line_and_leaves_no_process(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scenarios.cli", "sweep", *ARGUMENTS, f"--out={tmp_path}"]
    with subprocess.Popen(
        [*command, "--workers=2"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # with its workers, as in a terminal
    ) as driver:
        assert driver.stderr is not None
        wait_for(lambda: lines(tmp_path) > 0)
        workers = psutil.Process(driver.pid).children(recursive=True)
        os.killpg(driver.pid, signal.SIGINT)
        printed = driver.stderr.read().splitlines()
        assert driver.wait(60.0) == 130
    wait_for(lambda: ended(workers))
    assert [line for line in printed if line and " runs" not in line] == ["stopped by SIGINT"]


def test_the_command_of_a_run_repeats_it_bit_for_bit(whole: Path, tmp_path: Path) -> None:
    with (whole / "runs.csv").open(newline="") as file:
        row = list(csv.DictReader(file))[-1]
    program, *words = shlex.split(row["command"])
    assert program == "convoy"
    done = convoy(*words, "--out", tmp_path, "--quiet")
    assert done.exit_code == 0, done.output
    plan = small_plan(seeds=SEEDS)
    summary = plan.variants(plan.cells[-1])[-1].run()
    assert (tmp_path / "summary.json").read_text() == to_json(summary)
    for figure in plan.figures:
        value = figure.of(summary)
        assert row[figure.name] == ("" if value is None else repr(value))


def test_a_run_that_raises_is_printed_with_exit_code_1(tmp_path: Path) -> None:
    vary = ["--vary=convoy.vehicles=3,2", "--vary=vehicle={},{v3={clock={offset_ms=3.0}}}"]
    given = ["sweep", "lane_change", *vary, "--set=duration_s=0.5", "--seeds=1"]
    done = convoy(*given, "--workers=0", "--out", tmp_path)
    assert done.exit_code == 1
    count, line = done.stderr.splitlines()[-2:]
    assert count == "error: 1 of 4 runs raised an error"
    command = "convoy run lane_change --set=duration_s=0.5 --set=convoy.vehicles=2"
    assert line.startswith(f"error: {command}")
    assert line.endswith("vehicle.v3: no such vehicle, allowed v1, v2")
    assert "errors" in done.stdout


@pytest.mark.parametrize(
    ("given", "fact"),
    [
        (["nowhere"], "nowhere"),
        (["lane_change", "--vary", "links.loss_ratio=0:1:0.3"], "a STEP that reaches STOP"),
        (["lane_change", "--vary", "links.los=0,1"], "unknown key"),
        (["lane_change", "--metric", "errors"], "--metric: unknown metric 'errors', "),
        (["lane_change", "-o", "a.png"], "--output: no keys vary, a picture needs one or two"),
        (
            ["lane_change", *(f"--vary={key}=1,2" for key in KEYS), "-o", "a.png"],
            "--output: 3 keys vary",
        ),
        (["lane_change", *WORDS, "-o", "a.png"], "--output: neither links.preset nor "),
        (["lane_change", "--vary=convoy.gap_m=3,10", "-o", "a.gif"], "a.gif: given .gif, allowed"),
        (["lane_change", "--limit", "error_m"], "--limit: given 'error_m', allowed"),
    ],
)
def test_invalid_input_is_refused_in_one_line(given: list[str], fact: str, tmp_path: Path) -> None:
    done = convoy("sweep", *given, "--out", tmp_path / "sweep")
    assert done.exit_code == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert fact in line
    assert not (tmp_path / "sweep").exists()
