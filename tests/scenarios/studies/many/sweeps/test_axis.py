"""Ranges include both ends and are exact; lists respect brackets and quotes."""

from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.definition.overrides import parse_override
from scenarios.studies.many.plan import cells, parsed_axes, parsed_axis


def refused(*texts: str) -> str:
    with pytest.raises(ScenarioError) as error:
        parsed_axes(texts)
    (line,) = error.value.lines
    return line


@given(
    start=st.decimals(-100, 100, places=3),
    step=st.decimals(-10, 10, places=3).filter(bool),
    count=st.integers(0, 50),
)
def test_a_range_is_exact(start: Decimal, step: Decimal, count: int) -> None:
    stop = start + count * step
    axis = parsed_axis(f"key={start}:{stop}:{step}")
    wanted = [Fraction(start) + k * Fraction(step) for k in range(count + 1)]
    assert list(map(Fraction, axis.texts)) == wanted
    assert list(axis.values) == [parse_override(f"key={text}")[1] for text in axis.texts]
    assert axis.numbers == tuple(map(float, wanted))


@pytest.mark.parametrize(
    ("given", "fact"),
    [
        (["key"], "allowed KEY=START:STOP:STEP"),
        (["key="], "allowed KEY=START:STOP:STEP"),
        (["=1,2"], "allowed KEY=START:STOP:STEP"),
        (["key=1,,2"], "allowed KEY=START:STOP:STEP"),
        (["key=0:1:0"], "a STEP that leads from START to STOP"),
        (["key=0:1:-0.1"], "a STEP that leads from START to STOP"),
        (["key=0:1:0.3"], "a STEP that reaches STOP, as in 0:0.9:0.3"),
        (["key=0:1e9:1e-3"], "at most 1000 values"),
        (["key=" + ",".join(map(str, range(1001)))], "at most 1000 values"),
        (["key=1,2,1"], "key: given 1 twice"),
        (["seed=1,2"], "--seeds"),
        (["key=1,2", "key=3"], "given key twice"),
    ],
)
def test_invalid_axes_are_refused_in_one_line(given: list[str], fact: str) -> None:
    line = refused(*given)
    assert line.startswith("--vary: ")
    assert fact in line


def test_cells_are_all_combinations_and_the_last_key_varies_fastest() -> None:
    axes = parsed_axes(["a=1,2", "b=x,y"])
    assert cells(axes) == [("a=1", "b=x"), ("a=1", "b=y"), ("a=2", "b=x"), ("a=2", "b=y")]
    assert cells([]) == [()]
    assert [axis.numbers for axis in axes] == [(1.0, 2.0), None]
