"""The project as a whole: its checks, its folders, its imports and its dependencies."""

import ast
import dataclasses
import fnmatch
import importlib
import importlib.metadata
import importlib.util
import inspect
import re
import runpy
import subprocess
import sys
import tomllib
import warnings
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import grimp
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.made.interpreted import interpreted_only

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
MOST_STATEMENTS = 40
"""Of a function."""
MOST_MODULES = 12
"""Of a folder."""
LONG_MODULE = 350
"""Lines of a module that deserve a look."""
PURE = {
    "abc", "array", "bisect", "collections", "copy", "dataclasses", "enum", "fractions",
    "functools",
    "heapq", "importlib", "itertools", "math", "numpy", "pymap3d", "scipy", "struct", "typing",
}  # fmt: skip
COMES_WITH = {"zstandard": "mcap", "pydantic-core": "pydantic"}
"""Packages that one of our dependencies cannot do without."""


# ---- Folders and files


def test_the_top_level_holds_what_it_should_and_nothing_else() -> None:
    ignored = [line.strip("/") for line in (ROOT / ".gitignore").read_text().split()]
    found = {
        path.name
        for path in ROOT.iterdir()
        if path.name != ".git" and not any(fnmatch.fnmatch(path.name, name) for name in ignored)
    }
    assert found == TOP_LEVEL


def test_every_folder_with_tests_is_a_package() -> None:
    """Without an `__init__.py`, `tests/vehicles` would stand before the real package."""
    folders = {path.parent for path in (ROOT / "tests").rglob("*.py")}
    assert {folder.name for folder in folders} >= {"tests", *PACKAGES}
    for folder in folders:
        assert (folder / "__init__.py").exists(), folder


def sources() -> list[Path]:
    return sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py"))


MODULES = [name for path in sources() if (name := str(path.relative_to(ROOT))) not in GENERATED]


def statements(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Statements of a function but its docstring, those of functions inside it included."""
    inside = sum(isinstance(node, ast.stmt) for node in ast.walk(function)) - 1
    return inside - (ast.get_docstring(function) is not None)


def test_functions_are_short() -> None:
    """Long modules are only warned of: no number tells whether a module is one subject."""
    long_functions = []
    for name in MODULES:
        text = (ROOT / name).read_text(encoding="utf-8")
        long_functions += [
            f"{name}:{node.lineno} {node.name}"
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            and statements(node) > MOST_STATEMENTS
        ]
        if text.count("\n") > LONG_MODULE:
            warnings.warn(f"{name} has {text.count(chr(10))} lines: one subject?", stacklevel=1)
    assert long_functions == []


def folders() -> list[Path]:
    """Folders with modules, of the packages and of the tests."""
    found = {path.parent for name in (*PACKAGES, "tests") for path in (ROOT / name).rglob("*.py")}
    return sorted(folder for folder in found if "__pycache__" not in folder.parts)


def test_folders_hold_few_modules() -> None:
    """Modules of a folder, its `__init__` apart."""
    counts = {folder: len([*folder.glob("*.py")]) - 1 for folder in folders()}
    assert {folder: count for folder, count in counts.items() if count > MOST_MODULES} == {}


def map_errors(folder: Path) -> set[str]:
    """Rooms and modules that only the folder or only its map names; "no map" without one."""
    text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
    if not text:
        return {"no map"}
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__", "__main__", "convoy_pb2"}
    inside = (path for path in folder.iterdir() if path.is_dir() and path.name != "__pycache__")
    rooms = {path.name for path in inside if {*path.iterdir()} - {path / "__pycache__"}}
    named = set(re.findall(r"^(\w+)/? {2,}\S", text, flags=re.MULTILINE))
    return named ^ (modules | rooms)


def test_the_map_of_a_folder_names_its_contents() -> None:
    """Every room and module of a folder stands in its `__init__`, and nothing else does."""
    product = [folder for folder in folders() if folder.relative_to(ROOT).parts[0] != "tests"]
    assert {folder: wrong for folder in product if (wrong := map_errors(folder))} == {}


def test_a_class_s_name_stands_for_one_thing() -> None:
    found: dict[str, list[str]] = {}
    for name in MODULES:
        for node in ast.parse((ROOT / name).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(name)
    assert {name: where for name, where in found.items() if len(where) > 1} == {}


def test_no_test_imports_another_one() -> None:
    """What several tests use is in tests/made."""
    for path in (ROOT / "tests").rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"^\s*(from|import) tests\.(\w+\.)*test_", text, re.MULTILINE), path


def test_everything_that_ships_is_in_the_distribution() -> None:
    project = load_project()
    wanted = project["tool"]["setuptools"]["packages"]["find"]["include"]
    assert sorted(wanted) == sorted(f"{name}*" for name in PACKAGES)
    shipped = project["tool"]["setuptools"]["package-data"]
    for path in (path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file()):
        package, inside = path.relative_to(ROOT).parts[0], Path(*path.relative_to(ROOT).parts[1:])
        if path.suffix == ".so":  # was compiled in place
            continue
        if path.suffix in {".py", ".pyi", ".pyc"}:
            assert "__pycache__" in inside.parts or (path.parent / "__init__.py").exists(), path
        else:
            patterns = [*shipped.get(package, []), *shipped["*"]]
            assert any(fnmatch.fnmatch(str(inside), pattern) for pattern in patterns), path


# ---- What can be compiled


def compiled_modules(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Paths of the modules that setup.py compiles where it is asked to."""
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    monkeypatch.chdir(ROOT)
    found: list[str] = runpy.run_path("setup.py")["compiled"]()
    return found


def test_compiled_modules_calculate_as_interpreted_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """See setup.py."""
    modules = compiled_modules(monkeypatch)
    assert {"vehicles/geometry/arc_spline.py", "scenarios/results/metrics.py"} < set(modules)
    for name in modules:
        tree = ast.parse((ROOT / name).read_text(encoding="utf-8"))
        for one in ast.walk(tree):
            if isinstance(one, ast.Call) and ast.unparse(one.func) == "sum":
                assert not isinstance(one.args[0], ast.GeneratorExp), f"{name}:{one.lineno}"
            if isinstance(one, ast.GeneratorExp):
                over = {ast.unparse(of.iter).partition("(")[0] for of in one.generators}
                assert not over & {"count", "cycle", "repeat"}, f"{name}:{one.lineno}"


@interpreted_only
def test_hand_written_initialisers_take_the_fields_in_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As the `__init__` that `dataclass` would generate; see setup.py."""
    checked = set()
    for path in compiled_modules(monkeypatch):
        module = importlib.import_module(path.removesuffix(".py").replace("/", "."))
        for kind in vars(module).values():
            if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
                continue
            if kind.__init__.__code__.co_filename != module.__file__:
                continue
            taken = {
                parameter.name: (parameter.kind is parameter.KEYWORD_ONLY, parameter.default)
                for parameter in inspect.signature(kind).parameters.values()
            }
            expected = {
                field.name: (field.kw_only, default_of(field)) for field in dataclasses.fields(kind)
            }
            assert list(taken.items()) == list(expected.items()), kind
            checked.add(kind.__name__)
    assert {"Body", "Decision", "Situation", "Pose", "Fix"} <= checked


def default_of(field: "dataclasses.Field[Any]") -> object:
    """Default of a parameter for a field: None where a factory makes the value."""
    if field.default_factory is not dataclasses.MISSING:
        return None
    return inspect.Parameter.empty if field.default is dataclasses.MISSING else field.default


def test_a_listed_module_that_does_not_exist_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    compiled = runpy.run_path(str(ROOT / "setup.py"))["compiled"]
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"vehicles/schedule\.py"):
        compiled()


# ---- Dependencies


def load_project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def names(requirements: Iterable[str]) -> set[str]:
    return {canonicalize_name(Requirement(line).name) for line in requirements}


EXTRAS = ("viewer", "studies")
"""What a desk has and a vehicle in a container does without."""
FOR_A_FEW = ("dask", "tables")
"""Extras that are in no lock, as nothing here is installed with them unless it is asked for."""
LOCKS = {"requirements.lock": EXTRAS, "requirements-container.lock": ()}
"""Locks with the extras that each of them holds."""


def requirements(extras: Iterable[str]) -> list[str]:
    """What the project asks for with these extras."""
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
def test_every_dependency_is_locked_to_a_version_that_it_allows(lock: str) -> None:
    pinned: dict[str, list[str]] = {}
    for requirement, _ in locked(lock):
        (pin,) = requirement.specifier
        assert pin.operator == "==", requirement
        pinned.setdefault(canonicalize_name(requirement.name), []).append(pin.version)
    for line in requirements(LOCKS[lock]):
        asked = Requirement(line)
        versions = pinned.get(canonicalize_name(asked.name), [])
        assert versions, f"{asked.name} is not locked"
        assert all(asked.specifier.contains(version) for version in versions), line


def test_a_container_has_the_same_versions_without_the_extras() -> None:
    whole = {str(requirement): hashes for requirement, hashes in locked()}
    small = {str(one): hashes for one, hashes in locked("requirements-container.lock")}
    assert small.items() < whole.items()
    extras = names(requirements(EXTRAS)) - names(requirements(()))
    assert extras == {"rerun-sdk", "matplotlib", "scipy"}
    assert not extras & names(small)


def test_whoever_develops_has_the_extras_too() -> None:
    wanted = f"convoy-emulator[{','.join(EXTRAS)}]"
    assert wanted in load_project()["project"]["optional-dependencies"]["dev"]


@pytest.mark.parametrize("lock", LOCKS)
def test_every_locked_file_has_a_hash(lock: str) -> None:
    for requirement, hashes in locked(lock):
        assert hashes, requirement
        assert all(re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", one) for one in hashes), requirement


@pytest.mark.parametrize("lock", LOCKS)
def test_the_lock_names_no_place_to_get_packages_from(lock: str) -> None:
    text = (ROOT / lock).read_text(encoding="utf-8")
    for word in ("://", "--index-url", "--extra-index-url", "--find-links", "--trusted-host"):
        assert word not in text


@pytest.mark.parametrize("lock", LOCKS)
def test_locked_dependencies_are_complete(lock: str) -> None:
    """What a locked package requires on this platform is locked too."""
    have = {
        canonicalize_name(r.name)
        for r, _ in locked(lock)
        if r.marker is None or r.marker.evaluate()
    }
    for name in sorted(have):
        for line in importlib.metadata.requires(name) or []:
            needed = Requirement(line)
            if needed.marker is None or needed.marker.evaluate({"extra": ""}):
                assert canonicalize_name(needed.name) in have, f"{name} needs {needed}"


# ---- Imports


@cache
def graph() -> grimp.ImportGraph:
    return grimp.build_graph(*PACKAGES, include_external_packages=True, cache_dir=None)


def imported_by(package: str) -> dict[str, list[str]]:
    """What the modules of `package` import from elsewhere, and which of them do."""
    found: dict[str, list[str]] = {}
    for module in graph().modules:
        if module.split(".")[0] == package:
            for one in graph().find_modules_directly_imported_by(module):
                if one.split(".")[0] != package:
                    found.setdefault(one, []).append(module)
    return found


def test_vehicles_import_nothing_that_is_not_pure() -> None:
    assert set(imported_by("vehicles")) <= PURE


def test_messages_stand_alone() -> None:
    assert graph().find_modules_directly_imported_by("vehicles.messages") <= {
        "dataclasses",
        "typing",
    }


def test_scipy_is_for_the_analysis_alone() -> None:
    analysis = {
        "vehicles.theory.gain_sets",
        "vehicles.theory.varying_speed",
        "vehicles.theory.mean_acceleration",
        "vehicles.theory.string_stability",
    }
    assert set(imported_by("vehicles")["scipy"]) <= analysis


def test_every_package_that_is_imported_is_a_declared_dependency() -> None:
    declared = names(requirements((*EXTRAS, *FOR_A_FEW)))
    distributions = importlib.metadata.packages_distributions()
    for package in PACKAGES:
        for name in imported_by(package):
            if name in sys.stdlib_module_names or name.split(".")[0] in PACKAGES:
                continue
            candidates = {canonicalize_name(one) for one in distributions.get(name, [name])}
            parents = {COMES_WITH.get(one, one) for one in candidates}
            assert parents & declared, f"{package} imports {name}"
    for one, parent in COMES_WITH.items():
        assert one in names(importlib.metadata.requires(parent) or [])


def modules_after(statement: str) -> Sequence[str]:
    code = f"{statement}\nimport sys\nprint(*sys.modules)"
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout.split()


HEAVY = {"scipy", "rich", "rerun", "mcap", "matplotlib", "pandas", "pyarrow", "zstandard", "pyproj"}


def test_a_vehicle_s_process_loads_nothing_that_it_does_not_need() -> None:
    """Each takes megabytes, of which a process has 80."""
    drive = """
from scenarios.runs.node.assembly.vehicle_builder import VehicleBuilder
from scenarios.runs.node.probe import NoProbe
from scenarios.runs.node.sink import BusSink
from scenarios.definition.scenario import load_scenario
from transport.bus.memory_bus import MemoryBus
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
