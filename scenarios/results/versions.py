"""Identity of the program: versions, and digests of its sources and of the user's classes.

The log and the summary contain them. Processes of a run and workers of a study compare them.
"""

import ast
import hashlib
import platform
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import version
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
"""Suffixes of files that a run depends on: code, library scenarios, traces. Compiled installations
ship the sources, too."""
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
    """Digest of the module of each user-defined class, by the module's name.

    `plug_ins` are dotted names of classes; shipped ones are part of the program's sources.
    """
    modules = {name.rpartition(".")[0] for name in plug_ins}
    return module_digests(name for name in sorted(modules) if _top(name) not in OWN_NAMES)


def module_digests(modules: Iterable[str]) -> Mapping[str, str]:
    """Digests of a user's modules, with the modules next to them that they import."""
    return {name: _module_digest(name) for name in modules}


@cache
def _module_digest(module: str) -> str:
    """Digest of a module and of the modules next to it that it imports, also indirectly."""
    sources: dict[str, bytes] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in sources or not _is_near(_top(name), _top(module)):
            continue
        if (path := _file_of(name)) is not None:
            sources[name] = path.read_bytes()
            waiting += _imports_of(sources[name], name, is_package=path.stem == "__init__")
    digest = hashlib.sha256()
    for name, content in sorted(sources.items()):
        digest.update(f"{name} {hashlib.sha256(content).hexdigest()}\n".encode())
    return digest.hexdigest()[:DIGITS]


def _top(module: str) -> str:
    return module.partition(".")[0]


def _is_near(package: str, users: str) -> bool:
    """Whether a top-level module belongs to that of the user's class: itself, or in its folder.

    In a folder of installed packages the others are not the user's.
    """
    if package == users:
        return True
    folder = _folder_of(users)
    installed = {Path(sysconfig.get_path(place)) for place in ("stdlib", "purelib", "platlib")}
    is_users = folder is not None and folder not in installed and package not in OWN_NAMES
    return is_users and _folder_of(package) == folder


def _folder_of(package: str) -> Path | None:
    """Folder from which a top-level module is imported."""
    spec = _spec_of(package)
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))).parent
    return Path(spec.origin).parent if spec.has_location and spec.origin else None


def _file_of(module: str) -> Path | None:
    """File of a module that can be imported; None for one without."""
    spec = _spec_of(module)
    return Path(spec.origin) if spec and spec.has_location and spec.origin else None


def _spec_of(module: str) -> ModuleSpec | None:
    """Find a module on the path, without importing it or its packages."""
    names, path = module.split("."), None
    spec = None
    for count in range(1, len(names) + 1):
        spec = PathFinder.find_spec(".".join(names[:count]), path)
        path = spec.submodule_search_locations if spec else None
        if spec is None or (path is None and count < len(names)):
            return None
    return spec


def _imports_of(source: bytes, module: str, *, is_package: bool) -> Iterator[str]:
    """Names of modules that a source may import; some are names within modules."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):  # a compiled extension
        return
    parts = module.split(".")
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = parts[: len(parts) - node.level + is_package] if node.level else []
            name = ".".join([*base, *([node.module] if node.module else [])])
            if name:
                yield name
                yield from (f"{name}.{alias.name}" for alias in node.names if alias.name != "*")
