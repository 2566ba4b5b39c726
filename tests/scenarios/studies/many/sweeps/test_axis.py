"""Ranges include both ends and are exact; lists respect brackets and quotes."""

from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.definition.overrides import parse_override
from scenarios.studies.many.sweeps.axis import cells, parsed_axes, parsed_axis


def refused(*texts: str) -> str:
    with pytest.raises(ScenarioError) as error:
        parsed_axes(texts)
    (line,) = error.value.lines
    return line


@pytest.mark.parametrize(
    ("given", "texts"),
    [
        ("0:0.9:0.1", ["0", *(f"0.{digit}" for digit in range(1, 10))]),
        ("8:35:9", ["8", "17", "26", "35"]),
        ("1:0:-0.25", ["1", "0.75", "0.5", "0.25", "0"]),
        ("-0.5:0.5:0.5", ["-0.5", "0", "0.5"]),
        ("100:300:100", ["100", "200", "300"]),
        ("1e-3:3e-3:1e-3", ["0.001", "0.002", "0.003"]),
        ("5:5:1", ["5"]),
        ("8,15,35", ["8", "15", "35"]),
        ("clear, lossy", ["clear", "lossy"]),
        ("[1,2],[{a=3,b=4}]", ["[1,2]", "[{a=3,b=4}]"]),
        ("\"a,b\",'c]'", ['"a,b"', "'c]'"]),
        ("true,false", ["true", "false"]),
        ("2026-01-01T00:00:00Z", ["2026-01-01T00:00:00Z"]),
    ],
)
def test_values_keep_their_text(given: str, texts: list[str]) -> None:
    axis = parsed_axis(f"some.key={given}")
    assert axis.key == "some.key"
    assert list(axis.texts) == texts


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
