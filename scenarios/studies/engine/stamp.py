"""Software versions of a process, so that results of different versions are not mixed."""

import hashlib
import platform
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

import scenarios
import transport
import vehicles

HASHED_SUFFIXES = {".py", ".toml", ".csv"}
"""Suffixes of files that a run depends on: code, library scenarios, traces."""
DIGITS = 12
"""Digits of the digest: 48 bits, enough against mistakes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramStamp:
    """Versions that results may depend on; `sources` is a digest of the three packages."""

    convoy: str
    sources: str
    python: str
    numpy: str

    def differences(self, there: "ProgramStamp") -> list[str]:
        """Describe each difference from the stamp of another process."""
        ours = asdict(self)
        return [
            f"{name} is {value} there and {ours[name]} here"
            for name, value in asdict(there).items()
            if value != ours[name]
        ]


@cache
def current_stamp() -> ProgramStamp:
    return ProgramStamp(
        convoy=version("convoy-emulator"),
        sources=digest_of(*(Path(package.__path__[0]) for package in PACKAGES)),
        python=platform.python_version(),
        numpy=np.__version__,
    )


PACKAGES = (vehicles, transport, scenarios)


def digest_of(*packages: Path) -> str:
    """Digest of the packages' files, independent of where they are installed."""
    digest = hashlib.sha256()
    for package in packages:
        files = (
            path for path in package.rglob("*") if path.suffix in HASHED_SUFFIXES and path.is_file()
        )
        for name, path in sorted((path.relative_to(package).as_posix(), path) for path in files):
            content = hashlib.sha256(path.read_bytes()).hexdigest()
            digest.update(f"{package.name}/{name} {content}\n".encode())
    return digest.hexdigest()[:DIGITS]
