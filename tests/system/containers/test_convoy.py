"""The default scenario in six containers, built from the Dockerfile: router, cars, recorder."""

import os
import re
import socket
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

import pytest

from scenarios.definition.scenario import library
from tests.made.once import first_only, shared
from tests.system.conftest import DURATION_S, Driven
from tests.system.containers.images import (
    BUILD_S,
    IMAGE,
    VEHICLE_IMAGE,
    call,
    copy_parts,
    missing_requirement,
    pip_works_in_containers,
)
from tests.system.logs import (
    Run,
    agreement,
    assert_equal_while_nothing_was_late,
    assert_nothing_missing,
    assert_sound,
    assert_summary_is_in_the_log,
)
from tests.system.processes import until

PORT_NAMES = ("CONVOY_PAGE_PORT", "CONVOY_DATA_PORT")
USER = 4711
"""A user other than root."""
SHORT = f"--set=duration_s={DURATION_S:g}"
DRIVE_S = 300.0
"""Time limit of start and run on a busy machine."""


def free_ports() -> dict[str, int]:
    """Free ports for the page and its data; another test may use the default ones."""
    with socket.socket() as page, socket.socket() as data:
        for probe in (page, data):
            probe.bind(("127.0.0.1", 0))
        return dict(zip(PORT_NAMES, (s.getsockname()[1] for s in (page, data)), strict=True))


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the build context, with its image built."""
    folder = shared(tmp_path_factory) / "project"
    with first_only(folder) as first:
        reason = missing_requirement() if first else None
        if reason:
            pytest.skip(reason)
        if first:
            copy_parts(folder)
            built = call("docker", "build", "-t", IMAGE, ".", cwd=folder, timeout=BUILD_S)
            if built.returncode and not pip_works_in_containers():
                pytest.skip("containers cannot reach a package index to build an image")
            assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    return folder


@contextmanager
def composed(
    folder: Path, ports: dict[str, int]
) -> Iterator[tuple["subprocess.Popen[bytes]", str]]:
    """`docker-compose up` under a unique project name; taken down on exit."""
    name = f"convoy-test-{uuid4().hex[:8]}"
    compose = ["docker-compose", "-p", name]
    with (folder / "up.log").open("wb") as log:
        up = subprocess.Popen(
            [*compose, "up", "--build", "--exit-code-from", "recorder"],
            cwd=folder,
            env=os.environ
            | {name: str(port) for name, port in ports.items()}
            | {"CONVOY_SCENARIO": f"lane_change {SHORT}"},
            stdout=log,
            stderr=subprocess.STDOUT,
        )
    try:
        yield up, name
    finally:
        with suppress(subprocess.TimeoutExpired):
            call(*compose, "down", "--timeout", "5", cwd=folder, timeout=DRIVE_S)
        up.kill()
        up.wait()


def published(name: str) -> list[str]:
    """Addresses of the host at which ports of the containers are published."""
    shown = call("docker", "ps", "--filter", f"name={name}", "--format", "{{.Ports}}").stdout
    return re.findall(r"(\S+)->", shown)


def containers(name: str) -> list[str]:
    """Names of the running containers."""
    shown = call("docker", "ps", "--filter", f"name={name}", "--format", "{{.Names}}").stdout
    return sorted(re.sub(rf"^{name}[-_](.*)[-_]1$", r"\1", line) for line in shown.split())


def page_is_served(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5.0) as page:
            return bool(page.status == 200)
    except OSError:
        return False


def change_owner(project: Path) -> int:
    """Give the project to a user other than root, if permitted; return the user id."""
    if os.geteuid():
        return os.geteuid()
    os.chown(project / "docker-compose.yml", USER, USER)
    return USER


@pytest.mark.long
def test_six_containers_run_the_default_scenario(project: Path, lane_change: Driven) -> None:
    user = change_owner(project)
    ports = free_ports()
    page = ports["CONVOY_PAGE_PORT"]
    with composed(project, ports) as (up, name):
        output = project / "up.log"
        assert until(lambda: page_is_served(page) or up.poll() is not None, DRIVE_S)
        assert up.poll() is None, output.read_text()
        assert containers(name) == ["recorder", "router", "v1", "v2", "v3", "v4"]
        assert sorted(published(name)) == sorted(f"127.0.0.1:{port}" for port in ports.values())
        assert up.wait(DRIVE_S) == 0, output.read_text()
        assert f"http://127.0.0.1:{page}/?url=" in output.read_text()
        assert not containers(name)
    assert not call("docker", "ps", "-a", "-q", "--filter", f"name={name}").stdout
    (folder,) = (project / "runs").iterdir()  # created by Docker
    for path in (folder.parent, folder, *folder.iterdir()):
        assert path.stat().st_uid == user, path
    assert re.fullmatch(r"\d{8}-\d{6}-lane_change-duration_s=8", folder.name)
    run = Run(folder)
    assert_sound(run.log)
    assert_nothing_missing(run, DURATION_S)
    assert_summary_is_in_the_log(run)
    assert run.summary["outcome"] == "completed"
    assert_drives_as_in_virtual_time(run, lane_change.virtual)


def assert_drives_as_in_virtual_time(run: Run, virtual: Run) -> None:
    """Compare true poses with those of a virtual run outside of containers."""
    found = agreement(run, virtual)
    print(f"{found.equal} of {found.compared} true poses are equal to the bit;", end=" ")
    print(f"farthest {found.distance_m_max * 100:.3f} cm,", end=" ")
    print(f"late: {run.late_ticks} ticks, {len(run.late_messages_at)} messages")
    assert found.compared == 4 * DURATION_S * 50
    assert_equal_while_nothing_was_late(run, virtual, within_m=0.05)


def test_the_vehicle_image_lacks_the_extras(project: Path) -> None:
    build = ("docker", "build", "--target", "vehicle", "-t", VEHICLE_IMAGE, ".")
    built = call(*build, cwd=project, timeout=BUILD_S)
    assert built.returncode == 0, built.stdout[-2000:] + built.stderr[-2000:]
    refused = call("docker", "run", "--rm", VEHICLE_IMAGE, "run", "--serve")
    assert refused.returncode == 2
    needs = "needs rerun, not installed here: pip install 'convoy-emulator[viewer]'"
    assert refused.stderr == f"error: --serve: {needs}\n"
    sizes = [
        int(call("docker", "image", "inspect", "-f", "{{.Size}}", image).stdout)
        for image in (VEHICLE_IMAGE, IMAGE)
    ]
    assert sizes[0] < 0.6 * sizes[1]


@pytest.mark.usefixtures("project")
def test_the_image_runs_commands_of_convoy() -> None:
    listed = call("docker", "run", "--rm", IMAGE, "list")
    assert listed.returncode == 0, listed.stderr
    scenarios, _ = listed.stdout.split("\n\n", 1)  # scenarios, then channels
    assert [line.split()[0] for line in scenarios.splitlines()[1:]] == list(library())
    refused = call("docker", "run", "--rm", IMAGE, "run", "nowhere")
    assert refused.returncode == 2
    assert "nowhere" in refused.stderr
