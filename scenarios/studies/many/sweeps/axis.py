"""A key that varies and its values, parsed from the command line."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import product
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.overrides import OverrideError, key_parts, parse_override

MAX_VALUES = 1000
ALLOWED_FORMS = "KEY=START:STOP:STEP or KEY=a,b,c, such as links.loss_ratio=0:0.9:0.1"
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?"
RANGE = re.compile(rf"\s*({NUMBER})\s*:\s*({NUMBER})\s*:\s*({NUMBER})\s*")
WITHOUT_STEP = re.compile(rf"\s*({NUMBER})\s*:\s*({NUMBER})\s*")
_DOTS = re.compile(r"(?<=\d)\.\.(?=[\d+-])")
BRACKETS = {"[": 1, "{": 1, "]": -1, "}": -1}


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepAxis:
    key: str
    texts: tuple[str, ...]

    @property
    def overrides(self) -> tuple[str, ...]:
        return tuple(f"{self.key}={text}" for text in self.texts)

    @property
    def values(self) -> tuple[Any, ...]:
        return tuple(parse_override(override)[1] for override in self.overrides)

    @property
    def numbers(self) -> tuple[float, ...] | None:
        """The values if all are numbers, else None."""
        values = self.values
        if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
            return tuple(map(float, values))
        return None


def parsed_axis(text: str) -> SweepAxis:
    """Parse `KEY=START:STOP:STEP`, both ends included, or `KEY=a,b,c`; raises ScenarioError."""
    key, _, given = text.partition("=")
    key = ".".join(key_parts(key))
    try:
        parse_override(f"{key}=0")
        texts = _texts(given)
        axis = SweepAxis(key=key, texts=texts)
        shown = [repr(value) if isinstance(value, str) else str(value) for value in axis.values]
    except ValueError as error:  # includes OverrideError
        why = ALLOWED_FORMS if isinstance(error, OverrideError) else error
        raise ScenarioError([f"--vary: given {text!r}, allowed {why}"]) from error
    if key == "seed":
        raise ScenarioError(["--vary: seed: use --seeds N for the seeds 1 to N"])
    if twice := [value for k, value in enumerate(shown) if value in shown[:k]]:
        raise ScenarioError([f"--vary: {key}: given {twice[0]} twice"])
    return axis


def _texts(given: str) -> tuple[str, ...]:
    """Split into values; raises ValueError with the allowed form."""
    ends = RANGE.fullmatch(given)
    if span := WITHOUT_STEP.fullmatch(_DOTS.sub(":", given)):
        raise ValueError(f"a range START:STOP:STEP, such as {span[1]}:{span[2]}:0.1")
    texts = tuple(_range(*map(Decimal, ends.groups()))) if ends else tuple(_split(given))
    if not all(texts):
        raise ValueError(ALLOWED_FORMS)
    if len(texts) > MAX_VALUES:
        raise ValueError(f"at most {MAX_VALUES} values of a key")
    return texts


def _range(start: Decimal, stop: Decimal, step: Decimal) -> list[str]:
    """Exact decimal numbers from start to stop, both included."""
    if not step or (stop - start) * step < 0:
        raise ValueError("a STEP that leads from START to STOP")
    count, rest = divmod(stop - start, step)
    if rest:
        last = start + count * step
        raise ValueError(f"a STEP that reaches STOP, as in {start}:{last}:{step}")
    if count >= MAX_VALUES:
        raise ValueError(f"at most {MAX_VALUES} values of a key")
    return [f"{(start + number * step).normalize() + 0:f}" for number in range(int(count) + 1)]


def _split(given: str) -> Iterator[str]:
    """Split at commas, but not within brackets or quotes."""
    depth, quote, word = 0, "", ""
    for letter in given:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        depth += 0 if quote else BRACKETS.get(letter, 0)
        if letter == "," and not depth and not quote:
            yield word.strip()
            word = ""
        else:
            word += letter
    yield word.strip()


def parsed_axes(texts: Sequence[str]) -> tuple[SweepAxis, ...]:
    """Parse all `--vary`; raises ScenarioError, also for a key given twice."""
    axes = tuple(map(parsed_axis, texts))
    keys = [axis.key for axis in axes]
    if twice := [key for k, key in enumerate(keys) if key in keys[:k]]:
        raise ScenarioError(
            [f"--vary: given {twice[0]} twice; give all values of a key in one --vary"]
        )
    return axes


def cells(axes: Sequence[SweepAxis]) -> list[tuple[str, ...]]:
    """Return all combinations of values as overrides; the last key varies fastest."""
    return list(product(*(axis.overrides for axis in axes)))
