"""`import convoy`: run, check and sweep do what the commands do."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import scenarios.api as convoy
from scenarios.api.running import completed_on_ctrl_c
from scenarios.cli.main import cli
from tests.made.many.small_sweeps import LIMITS, METRICS, run_sweep_here, small_plan

SETTINGS = {"duration_s": 1.0, "links.loss_ratio": 0.4}


@pytest.fixture(autouse=True)
def own_signals() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def command(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def test_a_run_writes_the_bytes_of_the_command(tmp_path: Path) -> None:
    run = convoy.run("lane_change", set=SETTINGS, seed=3, out=tmp_path / "here")
    sets = ("--set=duration_s=1.0", "--set=links.loss_ratio=0.4", "--seed=3")
    out = tmp_path / "command"
    done = command("run", "lane_change", *sets, "--clock=virtual", "--quiet", f"--out={out}")
    assert done.exit_code == 0, done.output
    assert run.log == tmp_path / "here" / "run.mcap"
    assert run.log.read_bytes() == (out / "run.mcap").read_bytes()
    assert run.summary.identity.seed == 3


def test_a_failed_run_is_opened(tmp_path: Path) -> None:
    limits = {"duration_s": 0.5, "limits.true_gap_m_min": 100.0}
    run = convoy.run(set=limits, out=tmp_path / "run")
    assert run.summary.outcome == "failed"
    assert run.summary.outcome_line in repr(run)


def test_warnings_of_a_scenario_are_warnings_of_python(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="latency"):
        convoy.run(set={"duration_s": 0.1, "links.latency_ms": 150.0}, out=tmp_path / "run")


@pytest.mark.parametrize(
    ("call", "arguments"),
    [
        (lambda: convoy.run("no_such"), ("run", "no_such")),
        (
            lambda: convoy.run(set={"links.loss_ratio": 2, "gnss.rate_hz": -1}),
            ("run", "--set=links.loss_ratio=2", "--set=gnss.rate_hz=-1"),
        ),
        (lambda: convoy.check(set={"seeds": 1}), ("check", "--set=seeds=1")),
        (
            lambda: convoy.sweep(vary={"links.loss_ratio": "0:1"}, workers=0),
            ("sweep", "lane_change", "--vary=links.loss_ratio=0:1"),
        ),
        (
            lambda: convoy.bisect("lane_change", "links.loss_ratio", "v1.error_m=1", workers=0),
            ("bisect", "lane_change", "links.loss_ratio", "--limit=v1.error_m=1"),
        ),
        (
            lambda: convoy.bisect("lane_change", "links.loss_ratio", share=0.05, runs=100),
            ("bisect", "lane_change", "links.loss_ratio", "--share=0.05", "--runs=100"),
        ),
        (lambda: convoy.open("no_such"), ("report", "no_such")),
    ],
)
def test_errors_have_the_sentences_of_the_command(
    call: Callable[[], object],
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(*arguments)
    assert done.exit_code == 2, done.output
    texts = done.stderr.splitlines()
    lines = [line.removeprefix("error: ").removeprefix("--") for line in texts]
    with pytest.raises(convoy.Error) as refused:
        call()
    assert str(refused.value).splitlines() == lines
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("settings", [{"seed": None}, {"links": object()}, {"": 1}])
def test_values_without_toml_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(convoy.Error):
        convoy.check(set=settings)


def test_ctrl_c_completes_a_run() -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert signal.getsignal(signal.SIGINT) == before


def interrupted() -> None:
    with completed_on_ctrl_c() as stop:
        signal.raise_signal(signal.SIGINT)
        assert stop.requested


def test_a_check_reports_what_the_command_reports() -> None:
    report = convoy.check("lane_change", set={"speed.set_mps": 30.0, "convoy.gap_m": 2.0})
    done = command("check", "--set=speed.set_mps=30.0", "--set=convoy.gap_m=2.0", "--json")
    assert json.loads(json.dumps(asdict(report))) == json.loads(done.stdout)
    assert report.warnings


def test_a_check_of_a_recorded_drive_has_its_facts(tmp_path: Path) -> None:
    drive = tmp_path / "drive.csv"
    rows = [f"{0.1 * k:.1f},{k + 30 * (k > 200)},0" for k in range(400)]
    drive.write_text("\n".join(["t_s,east_m,north_m", *rows]))
    done = command("check", drive, "--json")
    assert done.exit_code == 0, done.output
    report = convoy.check(drive)
    assert json.loads(json.dumps(asdict(report))) == json.loads(done.stdout)
    assert report.drive is not None
    (hole,) = report.drive.holes
    assert hole.length_m == pytest.approx(31.0)


def test_a_sweep_tabulates_what_the_command_writes(tmp_path: Path) -> None:
    expected = run_sweep_here(small_plan(), tmp_path / "sweep")
    sweep = convoy.sweep(
        "lane_change",
        {"links.loss_ratio": [0, 0.8], "convoy.gap_m": "3,10"},
        seeds=2,
        set={"duration_s": 0.8, "convoy.vehicles": 2},
        metrics=METRICS,
        limits=LIMITS,
        workers=0,
    )
    assert len(sweep.cells) == 4
    assert len(sweep.runs) == 8
    assert sweep.files == ()
    medians = [
        np.nan if one.figures[0].median is None else one.figures[0].median for one in expected.cells
    ]
    assert np.array_equal(sweep.cells["cross_track_error_m_max.median"], medians, equal_nan=True)
    assert sweep.runs["links.loss_ratio"].tolist() == 4 * [0.0] + 4 * [0.8]
    assert sweep.worst_command.startswith("convoy run lane_change")


def test_a_sweep_writes_files_on_request(tmp_path: Path) -> None:
    settings = {"duration_s": 0.2, "convoy.vehicles": 2}
    sweep = convoy.sweep(set=settings, seeds=1, out=tmp_path / "sweep", workers=0)
    assert {path.name for path in sweep.files} == {"sweep.csv", "runs.csv", "sweep.json"}
    assert all(path.is_file() for path in sweep.files)


def test_a_sweep_does_not_run_the_script_of_its_caller_again(tmp_path: Path) -> None:
    script = tmp_path / "study.py"
    script.write_text(
        "import scenarios.api as convoy\n"
        "print('script')\n"
        "print(convoy.sweep('lane_change', set={'duration_s': 0.5, 'convoy.vehicles': 2}, seeds=2,"
        " workers=2).runs.cross_track_error_m_max.size)\n"
    )
    ran = subprocess.run(
        [sys.executable, script.name],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    assert (ran.returncode, ran.stdout.split()) == (0, ["script", "2"]), ran.stderr


@pytest.mark.parametrize(
    ("refused", "name"),
    [
        (lambda: convoy.run(set={"convoy.gap": 1}), "set: "),
        (lambda: convoy.check(set={"convoy.gap": 1}), "set: "),
        (lambda: convoy.sweep(vary={"links.loss_ratio": "0..1"}), "vary: "),
        (lambda: convoy.sweep(limits=["bogus"]), "limit: "),
        (lambda: convoy.sweep(metrics=["bogus"]), "metric: "),
        (lambda: convoy.bisect("lane_change", "links.loss_ratio", range=(1.0, 0.0)), "range: "),
    ],
)
def test_errors_name_arguments_of_python(refused: Callable[[], object], name: str) -> None:
    with pytest.raises(convoy.Error) as error:
        refused()
    assert str(error.value).startswith(name)


def test_the_default_folder_is_that_of_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = convoy.run(set={"duration_s": 0.1})
    assert run.log.parent.parent == Path("runs")
    assert run.log.parent.name.endswith("lane_change-duration_s=0.1")
