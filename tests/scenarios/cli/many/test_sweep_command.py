"""`convoy sweep`: a run repeated, refusals in one line."""

import csv
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.results.summary import to_json
from tests.made.many.small_sweeps import (
    LIMITS,
    METRICS,
    SETS,
    VARY,
    run_sweep_here,
    small_plan,
)

SEEDS = 4
WORDS = ["--vary=links.preset=clear,lossy", "--vary=control.fusion=composite,blend"]
KEYS = ("convoy.gap_m", "gnss.rate_hz", "links.latency_ms")
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
