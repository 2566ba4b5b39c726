"""Random laws of a link other than loss: delay, queue, outages, radio, content and presets."""

from random import Random
from typing import Any

from scenarios.definition.channel.presets import presets, read_preset
from tests.made.channels.drawn_laws import drawn_collisions, drawn_loss

Raw = dict[str, Any]


def drawn_channel(chance: Random, share: float) -> Raw:
    """Draw a link that has each law with probability `share`, sometimes over a preset.

    A law that contradicts the preset is refused.
    """
    laws = {name: drawn(chance) for name, drawn in LAWS.items() if chance.random() < share}
    if chance.random() >= share:
        return laws
    preset = drawn_preset(chance)
    below = read_preset(preset).links
    return {"preset": preset, **{name: law for name, law in laws.items() if name not in below}}


def drawn_preset(chance: Random) -> str:
    return chance.choice([name for name in presets() if not read_preset(name).entries])


def drawn_delay(chance: Random) -> Raw:
    kind = chance.choice(["constant", "uniform", "normal", "lognormal", "gamma", "empirical"])
    mean = chance.choice([0.01, 30.0, chance.uniform(1.0, 300.0)])
    own: Raw = {"mean_ms": mean, "deviation_ms": mean * chance.choice([0.1, 1.0, 3.0])}
    if kind == "constant":
        own = {"delay_ms": chance.choice([0.0, mean])}
    elif kind == "uniform":
        own = {"delay_ms_max": mean}
    elif kind == "empirical":
        own = {"recorded_ms": [chance.uniform(0.0, mean) for _ in range(chance.choice([1, 9]))]}
    elif kind == "normal" and chance.random() < 0.5:
        own["delay_ms_max"] = 2.0 * mean
    if kind != "constant" and chance.random() < 0.5:
        own["correlation_ratio"] = chance.choice([0.99, chance.uniform(0.0, 0.99)])
    return {"kind": kind, **own, "order": chance.choice(["free", "in_order"])}


def drawn_queue(chance: Random) -> Raw:
    return {
        "bytes_per_s": chance.choice([1.0, 2000.0, 1e9, chance.uniform(500.0, 10_000.0)]),
        "depth_messages": chance.choice([1, 10, 10_000]),
        "drop": chance.choice(["newest", "oldest"]),
    }


def drawn_outages(chance: Random) -> list[Raw]:
    drawn = [_window, _stretch, _circle, _random_outage]
    return [chance.choice(drawn)(chance) for _ in range(chance.randint(0, 3))]


def drawn_spans(chance: Random) -> list[Raw]:
    """Draw windows in which a radio is off."""
    spans = [_window(chance) for _ in range(chance.randint(1, 2))]
    return [{key: value for key, value in span.items() if key != "kind"} for span in spans]


def drawn_radio(chance: Random) -> Raw:
    return chance.choice([_table, _path_loss])(chance)


def drawn_content(chance: Random) -> Raw:
    table: Raw = {
        "duplicate_ratio": chance.choice([0.0, 1.0, chance.random()]),
        "filter_duplicates": chance.random() < 0.5,
        "reorder_ratio": chance.choice([0.0, 1.0, chance.random()]),
        "reorder_delay_ms": chance.choice([0.001, 100.0, chance.uniform(1.0, 1000.0)]),
        "bit_error_ratio": chance.choice([0.0, 0.1, 1e-4, 1e-3]),
        "frame_check": chance.random() < 0.5,
    }
    if chance.random() < 0.5:
        table["duplicate_delay_ms"] = chance.choice([0.0, chance.uniform(1.0, 300.0)])
    given: Raw = {key: value for key, value in table.items() if chance.random() < 0.6}
    if chance.random() < 0.6:
        given["false"] = [_false(chance) for _ in range(chance.randint(1, 3))]
    return given


def _window(chance: Random) -> Raw:
    start = chance.choice([0.0, chance.uniform(0.0, 2.0)])
    length = chance.choice([1e-9, 0.05, chance.uniform(0.1, 2.0)])
    again = {"every_s": length + chance.uniform(0.1, 1.0)} if chance.random() < 0.3 else {}
    return {"kind": "window", "from_s": start, "to_s": start + max(length, 1e-6), **again}


def _stretch(chance: Random) -> Raw:
    start, length = chance.uniform(-100.0, 50.0), chance.uniform(1.0, 100.0)
    again = {"every_m": length + chance.uniform(1.0, 50.0)} if chance.random() < 0.3 else {}
    return {
        "kind": "stretch",
        "from_m": start,
        "to_m": start + length,
        "vehicle": _vehicle(chance),
    } | again


def _circle(chance: Random) -> Raw:
    place = {"east_m": chance.uniform(-50.0, 50.0), "north_m": chance.uniform(-50.0, 50.0)}
    radius = chance.choice([0.01, 10.0, 1e5])
    return {"kind": "circle", **place, "radius_m": radius, "vehicle": _vehicle(chance)}


def _random_outage(chance: Random) -> Raw:
    on, off = chance.choice([0.001, 1.0, 86_400.0]), chance.choice([0.001, 0.2, 86_400.0])
    return {"kind": "random", "mean_on_s": on, "mean_off_s": off}


def _vehicle(chance: Random) -> str:
    return chance.choice(["sender", "receiver", "either", "both"])


def _table(chance: Random) -> Raw:
    count = chance.randint(1, 5)
    distances = sorted({round(chance.uniform(0.0, 150.0), 3) for _ in range(count)})
    table: Raw = {
        "kind": "table",
        "distance_m": distances,
        "delivery_ratio": [chance.choice([0.0, 1.0, chance.random()]) for _ in distances],
    }
    if chance.random() < 0.5:
        least = chance.choice([1, 5])
        table |= {
            "burst": "reservation",
            "keep_ratio": chance.choice([0.0, 0.4, 0.99]),
            "reselection_messages_min": least,
            "reselection_messages_max": least + chance.choice([0, 10]),
        }
    return table


def _path_loss(chance: Random) -> Raw:
    table: Raw = {"kind": "path_loss", "power_dbm": chance.choice([-300.0, -30.0, 0.0, 23.0])}
    if chance.random() < 0.5:
        table |= {"propagation": "log_distance", "exponent": chance.uniform(0.5, 10.0)}
    if chance.random() < 0.6:
        table["shadowing"] = {
            "deviation_db": chance.choice([0.0, 3.0, 60.0]),
            "decorrelation_m": chance.choice([1.0, 25.0, 10_000.0]),
        }
    if chance.random() < 0.6:
        table["obstruction"] = chance.choice(
            [{"kind": "etsi", "loss_db": 6.9}, {"kind": "3gpp", "radius_m": 10.0}]
        )
    return table


def _false(chance: Random) -> Raw:
    start = chance.choice([0.1, chance.uniform(0.01, 2.0)])
    span: Raw = {"from_s": start}
    if chance.random() < 0.5:
        span["to_s"] = start + chance.uniform(0.01, 1.0)
    far = {f"{axis}_m": chance.choice([1.0, 30.0, -1e4]) for axis in ("east", "ahead", "left")}
    return chance.choice(
        [
            {"kind": "offset", **far, **span},
            {"kind": "drift", "north_mps": chance.uniform(-5.0, 5.0), "left_mps": 1.0, **span},
            {"kind": "frozen", **span},
            {"kind": "replayed", "age_s": chance.uniform(0.01, 3.0), **span},
            {"kind": "ghost", "ahead_m": chance.uniform(-20.0, 20.0), "left_m": 3.5, **span},
        ]
    )


LAWS = {
    "loss": drawn_loss,
    "collisions": drawn_collisions,
    "delay": drawn_delay,
    "queue": drawn_queue,
    "outages": drawn_outages,
    "radio": drawn_radio,
    "content": drawn_content,
}
"""Generators of the laws of a link."""
