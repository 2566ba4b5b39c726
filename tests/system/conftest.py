"""Runs that several tests look at are driven once, also when tests run side by side."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.system.logs import Run
from tests.system.processes import run_to_the_end

DURATION_S = 8.0
"""By then the last car is in its first lane change."""


@dataclass(frozen=True)
class Driven:
    """`lane_change` as driven by processes on the wall clock, and in virtual time."""

    wall: Run
    virtual: Run
    exit_code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def lane_change(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    """The default scenario, shortened: a run on the wall clock and its virtual twin."""
    folder = shared(tmp_path_factory) / "lane_change"
    arguments = ("run", "lane_change", f"--set=duration_s={DURATION_S}")
    with first_only(folder) as first:
        if first:
            wall = run_to_the_end(*arguments, "--out", "wall", folder=folder)
            virtual = run_to_the_end(
                *arguments, "--clock=virtual", "--quiet", "--out=virtual", folder=folder
            )
            assert virtual.exit_code == 0, virtual.err
            (folder / "wall.out").write_text(wall.out)
            (folder / "wall.err").write_text(wall.err)
            (folder / "wall.code").write_text(str(wall.exit_code))
    return Driven(
        wall=Run(folder / "wall"),
        virtual=Run(folder / "virtual"),
        exit_code=int((folder / "wall.code").read_text()),
        out=(folder / "wall.out").read_text(),
        err=(folder / "wall.err").read_text(),
    )


def shared(factory: pytest.TempPathFactory) -> Path:
    """Return the folder that all processes of one test session have in common."""
    own = factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


@contextmanager
def first_only(folder: Path) -> Iterator[bool]:
    """Give True to whoever comes first; the others wait until it is through."""
    folder.mkdir(exist_ok=True)
    done = folder / "done"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield not done.exists()
        done.touch()
