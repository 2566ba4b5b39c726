"""Build context of the container images, and calls of the container engine."""

import shutil
import subprocess
from pathlib import Path

PROJECT = Path(__file__).parents[3]
IGNORED = ".dockerignore"
PARTS = (
    *("Dockerfile", "docker-compose.yml", IGNORED),
    *(line[1:] for line in (PROJECT / IGNORED).read_text().splitlines() if line.startswith("!")),
)
"""Build context of the image."""
IMAGE = "convoy-emulator"
VEHICLE_IMAGE = "convoy-emulator-vehicle"
BASE = "python:3.11-slim-bookworm"
BUILD_S = 900.0


def missing_requirement() -> str | None:
    """The reason why containers cannot run here, if any."""
    for tool in ("docker", "docker-compose"):
        if shutil.which(tool) is None:
            return f"{tool} is not installed"
    if call("docker", "info").returncode:
        return "no container engine is running"
    if call("docker", "image", "inspect", BASE).returncode:
        return f"the base image {BASE} is missing (docker pull {BASE})"
    return None


def call(
    *command: str, cwd: Path | None = None, timeout: float = 60.0
) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=timeout, check=False
    )


def pip_works_in_containers() -> bool:
    """Whether pip in a container of the base image can download packages."""
    fetch = ("python3", "-m", "pip", "download", "-q", "--no-deps", "--dest", "/tmp", "click")
    return call("docker", "run", "--rm", BASE, *fetch, timeout=BUILD_S).returncode == 0


def copy_parts(folder: Path) -> None:
    for part in PARTS:
        source = PROJECT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / part)
