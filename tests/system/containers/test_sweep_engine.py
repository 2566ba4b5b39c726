"""A sweep on two dask workers in containers writes the tables of a pool, also if one is killed."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from uuid import uuid4

import pytest

from tests.made.many.small_sweeps import LIMITS, METRICS, SETS, TABLES, VARY
from tests.system.containers.images import (
    BUILD_S,
    VEHICLE_IMAGE,
    call,
    copy_parts,
    missing_requirement,
    pip_works_in_containers,
)

IMAGE = "convoy-emulator-engine"
DRIVE_S = 300.0
SEEDS = 12
RUNS = 4 * SEEDS
DOCKERFILE = f"""
FROM {VEHICLE_IMAGE}
RUN pip install --no-cache-dir distributed=={{}}
ENTRYPOINT []
"""
COMPOSE = f"""
x-part: &part
  image: {IMAGE}
  init: true
  volumes: ["./out:/out"]

services:
  scheduler:
    <<: *part
    command: dask scheduler --port 8786 --no-dashboard
  one: &worker
    <<: *part
    command: dask worker tcp://scheduler:8786 --nthreads 1 --no-dashboard
    depends_on: [scheduler]
  other:
    <<: *worker
"""
"""No port is published: only containers of this network can connect."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    """A folder with the compose file, and its image built."""
    if not request.config.getoption("--campaign"):
        pytest.skip("builds an image with dask: with --campaign")
    pytest.importorskip("distributed")
    if reason := missing_requirement():
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("engine")
    copy_parts(folder)
    steps = [("vehicle", VEHICLE_IMAGE, "Dockerfile"), ("", IMAGE, "Dockerfile.engine")]
    (folder / "Dockerfile.engine").write_text(DOCKERFILE.format(version("distributed")))
    for target, image, file in steps:
        stage = ("--target", target) if target else ()
        command = ("docker", "build", "-f", file, *stage, "-t", image, ".")
        built = call(*command, cwd=folder, timeout=BUILD_S)
        if built.returncode and not pip_works_in_containers():
            pytest.skip("containers cannot reach a package index to build an image")
        assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    (folder / "docker-compose.yml").write_text(COMPOSE)
    (folder / "out").mkdir()
    return folder


@contextmanager
def composed(folder: Path) -> Iterator[list[str]]:
    """A scheduler and its workers, under a unique project name."""
    compose = ["docker-compose", "-p", f"convoy-test-{uuid4().hex[:8]}"]
    try:
        up = call(*compose, "up", "-d", cwd=folder, timeout=DRIVE_S)
        assert up.returncode == 0, up.stderr
        yield compose
    finally:
        with suppress(TimeoutError):
            call(*compose, "down", "--timeout", "5", cwd=folder, timeout=DRIVE_S)


def sweep(out: str, *options: str) -> list[str]:
    return [
        *("convoy", "sweep", "lane_change", f"--seeds={SEEDS}"),
        *(f"--set={text}" for text in SETS),
        *(f"--vary={text}" for text in VARY),
        *(f"--metric={text}" for text in METRICS),
        *(f"--limit={text}" for text in LIMITS),
        f"--out=/out/{out}",
        *options,
    ]


def tables(folder: Path, out: str) -> dict[str, bytes]:
    return {name: (folder / "out" / out / name).read_bytes() for name in TABLES}


def wait_for(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + DRIVE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.long
def test_two_workers_in_containers_write_the_tables_of_a_pool(folder: Path) -> None:
    with composed(folder) as compose:
        inside = [*compose, "exec", "-T", "scheduler"]
        at = ("--scheduler", "tcp://scheduler:8786")
        for out, options in (("pool", ("--workers", "2")), ("dask", at)):
            done = call(*inside, *sweep(out, *options), cwd=folder, timeout=DRIVE_S)
            assert done.returncode == 0, done.stderr
        detached = [*compose, "exec", "-d", "scheduler", *sweep("killed", *at)]
        assert call(*detached, cwd=folder).returncode == 0
        journal = folder / "out" / "killed" / "journal.jsonl"
        wait_for(lambda: journal.exists() and journal.read_bytes().count(b"\n") > 3)
        assert call(*compose, "kill", "-s", "SIGKILL", "other", cwd=folder).returncode == 0
        left = RUNS + 1 - journal.read_bytes().count(b"\n")
        assert left > 0, "no run was left when the worker was killed"
        wait_for((folder / "out" / "killed" / "sweep.json").exists)
    print(f"{left} of {RUNS} runs were left when a worker was killed")
    assert tables(folder, "dask") == tables(folder, "pool")
    assert tables(folder, "killed") == tables(folder, "pool")
