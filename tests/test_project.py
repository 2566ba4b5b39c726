"""Rules of the project: size, folders, dependencies, imports and language."""

import ast
import fnmatch
import importlib
import importlib.metadata
import importlib.util
import json
import re
import runpy
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import grimp
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
PACKAGES = ("vehicles", "transport", "scenarios")
TOP_LEVEL = {
    *PACKAGES, "tests",
    "pyproject.toml", "setup.py", "requirements.lock", "requirements-container.lock",
    "CHANGELOG.md", "CITATION.cff",
    "README.md", "LICENSE", "docker-compose.yml", "Dockerfile", ".dockerignore", ".gitignore",
    ".ci",
}  # fmt: skip
GENERATED = {"transport/convoy_pb2.py"}
PURE = {
    "abc", "array", "bisect", "cmath", "collections", "copy", "dataclasses", "enum", "fractions",
    "functools", "heapq", "importlib", "itertools", "math", "numpy", "pymap3d", "scipy", "struct",
    "typing",
}  # fmt: skip
PARENTS = {"zstandard": "mcap", "pydantic-core": "pydantic"}
"""Indirect dependencies that are imported, with the dependency that requires them."""


# ---- Folders and files


def test_the_top_level_has_only_listed_entries() -> None:
    ignored = [line.strip("/") for line in (ROOT / ".gitignore").read_text().split()]
    entries = {
        path.name
        for path in ROOT.iterdir()
        if path.name != ".git" and not any(fnmatch.fnmatch(path.name, name) for name in ignored)
    }
    assert entries == TOP_LEVEL


def test_every_folder_with_tests_is_a_package() -> None:
    """Without an `__init__.py`, `tests/vehicles` would shadow the real package."""
    folders = {path.parent for path in (ROOT / "tests").rglob("*.py")}
    assert {folder.name for folder in folders} >= {"tests", *PACKAGES}
    for folder in folders:
        assert (folder / "__init__.py").exists(), folder


def sources() -> list[Path]:
    return sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))


MODULES = [name for path in sources() if (name := str(path.relative_to(ROOT))) not in GENERATED]


def test_class_names_are_unique() -> None:
    modules: dict[str, list[str]] = {}
    for name in MODULES:
        for node in ast.parse((ROOT / name).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                modules.setdefault(node.name, []).append(name)
    assert {name: places for name, places in modules.items() if len(places) > 1} == {}


def test_tests_do_not_import_each_other() -> None:
    """Shared helpers are in tests/made."""
    for path in (ROOT / "tests").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"^\s*(from|import) tests\.(\w+\.)*test_", text, re.MULTILINE), path


def test_all_files_of_the_packages_are_distributed(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = setup_values(monkeypatch)["LAYOUT"]
    modules = (path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))
    expected = {".".join(path.parent.relative_to(ROOT).parts) for path in modules}
    assert set(layout["packages"]) == {*expected, "convoy"}
    assert layout["package_dir"] == {"convoy": "scenarios/api"}
    package_data = load_project()["tool"]["setuptools"]["package-data"]
    for path in (path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file()):
        package, inside = path.relative_to(ROOT).parts[0], Path(*path.relative_to(ROOT).parts[1:])
        if path.suffix in {".py", ".pyi", ".pyc"}:
            assert "__pycache__" in inside.parts or (path.parent / "__init__.py").exists(), path
        else:
            patterns = [*package_data.get(package, []), *package_data["*"]]
            of_package = [path.name] if (path.parent / "__init__.py").exists() else []
            matching = [fnmatch.filter([str(inside), *of_package], text) for text in patterns]
            assert any(matching), path


# ---- Size


ROOMS = {
    "scenarios": 10,
    "scenarios/api": 750,
    "scenarios/cli": 5_300,
    "scenarios/definition": 12_560,
    "scenarios/results": 6_790,
    "scenarios/runs": 6_670,
    "scenarios/studies": 9_000,
    "transport": 1_160,
    "transport/bus": 780,
    "transport/links": 4_330,
    "transport/log": 1_300,
    "transport/picture": 1_650,
    "vehicles": 630,
    "vehicles/car": 2_800,
    "vehicles/driver": 4_700,
    "vehicles/geometry": 1_550,
    "vehicles/preview": 1_630,
    "vehicles/theory": 1_060,
}
"""Ceiling of each room in lines. A feature raises it only in a commit that says so."""
PRODUCT_MAX, TESTS_MAX, MODULES_MAX = 62_600, 53_680, 313
"""Lines of the product and of the tests, and modules of the product, `__init__` included."""
LOADED_MAX, CALLS_MAX = 550, 400
"""Own modules that a virtual run loads, and own Python calls of its busiest follower in a control
tick, on average."""


def lines_of(paths: Iterable[Path]) -> int:
    return sum(path.read_text(encoding="utf-8").count("\n") for path in paths)


def rooms() -> dict[str, list[str]]:
    """Modules by room: the first two folders of their path."""
    found: dict[str, list[str]] = {}
    for name in MODULES:
        found.setdefault("/".join(Path(name).parts[:-1][:2]), []).append(name)
    return found


def test_no_room_is_larger_than_its_ceiling() -> None:
    sizes = {room: lines_of(ROOT / name for name in names) for room, names in rooms().items()}
    assert sizes.keys() == ROOMS.keys()
    assert {room: size for room, size in sizes.items() if size > ROOMS[room]} == {}


def test_the_whole_is_not_larger_than_its_ceilings() -> None:
    assert lines_of(ROOT / name for name in MODULES) <= PRODUCT_MAX
    assert lines_of((ROOT / "tests").rglob("*.py")) <= TESTS_MAX
    assert len(MODULES) <= MODULES_MAX


COUNTED_RUN = """
import json, os, sys
from scenarios.definition.scenario import load_scenario
from scenarios.runs.node.phases import Driving
from scenarios.runs.virtual import run_unlogged

root, calls = os.getcwd() + os.sep, {}

def count(frame, event, _):
    if event == "call" and frame.f_code.co_filename.startswith(root):
        calls[node][-1] += 1

step = Driving.step

def counted(self, now):
    global node
    node = id(self)
    calls.setdefault(node, []).append(0)
    sys.setprofile(count)
    try:
        return step(self, now)
    finally:
        sys.setprofile(None)

Driving.step = counted
run_unlogged(load_scenario("lane_change", ["duration_s=4"], 1))
files = (getattr(module, "__file__", None) or "" for module in list(sys.modules.values()))
print(json.dumps([
    sum(name.startswith(root) for name in files),
    max(sum(each) / len(each) for each in calls.values()),
]))
"""


def test_a_virtual_run_is_no_larger_than_its_ceilings() -> None:
    command = [sys.executable, "-c", COUNTED_RUN]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    loaded, calls = json.loads(done.stdout)
    assert loaded <= LOADED_MAX
    assert calls <= CALLS_MAX


def setup_values(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Global names of setup.py."""
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    monkeypatch.chdir(ROOT)
    return runpy.run_path("setup.py")


# ---- Dependencies


def load_project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def names(requirements: Iterable[str]) -> set[str]:
    return {canonicalize_name(Requirement(line).name) for line in requirements}


EXTRAS = ("viewer", "studies")
"""Extras of a developer, which containers of vehicles lack."""
UNLOCKED_EXTRAS = ("dask", "tables", "pandas", "polars")
"""Extras in no lock, installed only on request."""
LOCKS = {"requirements.lock": EXTRAS, "requirements-container.lock": ()}
"""Locks with their extras."""


def requirements(extras: Iterable[str]) -> list[str]:
    """Requirements of the project with these extras."""
    project = load_project()["project"]
    optional = project["optional-dependencies"]
    return [*project["dependencies"], *(line for extra in extras for line in optional[extra])]


def locked(lock: str = "requirements.lock") -> list[tuple[Requirement, list[str]]]:
    """Each requirement of a lock with its hashes."""
    text = re.sub(r"#.*", "", (ROOT / lock).read_text(encoding="utf-8"))
    entries = [line.split() for line in text.replace("\\\n", " ").splitlines() if line.strip()]
    return [
        (
            Requirement(" ".join(word for word in words if not word.startswith("--"))),
            [word for word in words if word.startswith("--hash=")],
        )
        for words in entries
    ]


@pytest.mark.parametrize("lock", LOCKS)
def test_dependencies_are_locked_to_allowed_versions(lock: str) -> None:
    pinned: dict[str, list[str]] = {}
    for requirement, _ in locked(lock):
        (pin,) = requirement.specifier
        assert pin.operator == "==", requirement
        pinned.setdefault(canonicalize_name(requirement.name), []).append(pin.version)
    for line in requirements(LOCKS[lock]):
        allowed = Requirement(line)
        versions = pinned.get(canonicalize_name(allowed.name), [])
        assert versions, f"{allowed.name} is not locked"
        assert all(allowed.specifier.contains(version) for version in versions), line


def test_the_container_lock_has_the_same_versions_without_extras() -> None:
    full = {str(requirement): hashes for requirement, hashes in locked()}
    container = {str(line): hashes for line, hashes in locked("requirements-container.lock")}
    assert container.items() < full.items()
    extras = names(requirements(EXTRAS)) - names(requirements(()))
    assert extras == {"rerun-sdk", "scipy"}
    assert not extras & names(container)


def test_the_extra_for_development_includes_the_others() -> None:
    expected = f"convoy-emulator[{','.join(EXTRAS)}]"
    assert expected in load_project()["project"]["optional-dependencies"]["dev"]


@pytest.mark.parametrize("lock", LOCKS)
def test_every_locked_file_has_a_hash(lock: str) -> None:
    for requirement, hashes in locked(lock):
        assert hashes, requirement
        for text in hashes:
            assert re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", text), requirement


@pytest.mark.parametrize("lock", LOCKS)
def test_the_lock_names_no_package_index(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    for word in ("://", "--index-url", "--extra-index-url", "--find-links", "--trusted-host"):
        assert word not in text


@pytest.mark.parametrize("lock", LOCKS)
def test_locked_dependencies_are_complete(lock: str) -> None:
    """Requirements of locked packages on this platform are locked, too."""
    locked_names = {
        canonicalize_name(r.name)
        for r, _ in locked(lock)
        if r.marker is None or r.marker.evaluate()
    }
    for name in sorted(locked_names):
        for line in importlib.metadata.requires(name) or []:
            needed = Requirement(line)
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                assert canonicalize_name(needed.name) in locked_names, f"{name} needs {needed}"


# ---- Imports


@cache
def graph() -> grimp.ImportGraph:
    return grimp.build_graph(*PACKAGES, include_external_packages=True, cache_dir=None)


def imported_by(package: str) -> dict[str, list[str]]:
    """Imports of `package` from other packages, with the importing modules."""
    imports: dict[str, list[str]] = {}
    for module in graph().modules:
        if module.split(".")[0] == package:
            for name in graph().find_modules_directly_imported_by(module):
                if name.split(".")[0] != package:
                    imports.setdefault(name, []).append(module)
    return imports


def test_vehicles_import_only_pure_packages() -> None:
    assert set(imported_by("vehicles")) <= PURE


def test_messages_import_nothing_of_the_project() -> None:
    assert graph().find_modules_directly_imported_by("vehicles.messages") <= {
        "dataclasses",
        "typing",
    }


def test_only_the_analysis_imports_scipy() -> None:
    analysis = {
        "vehicles.theory.gain_sets",
        "vehicles.theory.varying_speed",
        "vehicles.theory.string_stability",
    }
    assert set(imported_by("vehicles")["scipy"]) <= analysis


def test_imported_packages_are_declared_dependencies() -> None:
    declared = names(requirements((*EXTRAS, *UNLOCKED_EXTRAS)))
    distributions = importlib.metadata.packages_distributions()
    for package in PACKAGES:
        for name in imported_by(package):
            if name in sys.stdlib_module_names or name.split(".")[0] in PACKAGES:
                continue
            candidates = {canonicalize_name(dist) for dist in distributions.get(name, [name])}
            parents = {PARENTS.get(candidate, candidate) for candidate in candidates}
            assert parents & declared, f"{package} imports {name}"
    for name, parent in PARENTS.items():
        assert name in names(importlib.metadata.requires(parent) or [])


def modules_after(statement: str) -> Sequence[str]:
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()


HEAVY = {"scipy", "rich", "rerun", "mcap", "matplotlib", "pandas", "pyarrow", "zstandard", "pyproj"}


def test_vehicle_processes_load_no_heavy_packages() -> None:
    """Each takes megabytes of the 80 of a process."""
    drive = """
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.sink import BusSink
from scenarios.definition.scenario import load_scenario
from transport.bus.bus import MemoryBus
import scenarios.cli.main, scenarios.runs.processes.vehicle_process
for scenario in ("lane_change", "church_lot", "highway"):
    builder = VehicleBuilder(load_scenario(scenario, ["duration_s=0.2"]), "v2")
    node = builder.node(0, BusSink("v2", MemoryBus()), NoProbe())
    for tick in builder.ticks(0):
        node.step(tick)
"""
    loaded = {name.split(".")[0] for name in modules_after(drive)}
    assert {"zenoh", "numpy", "pydantic"} <= loaded
    assert not HEAVY & loaded


# ---- Language


DIALECT = re.compile(r"\b(foretold|anew|whoever|so many|told|heard|believed)\b", re.IGNORECASE)
OLD_KEYS = {("scenarios/results/summary.py", "heard")}
"""Words in files that name keys of earlier versions."""


def test_texts_avoid_dialect_words() -> None:
    """Messages are received, not heard; values are estimated, not believed."""
    texts = {".md", ".proto", ".py", ".pyi", ".toml", ".txt"}
    paths = [path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.suffix in texts]
    words = {
        (str(path.relative_to(ROOT)), word.lower())
        for path in [*paths, ROOT / "README.md"]
        for word in DIALECT.findall(path.read_text(encoding="utf-8"))
    }
    assert words <= OLD_KEYS


def test_the_image_gets_all_that_a_wheel_is_built_from() -> None:
    kept = (ROOT / ".dockerignore").read_text().splitlines()
    needed = ("pyproject.toml", "setup.py", "README.md", "LICENSE", *PACKAGES)
    assert [name for name in needed if f"!{name}" not in kept] == []
