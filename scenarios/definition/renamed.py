"""Keys and values of scenario files that were renamed, and keys that were added.

A refusal names the new one. Scenarios inside recorded logs are translated.
"""

from collections.abc import Iterable, Mapping
from math import inf
from typing import Any

KEYS: Mapping[str, str] = {
    "convoy.when_a_vehicle_dies": "on_vehicle_failure",
    "convoy.clock_offset_ms_max": "clock_uncertainty_ms_max",
    "control.degradation.hardest_mps2": "emergency_mps2",
    "control.degradation.hardest_jerk_mps3": "emergency_jerk_mps3",
    "control.degradation.trusted_share_ratio": "probation_delivery_ratio",
    "control.degradation.forgiven_after_s": "probation_halving_s",
    "outages.who": "vehicle",
    "path.place_word": "source_unit",
    "path.place_numbers": "source_numbers",
    "path.began_at_s": "epoch_s",
    "path.skipped_first": "left_out",
    "drive.skipped_first": "left_out",
    "drive.place_word": "source_unit",
    "drive.place_numbers": "source_numbers",
    "drive.began_at_s": "epoch_s",
    "limits.believed_minus_true_error_m_max": "self_estimate_error_m_max",
}
"""New name of each key; the tables before it may have others around and between them."""
VALUES: Mapping[str, Mapping[str, str]] = {
    "convoy.on_vehicle_failure": {"go_on": "continue"},
    "limits.after_collision": {"go_on": "continue"},
    "control.degradation.predecessor_path": {"meant": "intended"},
}
"""New values by key."""
ADDED: Mapping[str, float] = {
    "control.degradation.lateral_deviation_m_max": 1000.0,
    "sending.path_history_m": 0.0,
    "speed.friction_ratio_max": inf,
}
"""Keys that recorded scenarios of earlier versions lack, and the values that leave the behaviour as
it was then. A recorded scenario has all keys of its version."""


MOVED: Mapping[tuple[str, str], tuple[str, str]] = {
    ("control.fusion", "predecessor"): ("information_flow.lateral", "predecessor"),
}
"""Words of keys that are now words of another key, next to the first table."""


def new_home(parts: Iterable[str], value: object) -> str:
    """Return the key and word that a word of a key has become; empty if it was not moved."""
    names = [part for part in parts if not part.isdecimal()]
    for (key, word), (home, new) in MOVED.items():
        if value == word and _is_at(key, names):
            around = names[: names.index(key.partition(".")[0])]
            return f'{".".join([*around, home])} = "{new}"'
    return ""


def new_key(parts: Iterable[str]) -> str | None:
    """Return the new name of the key with these tables around it, if it was renamed."""
    names = [part for part in parts if not part.isdecimal()]
    return next((new for old, new in KEYS.items() if _is_at(old, names)), None)


def new_value(parts: Iterable[str], value: object) -> str | None:
    """Return the new word for the value of a key, if it was renamed."""
    names = [part for part in parts if not part.isdecimal()]
    words = next((words for key, words in VALUES.items() if _is_at(key, names)), {})
    return words.get(value) if isinstance(value, str) else None


def as_recorded(tables: dict[str, Any]) -> dict[str, Any]:
    """Rename old keys and values in a recorded scenario, and add the keys that it lacks."""
    renamed: dict[str, Any] = _translated(tables)
    own = renamed.get("vehicle")
    vehicles = list(own.values()) if isinstance(own, dict) else []
    for name, value in ADDED.items():
        parts = name.split(".")
        if _set_default(renamed, parts, value):
            for vehicle in vehicles:
                if isinstance(vehicle, dict) and parts[0] in vehicle:
                    _set_default(vehicle, parts, value)
    for table in (renamed, *vehicles):
        if isinstance(table, dict):
            _move_words(table)
    return renamed


def _move_words(table: dict[str, Any]) -> None:
    """Replace words that are now words of another key; the former key has its default again."""
    for (key, word), (home, new) in MOVED.items():
        first, _, last = key.partition(".")
        inner = table.get(first)
        if not isinstance(inner, dict) or inner.get(last) not in (word, {"use": word}):
            continue
        del inner[last]
        _set_default(table, home.split("."), new)


def _set_default(table: dict[str, Any], parts: list[str], value: object) -> bool:
    """Set a missing key; return whether it was missing. Validation reports anything but tables."""
    *around, key = parts
    for part in around:
        inner = table.setdefault(part, {})
        if not isinstance(inner, dict):
            return False
        table = inner
    missing = key not in table
    table.setdefault(key, value)
    return missing


def _translated(value: Any, parts: tuple[str, ...] = ()) -> Any:
    if isinstance(value, list):
        return [_translated(entry, parts) for entry in value]
    if not isinstance(value, dict):
        return new_value(parts, value) or value
    renamed = {key: new_key((*parts, key)) or key for key in value}
    return {new: _translated(value[key], (*parts, new)) for key, new in renamed.items()}


def _is_at(known: str, names: list[str]) -> bool:
    """Whether `names` end in the key and contain its tables in order."""
    *tables, key = known.split(".")
    around = iter(names[:-1])
    return names[-1:] == [key] and all(table in around for table in tables)
