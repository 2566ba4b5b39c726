"""Identity of the program: versions, and digests of its sources and of the user's classes.

The log and the summary contain them. Processes of a run and workers of a study compare them.
"""

import hashlib
import platform
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

import scenarios
import transport
import vehicles

PACKAGES = ("convoy-emulator", "eclipse-zenoh", "mcap", "numpy", "protobuf", "pymap3d")
"""Packages whose versions are written into the log."""
OWN = (vehicles, transport, scenarios)
OWN_NAMES = {package.__name__ for package in OWN}
HASHED_SUFFIXES = {".py", ".toml", ".csv"}
"""Suffixes of files that a run depends on: code, library scenarios, traces."""
DIGITS = 12
"""Digits of a digest: 48 bits, enough to detect accidental differences."""


@cache
def installed_versions() -> Mapping[str, str]:
    """Versions of Python and of PACKAGES; cached, because reading takes milliseconds."""
    versions = {"python": platform.python_version()}
    return MappingProxyType(versions | {package: version(package) for package in PACKAGES})


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
    """Stamp of this process; cached, because 500 files are read in 30 ms."""
    versions = installed_versions()
    return ProgramStamp(
        convoy=versions["convoy-emulator"],
        sources=digest_of(*(Path(package.__path__[0]) for package in OWN)),
        python=versions["python"],
        numpy=versions["numpy"],
    )


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


def plug_in_digests(plug_ins: Iterable[str]) -> Mapping[str, str]:
    """Digest of the file of each user-defined class, by the name of its module.

    `plug_ins` are dotted names of classes; shipped ones are part of the program's sources. Modules
    that a user's module imports are not included.
    """
    modules = {name.rpartition(".")[0] for name in plug_ins}
    own = (name for name in sorted(modules) if name.partition(".")[0] not in OWN_NAMES)
    return module_digests(own)


def module_digests(modules: Iterable[str]) -> Mapping[str, str]:
    """Digests of the files of a user's modules; empty for a module without a file."""
    return {name: _module_digest(name) for name in modules}


@cache
def _module_digest(module: str) -> str:
    try:
        spec = find_spec(module)
    except ImportError:
        return ""
    if spec is None or not spec.has_location or spec.origin is None:
        return ""
    return hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:DIGITS]
