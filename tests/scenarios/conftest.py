"""Modules with classes of the user."""

import itertools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

NUMBERS = itertools.count()


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], str]]:
    """Writes a module of a name of its own, which it returns."""
    monkeypatch.syspath_prepend(tmp_path)
    made: list[str] = []

    def write(code: str) -> str:
        made.append(f"own_{next(NUMBERS)}")
        (tmp_path / f"{made[-1]}.py").write_text(code, encoding="utf-8")
        return made[-1]

    yield write
    for name in made:
        sys.modules.pop(name, None)
