"""A compiled installation drives the same runs as an interpreted one, bit for bit."""

import json
import os
import subprocess
import sys
from pathlib import Path
from shutil import copyfile, copytree, ignore_patterns, which

import pytest

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
"""Scenarios with what is changed of them."""
BUILT = "CONVOY_COMPILED"
"""Variable that names the folder of a compiled installation, as `.ci/compiled` builds one."""


def python(folder: Path, *arguments: str) -> str:
    """Standard output of this interpreter, which finds the project in `folder`."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def copied(into: Path) -> Path:
    """Copy what the project is built from, without what was compiled in place."""
    leave = ignore_patterns("*.so", "__pycache__")
    for name in ("vehicles", "transport", "scenarios"):
        copytree(ROOT / name, into / name, ignore=leave)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        copyfile(ROOT / name, into / name)
    return into


def install(project: Path, into: Path, *, compiled: bool) -> Path:
    """Install the project from a copy of it, by what is installed here, into a folder."""
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


def driven(folder: Path, out: Path, scenario: str, *changed: str) -> dict[str, bytes]:
    """Log and summary of a run in virtual time."""
    changes = (part for one in changed for part in ("--set", one))
    run = ("run", scenario, "--clock", "virtual", "--quiet", "--out", str(out), *changes)
    python(folder, "-m", "scenarios.cli", *run)
    return {name: (out / name).read_bytes() for name in ("run.mcap", "summary.json")}


@pytest.fixture(scope="module")
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a compiled installation: the one that `CONVOY_COMPILED` names, or a new one."""
    if built := os.environ.get(BUILT):
        return Path(built)
    if not request.config.getoption("--campaign"):
        pytest.skip(f"compiles for minutes: .ci/run, {BUILT} or --campaign")
    if which("cc") is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("compiled")
    return install(copied(folder / "project"), folder / "site", compiled=True)


@pytest.fixture(scope="module")
def plain(compiled: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:  # noqa: ARG001 - skips
    """Folder of an interpreted installation of these sources."""
    folder = tmp_path_factory.mktemp("plain")
    return install(copied(folder / "project"), folder / "site", compiled=False)


def test_an_installation_is_compiled_where_that_is_requested(compiled: Path, plain: Path) -> None:
    assert not list(plain.rglob("*.so"))
    where = "import scenarios.results.metrics as m, vehicles.driver.follower as f; print(m, f)"
    assert python(plain, "-c", where).count(".py'") == 2
    assert python(compiled, "-c", where).count(".so'") == 2


@pytest.mark.parametrize("run", RUNS, ids="-".join)
def test_compiled_runs_have_the_same_bytes(
    compiled: Path, plain: Path, run: tuple[str, ...], tmp_path: Path
) -> None:
    expected = driven(plain, tmp_path / "plain", *run)
    assert driven(compiled, tmp_path / "compiled", *run) == expected


def test_a_compiled_process_that_crashes_continues_its_car(compiled: Path, tmp_path: Path) -> None:
    crashing = ("run", "lane_change", "--quiet", "--set", "duration_s=4", "--set", CRASH)
    python(compiled, "-m", "scenarios.cli", *crashing, "--out", str(tmp_path / "crashed"))
    summary = json.loads((tmp_path / "crashed" / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert all(vehicle["finished"] for vehicle in summary["vehicles"])
