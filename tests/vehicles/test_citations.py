"""Every public function, method and class of the science says in its docstring where it is from."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import vehicles

FOLDER = Path(vehicles.__file__).parent
SCIENCE = (
    "car.dynamics", "car.gnss", "car.parameters", "driver.decision", "driver.follower",
    "driver.leader", "driver.pose_estimator", "driver.speed",
    "driver.steering", "driver.tracking", "geometry.arc_spline", "geometry.geodesy",
    "geometry.local_regression", "geometry.path", "geometry.smoothing", "preview.curve_fit",
    "preview.fit_arc", "preview.fit_joined", "preview.outliers", "preview.samples",
    "preview.trace", "preview.trajectory", "theory.constant_speed", "theory.gain_margins",
    "theory.gain_sets", "theory.linear_model", "theory.polynomials", "theory.propagation",
    "theory.simulated_chain", "theory.string_stability", "theory.varying_speed",
)  # fmt: skip
PLUMBING = {
    "geometry.driven_path": "distances from a polyline of recorded poses",
    "geometry.trajectory_points": "points along a message's arcs, for pictures",
    "messages": "what goes over the wire and into the log; its quantities are defined elsewhere",
    "preview.polyline": "lists of points with their arc length, for `trace`",
    "schedule": "which nanosecond instants belong to a periodic schedule",
}
"""Modules without a formula of the field, and why."""

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
    "complementary filter", "constant time headway policy", "Cook and Weisberg, 1982", "CUSUM",
    "elementary algebra", "EPSG method", "Gauss–Newton", "Gaussian elimination", "Hermite",
    "Hoffmann", "Horner's scheme", "Hurwitz's criterion", "IEEE 754", "linear regression",
    "linear interpolation", "local regression", "Lyapunov", "Newton's method", "quotient rule",
    "Rayleigh's quotient", "Routh-Hurwitz", "Runge–Kutta", "spectral factorisation",
    "Steiner's theorem", "Swaroop and Hedrick", "trapezoidal rule", "Weyl's inequality", "WGS84",
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


def has_source(text: str) -> bool:
    return bool(PAPER.search(text)) or any(name.lower() in text.lower() for name in NAMED)


def test_every_module_is_science_or_plumbing() -> None:
    found = {
        ".".join(path.relative_to(FOLDER).with_suffix("").parts)
        for path in FOLDER.rglob("*.py")
        if path.stem != "__init__"
    }
    assert found == {*SCIENCE, *PLUMBING}


@pytest.mark.parametrize("module", SCIENCE)
def test_everything_public_cites_its_source(module: str) -> None:
    without = [name for name, one in public(source(module)) if not has_source(flat(one))]
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
