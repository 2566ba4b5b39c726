"""Runs that several tests share, simulated once per session, also under pytest-xdist."""

from dataclasses import dataclass

import pytest

from tests.made.once import first_only, shared
from tests.system.logs import Run
from tests.system.processes import invoke, start

DURATION_S = 8.0
"""The last car has begun its first lane change by then."""


@dataclass(frozen=True)
class Driven:
    """A run of `lane_change` by processes on the wall clock, and one in virtual time."""

    wall: Run
    virtual: Run
    exit_code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def lane_change(tmp_path_factory: pytest.TempPathFactory) -> Driven:
    folder = shared(tmp_path_factory) / "lane_change"
    arguments = ("run", "lane_change", f"--set=duration_s={DURATION_S}")
    with first_only(folder) as first:
        if first:
            with start(*arguments, "--out", "wall", folder=folder, fresh=True) as wall:
                virtual = invoke(
                    *arguments, "--clock=virtual", "--quiet", "--out=virtual", folder=folder
                )
                assert virtual.exit_code == 0, virtual.output
                wall.wait()
                assert not wall.remaining()
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
