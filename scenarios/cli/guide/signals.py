"""Receivers and sending in words, for the table of `convoy check`."""

from collections.abc import Iterator, Mapping
from typing import Any

Asked = Mapping[str, Any]
"""A table of a scenario, dumped."""


def receiver_in_words(asked: Asked) -> str:
    """Say what a receiver measures, and what is wrong with it."""
    noise = (
        f"{asked['position_noise_m']:g} m, {asked['heading_noise_deg']:g}°, "
        f"{asked['speed_noise_mps']:g} m/s, {asked['yaw_rate_noise_radps']:g} rad/s"
    )
    return "; ".join((f"{asked['rate_hz']:g} Hz, noise {noise}", *_errors(asked)))


def _errors(asked: Asked) -> Iterator[str]:
    if asked["preset"] or asked["fix"] != "fixed":
        yield f"{asked['preset'] or 'fix'} ({asked['fix']})"
    for key, what in (("drift", "drift"), ("common_drift", "common drift")):
        if asked[key]:
            yield f"{what} {asked[key]['deviation_m']:g} m over {asked[key]['time_constant_s']:g} s"
    if asked["bias"]:
        bias = asked["bias"]
        given = f"{bias['east_m']:g} m east, {bias['north_m']:g} m north"
        yield f"bias {given}, {bias['deviation_m']:g} m drawn"
    if asked["quantisation_m"]:
        yield f"steps of {asked['quantisation_m']:g} m"
    if asked["latency_ms"]:
        yield f"{asked['latency_ms']:g} ms late"
    if asked["fix_states"]:
        yield f"fix states by {asked['fix_states']['kind']}"
    if asked["outages"]:
        yield f"{len(asked['outages'])} outages"
    if asked["accuracy_ratio"] != 1.0:
        yield f"says {asked['accuracy_ratio']:g} of its deviation"


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
