"""How values and keys appear in an error line."""

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from difflib import get_close_matches

MAX_SHOWN = 60
"""Longest text or list in a line (characters); numbers are written in full."""

LONGEST_NUMBER = 10**1000


def toml_repr(value: object) -> str:
    """Write `value` as a scenario file would, cut to a readable length."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, int):
        return json.dumps(value) if abs(value) < LONGEST_NUMBER else "a number without end"
    text = value.isoformat() if isinstance(value, datetime) else json.dumps(value, default=str)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def dotted_key(location: Sequence[str | int]) -> str:
    """Return a key such as `path.segments[2].length_m`."""
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def either(words: Sequence[str]) -> str:
    *others, last = map(toml_repr, words)
    return f"{', '.join(others)} or {last}" if others else last


def closest(word: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the known word closest in spelling, or one that begins like it."""
    words = list(known)
    plain = {other.lower(): other for other in words}
    matches = get_close_matches(word.lower(), list(plain), n=1, cutoff=cutoff)
    longer = [other for other in plain if len(word) > 2 and other.startswith(word.lower())]
    return next((plain[other] for other in (*matches, *longer)), None)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a question that offers the known word closest to `word`; empty if none is."""
    match = closest(word, known)
    return f", did you mean {match}?" if match else ""
