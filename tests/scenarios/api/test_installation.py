"""The package `convoy` as an installation has it, and runs with real processes from Python."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import scenarios.api as convoy
from tests.made.installed import OWN, arrange


@pytest.fixture
def site(tmp_path: Path) -> Path:
    return arrange(tmp_path / "site")


def python(code: str, site: Path, folder: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("is_package", [True, False])
def test_folders_of_the_same_names_do_not_matter(
    site: Path, tmp_path: Path, *, is_package: bool
) -> None:
    work = tmp_path / "work"
    for name in OWN:
        (work / name).mkdir(parents=True)
        if is_package:
            (work / name / "__init__.py").write_text("raise SystemExit('imported')")
    code = """
import convoy, sys, scenarios.api
assert convoy.Run is scenarios.api.Run
run = convoy.run("lane_change", set={"duration_s": 0.2, "convoy.vehicles": 2}, out="run")
print(run.summary.outcome)
sweep = convoy.sweep(set={"duration_s": 0.2, "convoy.vehicles": 2}, seeds=2, workers=1)
print(sweep.runs.error.tolist())
"""
    if is_package:
        done = python(code, site, work)
    else:  # as in an editable installation, whose packages are found last
        finder = (
            "import sys, importlib.machinery as m\n"
            "class Last:\n"
            "    @staticmethod\n"
            "    def find_spec(name, path=None, target=None):\n"
            f"        return m.PathFinder.find_spec(name, path or [{str(site)!r}])\n"
            "sys.meta_path.append(Last)\n"
        )
        (tmp_path / "last").mkdir()
        (tmp_path / "last" / "sitecustomize.py").write_text(finder)
        done = python(code, tmp_path / "last", work)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["completed", "['', '']"]


def test_a_run_on_the_wall_clock(tmp_path: Path) -> None:
    settings = {"duration_s": 1.0, "convoy.vehicles": 2}
    run = convoy.run("lane_change", set=settings, clock="wall", out=tmp_path / "run")
    assert run.summary.identity.clock == "wall"
    assert run.summary.outcome == "completed"
    assert len(run.vehicles["v2"].true) == 50
