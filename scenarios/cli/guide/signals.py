"""Receivers and sending in words, for the table of `convoy check`."""

from collections.abc import Mapping
from typing import Any

from scenarios.definition.schema.gnss import GnssTable

Asked = Mapping[str, Any]
"""A table of a scenario, dumped."""


def receiver_in_words(asked: Asked) -> str:
    """Describe a receiver and its errors."""
    return "; ".join(GnssTable.model_validate(asked).value.describe())


def sending_in_words(asked: Asked) -> str:
    """Say when a vehicle sends."""
    dcc = "; congestion control" if asked["dcc"] else ""
    return _RULES[asked["kind"]](asked) + dcc


def _phase(asked: Asked) -> str:
    return "phase drawn" if asked["drawn_phase"] else f"phase {asked['phase_s']:g} s"


def _profile(asked: Asked) -> str:
    points = (f"{point['rate_hz']:g} Hz from {point['at_s']:g} s" for point in asked["profile"])
    return ", ".join(points)


def _intervals(asked: Asked) -> str:
    table = asked["table"] or f"{len(asked['intervals_ms'])} intervals given"
    return f"intervals drawn: {table}, jitter {asked['jitter_ms']:g} ms"


_RULES = {
    "every_fix": lambda _: "every fix",
    "fixed": lambda asked: f"{asked['rate_hz']:g} Hz, {_phase(asked)}",
    "profile": _profile,
    "cam": lambda asked: f"CAM, checked every {asked['check_period_ms']:g} ms, {_phase(asked)}",
    "intervals": _intervals,
}
