"""A compiled installation writes the same bytes as an interpreted one."""

import json
import os
import subprocess
import sys
from pathlib import Path
from shutil import copyfile, copytree, ignore_patterns, rmtree, which

import pytest

from tests.made.scenarios.random_classes import CODE, random_settings

ROOT = Path(__file__).parents[2]
NO_RADIO = "change=[{kind='cut', at_s=1, for_s=2.5}]"
CRASH = "change=[{kind='crash', vehicle='v2', at_s=1, for_s=1.5}]"
RUNS = (
    ("lane_change", "duration_s=4"),
    ("lane_change", "duration_s=3", "control.trajectory=paper", "control.controller=stanley"),
    ("lane_change", "duration_s=5", NO_RADIO),
    ("lossy_lane_change", "duration_s=5", "links.loss_ratio=0.8"),
    ("lossy_lane_change", "duration_s=5", "links.preset=bursty", "gnss.preset=rtk_float"),
    ("church_lot", "duration_s=5", "gnss.latency_ms=120"),
    ("highway", "duration_s=3", "control.fusion=blend"),
    ("lead_lost", "duration_s=12"),
)
"""Scenarios with overrides."""
COMPILED_VARIABLE = "CONVOY_COMPILED"
"""Variable with the folder of a compiled installation, which `.ci/compiled` builds."""


def python(folder: Path, *arguments: str, modules: Path | None = None) -> str:
    """Run this interpreter on the project in `folder`; return its standard output.

    `modules` is another folder of modules.
    """
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, filter(None, (folder, modules))))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def copied(into: Path) -> Path:
    """Copy the sources of the project, without modules compiled in place."""
    leave = ignore_patterns("*.so", "__pycache__")
    for name in ("vehicles", "transport", "scenarios"):
        copytree(ROOT / name, into / name, ignore=leave)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        copyfile(ROOT / name, into / name)
    return into


def install(project: Path, into: Path, *, compiled: bool) -> Path:
    """Install a copy of the project into a folder, offline."""
    pip = ("-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index")
    done = subprocess.run(
        [sys.executable, *pip, "--target", str(into), str(project)],
        env=os.environ | {"CONVOY_COMPILE": str(int(compiled))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return into


def run_files(
    folder: Path, out: Path, scenario: str, *changed: str, modules: Path | None = None
) -> dict[str, bytes]:
    """Log and summary of a virtual run, with classes in the folder `modules`."""
    changes = (part for setting in changed for part in ("--set", setting))
    run = ("run", scenario, "--clock", "virtual", "--quiet", "--out", str(out), *changes)
    python(folder, "-m", "scenarios.cli", *run, modules=modules)
    return {name: (out / name).read_bytes() for name in ("run.mcap", "summary.json")}


@pytest.fixture(scope="module")
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a compiled installation: that of `CONVOY_COMPILED`, or a new one."""
    if compiled_folder := os.environ.get(COMPILED_VARIABLE):
        return Path(compiled_folder)
    if not request.config.getoption("--campaign"):
        pytest.skip(f"takes minutes to compile: .ci/run, {COMPILED_VARIABLE} or --campaign")
    if which("cc") is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("compiled")
    return install(copied(folder / "project"), folder / "site", compiled=True)


@pytest.fixture(scope="module")
def plain(compiled: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001 - skips
    """Folder of an interpreted installation of the same sources."""
    folder = tmp_path_factory.mktemp("plain")
    return install(copied(folder / "project"), folder / "site", compiled=False)


def test_an_installation_is_compiled_on_request(compiled: Path, plain: Path) -> None:
    assert not list(plain.rglob("*.so"))
    where = "import scenarios.results.metrics as m, vehicles.driver.follower as f; print(m, f)"
    assert python(plain, "-c", where).count(".py'") == 2
    assert python(compiled, "-c", where).count(".so'") == 2


@pytest.mark.parametrize("run", RUNS, ids="-".join)
def test_compiled_runs_have_the_same_bytes(
    compiled: Path, plain: Path, run: tuple[str, ...], tmp_path: Path
) -> None:
    expected = run_files(plain, tmp_path / "plain", *run)
    assert run_files(compiled, tmp_path / "compiled", *run) == expected


def test_random_classes_decide_alike_in_compiled_runs(
    compiled: Path, plain: Path, tmp_path: Path
) -> None:
    modules = tmp_path / "own"
    modules.mkdir()
    (modules / "mine.py").write_text(CODE, encoding="utf-8")
    sets = ("duration_s=3", "links.loss_ratio=0.3", *random_settings("mine"))
    expected, found = (
        run_files(folder, tmp_path / f"run{number}", "lane_change", *sets, modules=modules)
        for number, folder in enumerate((plain, compiled))
    )
    assert found == expected


def test_both_installations_have_the_python_interface(
    compiled: Path, plain: Path, tmp_path: Path
) -> None:
    (tmp_path / "scenarios").mkdir()
    code = f"""
import os, convoy
os.chdir({str(tmp_path)!r})
run = convoy.run(set={{"duration_s": 1.0}}, out="run")
print(convoy.__file__, run.summary.outcome, max(run.vehicles["v3"].true.t_s))
"""
    for folder in (compiled, plain):
        file, outcome, last_s = python(folder, "-c", code).split()
        assert file == str(folder / "convoy" / "__init__.py")
        assert (outcome, float(last_s)) == ("completed", 0.98)
        rmtree(tmp_path / "run")


def test_a_crashed_compiled_process_restarts(compiled: Path, tmp_path: Path) -> None:
    crashing = ("run", "lane_change", "--quiet", "--set", "duration_s=4", "--set", CRASH)
    python(compiled, "-m", "scenarios.cli", *crashing, "--out", str(tmp_path / "crashed"))
    summary = json.loads((tmp_path / "crashed" / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert all(vehicle["finished"] for vehicle in summary["vehicles"])
