"""What containers are made of, whether they can be made here, and what is asked of the engine."""

import shutil
import subprocess
from pathlib import Path

PROJECT = Path(__file__).parents[3]
PARTS = (
    *("Dockerfile", "docker-compose.yml", ".dockerignore"),
    *("requirements.lock", "requirements-container.lock"),
    *("pyproject.toml", "README.md", "LICENSE", "vehicles", "transport", "scenarios"),
)
"""What the image and its composition are made of."""
IMAGE = "convoy-emulator"
VEHICLE_IMAGE = "convoy-emulator-vehicle"
BASE = "python:3.11-slim-bookworm"
BUILD_S = 900.0


def obstacle() -> str | None:
    """Say why containers cannot be tried here, if they cannot."""
    for tool in ("docker", "docker-compose"):
        if shutil.which(tool) is None:
            return f"no {tool} here"
    if call("docker", "info").returncode:
        return "no container engine runs here"
    if call("docker", "image", "inspect", BASE).returncode:
        return f"the base image {BASE} is not here (docker pull {BASE})"
    return None


def call(
    *command: str, cwd: Path | None = None, timeout: float = 60.0
) -> "subprocess.CompletedProcess[str]":
    """Run a command and keep what it says."""
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=timeout, check=False
    )


def container_reaches_packages() -> bool:
    """Say whether pip can fetch something from inside a container of the base image."""
    fetch = ("python3", "-m", "pip", "download", "-q", "--no-deps", "--dest", "/tmp", "click")
    return call("docker", "run", "--rm", BASE, *fetch, timeout=BUILD_S).returncode == 0


def copy_parts(folder: Path) -> None:
    """Copy what the image is made of."""
    for part in PARTS:
        source = PROJECT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / part)
