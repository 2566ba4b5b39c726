"""What computes something of the field says in its docstring where that is from.

That is every public class and function of the science, but for accessors and for the few functions
that are listed as plumbing.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import vehicles

FOLDER = Path(vehicles.__file__).parent
PLUMBING = {
    "geometry.driven_path": "distances from a polyline of recorded poses",
    "geometry.lanes": "lines beside a polyline, for pictures",
    "geometry.trajectory_points": "points along a message's arcs, for pictures",
    "messages": "what goes over the wire and into the log; its quantities are defined elsewhere",
    "preview.polyline": "lists of points with their arc length, for `trace`",
    "schedule": "which nanosecond instants belong to a periodic schedule",
}
"""Modules without a formula of the field, and why; all others are science."""
SCIENCE = tuple(
    name
    for path in sorted(FOLDER.rglob("*.py"))
    if (name := ".".join(path.relative_to(FOLDER).with_suffix("").parts)) not in PLUMBING
    and path.stem != "__init__"
)
PLUMBING_IN_SCIENCE = {
    "car.gnss.from_message": "takes a fix out of a message",
    "car.gnss.to_message": "puts a fix into a message",
    "driver.steering.GuardedController.steer": "checks the command of a user's own controller",
    "driver.steering.try_out": "asks a controller for a command",
    "driver.steering.load_controller": "imports a class by its dotted name",
}
"""Functions that compute nothing of the field, and why they need no source."""
ARITHMETIC = (
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.MatMult,
)  # fmt: skip

HIGHEST_EQUATION = 8
"""The paper numbers so many equations; all others have a section only."""
SECTIONS = {"I": "AB", "II": "", "III": "ABCDEF", "IV": "AB", "V": "ABCD", "VI": ""}
"""The paper's sections and their subsections."""
FIGURES = 14
TABLES = {"I"}
STATEMENTS = {"Definition 1", "Proposition 1", "Lemma 1"}

PAPER = re.compile(
    r"\b[Ee]qs?\. \(\d|\bSections? [IV]|\bFigs?\. \d|\bTable I|\b(Definition|Proposition|Lemma) \d"
    r"|\b([Bb]eyond|[Nn]ot in) the paper|\b[Tt]he paper is silent",
)
"""A place in the paper, or that it has none."""
NAMED = (
    "Bernstein", "BFGS", "Brent's method", "Cauchy product", "Cleveland, 1979", "companion matri",
    "constant time headway policy", "Cook and Weisberg, 1982", "Coulter", "CUSUM",
    "elementary algebra", "EN 302 637-2",
    "EPSG method", "Gauss–Markov", "Hermite", "Hoffmann",
    "Horner's scheme", "Hurwitz's criterion", "IEEE 754", "Kalman", "linear regression",
    "linear interpolation", "local regression", "Lyapunov", "Markov chain",
    "Molina-Masegosa", "Newton's method", "NMEA 0183", "quotient rule",
    "Rayleigh's quotient", "Routh-Hurwitz", "Runge–Kutta", "spectral factorisation",
    "Steiner's theorem", "Swaroop and Hedrick", "trapezoidal rule", "TS 102 687",
    "Weyl's inequality", "WGS84",
)  # fmt: skip
"""Results from outside the paper, by the names they go by."""

Documented = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def source(module: str) -> ast.Module:
    return ast.parse(path_of(module).read_text(encoding="utf-8"))


def path_of(module: str) -> Path:
    return FOLDER.joinpath(*module.split(".")).with_suffix(".py")


def public(node: ast.Module | ast.ClassDef, inside: str = "") -> Iterator[tuple[str, Documented]]:
    """Public functions and classes of a module and what is public in those, with their names."""
    for one in node.body:
        if isinstance(one, Documented) and not one.name.startswith("_"):
            yield inside + one.name, one
            if isinstance(one, ast.ClassDef):
                yield from public(one, f"{inside}{one.name}.")


def flat(documented: Documented) -> str:
    return " ".join((ast.get_docstring(documented) or "").split())


def computes(node: ast.AST) -> bool:
    """Whether there is arithmetic in it."""
    return any(
        isinstance(one, ast.BinOp | ast.AugAssign) and isinstance(one.op, ARITHMETIC)
        for one in ast.walk(node)
    )


def is_accessor(documented: Documented) -> bool:
    """Whether it only declares a signature, or returns a value without working it out.

    Its body is `...`, or a single `return` without arithmetic and without a call.
    """
    if isinstance(documented, ast.ClassDef):
        return False
    body = documented.body[1:] if ast.get_docstring(documented) else documented.body
    match body:
        case [ast.Expr(ast.Constant(value=value))]:
            return value is ...
        case [ast.Return(value=ast.expr() as returned)]:
            called = any(isinstance(one, ast.Call) for one in ast.walk(returned))
            return not called and not computes(returned)
    return False


def needing_a_source(module: str) -> Iterator[tuple[str, Documented]]:
    for name, one in public(source(module)):
        if not is_accessor(one) and f"{module}.{name}" not in PLUMBING_IN_SCIENCE:
            yield name, one


def has_source(text: str) -> bool:
    return bool(PAPER.search(text)) or any(name.lower() in text.lower() for name in NAMED)


def test_what_is_called_plumbing_exists_and_computes_nothing() -> None:
    assert all(path_of(module).exists() for module in PLUMBING)
    functions = {
        f"{module}.{name}": one for module in SCIENCE for name, one in public(source(module))
    }
    assert PLUMBING_IN_SCIENCE.keys() <= functions.keys()
    for name in PLUMBING_IN_SCIENCE:
        assert isinstance(functions[name], ast.FunctionDef), name
        assert not computes(functions[name]), name


@pytest.mark.parametrize("module", SCIENCE)
def test_what_is_public_and_computes_cites_its_source(module: str) -> None:
    without = [name for name, one in needing_a_source(module) if not has_source(flat(one))]
    assert not without, f"vehicles.{module}: no source in the docstring of {', '.join(without)}"


@pytest.mark.parametrize("module", SCIENCE)
def test_what_is_cited_of_the_paper_exists(module: str) -> None:
    text = " ".join(path_of(module).read_text(encoding="utf-8").split())
    for cited in re.findall(r"\b[Ee]qs?\. ((?:\(\d+\)(?:, | and )?)+)", text):
        assert all(int(n) <= HIGHEST_EQUATION for n in re.findall(r"\d+", cited)), cited
    for section, letter in re.findall(r"\b([IV]+)-([A-Z])\b", text):
        assert letter in SECTIONS[section], f"Section {section}-{letter}"
    for cited in re.findall(r"\bFigs?\. (\d+(?:(?:, | and )\d+)*)", text):
        assert all(int(n) <= FIGURES for n in re.findall(r"\d+", cited)), cited
    assert {*re.findall(r"\bTable ([IV]+)\b", text)} <= TABLES
    assert {*re.findall(r"\b(?:Definition|Proposition|Lemma) \d+", text)} <= STATEMENTS


def test_every_named_result_is_cited() -> None:
    texts = [flat(one) for module in SCIENCE for _, one in public(source(module))]
    assert [name for name in NAMED if not any(name.lower() in text.lower() for text in texts)] == []


def test_a_docstring_without_a_source_is_found_out() -> None:
    tree = ast.parse(
        'def cited():\n    """Eq. (3)."""\n'
        'def bare():\n    """Largest root."""\n'
        'def _hidden():\n    """Nothing."""\n'
        'class Shape:\n    """Piece of Section III-A."""\n'
        "    def at(self): ...\n"
    )
    assert [name for name, one in public(tree) if not has_source(flat(one))] == ["bare", "Shape.at"]


def test_accessors_are_told_from_what_computes() -> None:
    tree = ast.parse(
        'class Car:\n    """Model of Section II."""\n'
        "    @property\n"
        '    def speed(self):\n        """Speed (m/s)."""\n        return self._speed\n'
        '    def steer(self): """Steer."""; ...\n'
        '    def twice(self):\n        """Twice."""\n        return 2 * self._speed\n'
        '    def called(self):\n        """Called."""\n        return worked_out(self)\n'
        '    def two(self):\n        """Two."""\n        a = 1\n        return a\n'
    )
    accessors = [name for name, one in public(tree) if is_accessor(one)]
    assert accessors == ["Car.speed", "Car.steer"]
