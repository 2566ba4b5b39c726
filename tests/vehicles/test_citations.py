"""Equations and models cite where they are from, and what is cited of the paper exists."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import vehicles

FOLDER = Path(vehicles.__file__).parent
EQUATIONS = (
    "theory/*.py",
    *("car/dynamics.py", "car/tyres.py"),
    *("driver/own_state.py", "driver/steering.py", "driver/tracking.py"),
    *("geometry/arc_spline.py", "geometry/geodesy.py", "geometry/smoothing.py"),
    *("geometry/arc_fits.py", "preview/joined_fit.py", "preview/paper_recipe.py"),
)
"""Modules of equations and models, as patterns: what they calculate has a source."""
INDEXING = {"sections_where"}
"""Functions that calculate indices only."""
ARITHMETIC = (
    ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.MatMult,
)  # fmt: skip

HIGHEST_EQUATION = 8
"""The paper numbers only these equations; all others have a section."""
SECTIONS = {"I": "AB", "II": "", "III": "ABCDEF", "IV": "AB", "V": "ABCD", "VI": ""}
"""The paper's sections and their subsections."""
FIGURES = 14
TABLES = {"I"}
STATEMENTS = {"Definition 1", "Proposition 1", "Lemma 1"}

PAPER = re.compile(
    r"\b[Ee]qs?\. \(\d|\bSections? [IV]|\bFigs?\. \d|\bTable I|\b(Definition|Proposition|Lemma) \d"
)
"""A place in the paper."""
NAMED = (
    "Bernstein", "BFGS", "Brent's method", "Cauchy product", "Cleveland, 1979", "companion matri",
    "Cook and Weisberg, 1982", "Coulter", "CUSUM", "elementary algebra", "EPSG method",
    "Fiala, 1954", "first-order lag", "Gauss-Legendre", "Hermite", "Hindiyeh and Gerdes, 2014",
    "Hoffmann",
    "Horner's scheme", "Hurwitz's criterion", "IEEE 754", "Kalman", "linear interpolation",
    "linear regression", "local regression", "Lyapunov", "Newton's method", "quotient rule",
    "Rayleigh's quotient", "Routh-Hurwitz", "Runge–Kutta", "spectral factorisation",
    "Steiner's theorem", "Swaroop and Hedrick", "trapezoidal rule", "Weyl's inequality", "WGS84",
)  # fmt: skip
"""Results from outside the paper, by the names they go by."""

Documented = ast.FunctionDef | ast.ClassDef


def equations() -> list[Path]:
    found = [path for pattern in EQUATIONS for path in sorted(FOLDER.glob(pattern))]
    return [path for path in found if path.stem != "__init__"]


def calculating(tree: ast.Module) -> Iterator[Documented]:
    """Public functions and classes of a module that contain arithmetic."""
    for node in tree.body:
        if isinstance(node, Documented) and not node.name.startswith("_") and calculates(node):
            yield node


def calculates(node: ast.AST) -> bool:
    return any(
        isinstance(part, ast.BinOp | ast.AugAssign) and isinstance(part.op, ARITHMETIC)
        for part in ast.walk(node)
    )


def cites(node: Documented) -> bool:
    """Whether a docstring of a function, or of a class and its methods, names a source."""
    documented = [part for part in ast.walk(node) if isinstance(part, Documented)]
    text = " ".join(" ".join((ast.get_docstring(part) or "").split()) for part in documented)
    return bool(PAPER.search(text)) or any(name.lower() in text.lower() for name in NAMED)


def uncited(text: str) -> list[str]:
    found = [node.name for node in calculating(ast.parse(text)) if not cites(node)]
    return [name for name in found if name not in INDEXING]


def test_equations_and_models_cite_their_source() -> None:
    for pattern in EQUATIONS:
        assert list(FOLDER.glob(pattern)), f"no module matches {pattern}"
    texts = {path: path.read_text(encoding="utf-8") for path in equations()}
    assert {path: names for path, text in texts.items() if (names := uncited(text))} == {}


def test_an_equation_without_a_source_is_detected() -> None:
    text = (
        'def cited(x):\n    """Eq. (3)."""\n    return 2 * x\n'
        'def bare(x):\n    """Largest root."""\n    return 2 * x\n'
        'def accessor(x):\n    """No arithmetic."""\n    return x\n'
        'def _hidden(x):\n    """Nothing."""\n    return 2 * x\n'
        'class Shape:\n    """Piece."""\n'
        '    def at(self, x):\n        """Section III-A."""\n        return 2 * x\n'
    )
    assert uncited(text) == ["bare"]


def wrong_citations(text: str) -> Iterator[str]:
    """Places that the paper does not have."""
    for cited in re.findall(r"\b[Ee]qs?\. ((?:\(\d+\)(?:, | and )?)+)", text):
        if any(int(number) > HIGHEST_EQUATION for number in re.findall(r"\d+", cited)):
            yield f"eq. {cited}"
    for section, letter in re.findall(r"\b([IV]+)-([A-Z])\b", text):
        if letter not in SECTIONS[section]:
            yield f"Section {section}-{letter}"
    for cited in re.findall(r"\bFigs?\. (\d+(?:(?:, | and )\d+)*)", text):
        if any(int(number) > FIGURES for number in re.findall(r"\d+", cited)):
            yield f"Fig. {cited}"
    yield from {*re.findall(r"\bTable ([IV]+)\b", text)} - TABLES
    yield from {*re.findall(r"\b(?:Definition|Proposition|Lemma) \d+", text)} - STATEMENTS


def test_cited_places_exist_in_the_paper() -> None:
    assert list(wrong_citations("eq. (9), Section III-G, Fig. 15, Table II, Lemma 2")) == [
        *("eq. (9), ", "Section III-G", "Fig. 15", "II", "Lemma 2")
    ]
    wrong = {}
    for path in sorted(FOLDER.rglob("*.py")):
        found = list(wrong_citations(" ".join(path.read_text(encoding="utf-8").split())))
        if found:
            wrong[str(path)] = found
    assert wrong == {}
