"""Simulates plans."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp

from scenarios.results.files import LOG_NAME
from tests.scenarios.runs.simulation.invariants import Aftermath, broken
from tests.scenarios.runs.simulation.plan import Plan
from tests.scenarios.runs.simulation.states import states
from tests.scenarios.runs.simulation.world import World

MEMORY = Path("/dev/shm")


@dataclass(frozen=True, slots=True)
class Simulated:
    """Result of a plan: broken invariants, reached states, and a digest of all that happened."""

    broken: tuple[str, ...]
    states: tuple[str, ...]
    digest: str


def simulate(plan: Plan) -> Simulated:
    with _folder() as folder:
        world = World(plan, folder)
        world.run()
        run = Aftermath(world)
        return Simulated(tuple(broken(run)), tuple(states(run)), _digest(world))


@contextmanager
def _folder() -> Iterator[Path]:
    """Yield a folder for a run; the user's folder of open runs is in it meanwhile."""
    folder = Path(mkdtemp(dir=MEMORY if MEMORY.is_dir() else None))
    variable, before = "XDG_RUNTIME_DIR", os.environ.get("XDG_RUNTIME_DIR")
    os.environ[variable] = str(folder)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)
        os.environ.pop(variable)
        if before is not None:
            os.environ[variable] = before


def _digest(world: World) -> str:
    log = world.folder / LOG_NAME
    parts = [
        repr((world.scheduler.now, world.scheduler.switches)),
        repr([(process.name, process.exitcode, process.lines) for process in world.processes]),
        repr(list(world.network.published.items())),
        repr(log.read_bytes() if log.exists() else None),
    ]
    return sha256("\n".join(parts).encode()).hexdigest()
