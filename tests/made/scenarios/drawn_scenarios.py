"""Random scenarios over the whole schema, including the limits of its keys.

They can be run: paths are longer than the drive, and a run takes a few hundred steps.
"""

import math
from collections.abc import Collection, Sequence
from datetime import timedelta
from pathlib import Path
from random import Random
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import tomli_w

from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.definition.schema.plug_ins.points import LATERAL
from scenarios.definition.schema.plug_ins.table import PlugInTable
from scenarios.definition.schema.scenario_tables import (
    EPOCH,
    LATEST,
    ConvoyTable,
    EventsTable,
    GapTable,
    GnssTable,
    OriginTable,
    SpeedTable,
    SteeringTable,
)
from scenarios.definition.schema.settings_table import SettingsTable, Table
from tests.made.channels.drawn_channels import LAWS, drawn_channel, drawn_spans
from vehicles.car.gnss_error_terms import Drift
from vehicles.car.gnss_settings import StateErrors
from vehicles.car.imu import ImuSettings
from vehicles.car.parameters import Loading
from vehicles.car.sending_rules import CAM_SHARES
from vehicles.car.sensors import GapSensorSettings

Raw = dict[str, Any]
VEHICLES_MAX = 8
STEPS = 200
"""Steps of control and GNSS of all vehicles of a run, which determine its cost."""
SHARES = (0.0, 0.0, 0.2, 0.5, 1.0)
"""Shares of the keys of a table that are given."""
SEPARATE_KEYS = (*LAWS, "preset", "preset_source")
"""Keys of a link with generators of their own."""
ALL_LINKS_SHARE, ONE_LINK_SHARE = 0.12, 0.25
"""Probability of each law for all links, and for one link."""


def drawn_scenario(chance: Random, folder: Path) -> Path:
    """Write a random scenario into a file."""
    names = [f"v{place}" for place in range(1, chance.randint(1, VEHICLES_MAX) + 1)]
    tables: Raw = {"name": chance.choice(["drawn", "A", "a-b_c" * 6])}
    followers = {name: _vehicle(chance, lead=name == names[0]) for name in names}
    _put(tables, "vehicle", {name: own for name, own in followers.items() if own})
    _put(tables, "loading", drawn_table(chance, SettingsTable[Loading]))
    _put(tables, "links", _links(chance, LinkTable, ALL_LINKS_SHARE))
    if len(names) > 1:
        _put(tables, "link", [_link(chance, names) for _ in range(chance.choice([0, 0, 1, 3]))])
    _put(tables, "events", drawn_table(chance, EventsTable))
    _put(tables, "limits", drawn_table(chance, LimitsTable))
    _put(tables, "origin", drawn_table(chance, OriginTable))
    _put(tables, "gnss", _receiver(chance))
    _put(tables, "sending", _sending(chance))
    _put(tables, "imu", drawn_table(chance, SettingsTable[ImuSettings]))
    _put(tables, "gap_sensor", _gap_sensor(chance))
    if "rate_hz" in repr((tables.get("links"), tables.get("link"))):  # for even sending only
        for table in (tables, *tables.get("vehicle", {}).values()):
            table.pop("sending", None)
    tables["control"] = _steering(chance)
    if chance.random() < 0.5:
        tables["control"]["rate_hz"] = chance.choice([5.0, 500.0, chance.uniform(5.0, 200.0)])
    if chance.random() < 0.5:
        tables["seed"] = chance.choice([0, 2**63 - 1, chance.getrandbits(40)])
    if chance.random() < 0.3:
        tables["start_at"] = chance.choice([EPOCH, LATEST - timedelta(seconds=1)])
    tables["convoy"] = _convoy(chance, names)
    tables["speed"] = _speed(chance)
    tables["duration_s"] = _duration_s(chance, tables, names)
    tables["path"] = _path(chance, tables)
    path = folder / "drawn.toml"
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path


# ---- Values of the schema


def drawn_table(
    chance: Random, table: type[Table], leave_out: Collection[str] = (), share: float | None = None
) -> Raw:
    share = chance.choice(SHARES) if share is None else share
    return {
        name: value
        for name, info in table.model_fields.items()
        if name not in leave_out and chance.random() < share
        if (value := _value(chance, info.annotation, info.metadata, info.default)) is not None
    }


def _value(chance: Random, kind: Any, rules: Sequence[object], usual: object) -> object:
    origin = get_origin(kind)
    if origin is Annotated:
        inner, *more = get_args(kind)
        rules = [*rules, *(rule for extra in more for rule in getattr(extra, "metadata", [extra]))]
        return _value(chance, inner, rules, usual)
    if origin in {Union, UnionType}:
        return _value(chance, get_args(kind)[0], rules, usual)
    if origin is Literal or kind is bool:
        return chance.choice(get_args(kind) or (False, True))
    if kind in {int, float}:
        drawn = number(chance, *limits_of(rules, whole=kind is int), usual)
        return round(drawn) if kind is int else float(drawn)
    if isinstance(kind, type) and issubclass(kind, Table) and not issubclass(kind, PlugInTable):
        return drawn_table(chance, kind)
    return None


def limits_of(rules: Sequence[object], *, whole: bool) -> tuple[float, float]:
    least, most = -math.inf, math.inf
    for rule in rules:
        if (bound := getattr(rule, "ge", None)) is not None:
            least = bound
        if (bound := getattr(rule, "le", None)) is not None:
            most = bound
        if (bound := getattr(rule, "gt", None)) is not None:
            least = bound + 1 if whole else math.nextafter(bound, math.inf)
        if (bound := getattr(rule, "lt", None)) is not None:
            most = bound - 1 if whole else math.nextafter(bound, -math.inf)
    return least, most


def number(chance: Random, least: float, most: float, usual: object) -> float:
    about = usual if isinstance(usual, int | float) and usual else 1.0
    most = most if math.isfinite(most) else max(10.0 * about, 3)
    least = least if math.isfinite(least) else -most
    drawn: float = chance.choice(
        [
            least,
            most,
            about * 2.0 ** chance.uniform(-2.0, 2.0),
            about * 1.0,
            chance.uniform(least, most),
        ]
    )
    return min(max(drawn, least), most)


# ---- Tables whose keys depend on each other


def _put(tables: Raw, key: str, value: object) -> None:
    if value:
        tables[key] = value


def _convoy(chance: Random, names: Sequence[str]) -> Raw:
    table: Raw = {"vehicles": len(names)} if chance.random() < 0.7 else {"names": list(names)}
    if chance.random() < 0.7:
        table["gap_m"] = chance.choice([0.01, 1.0, 10.0, chance.uniform(0.1, 100.0)])
    return table | drawn_table(chance, ConvoyTable, ("vehicles", "names", "gap_m"))


def _vehicle(chance: Random, *, lead: bool) -> Raw:
    table: Raw = {}
    if chance.random() < 0.7:
        return table
    _put(table, "gnss", _receiver(chance, "rate_hz", "fix", "preset"))
    _put(table, "sending", _sending(chance))
    _put(table, "imu", drawn_table(chance, SettingsTable[ImuSettings], ("rate_hz",)))
    _put(table, "loading", drawn_table(chance, SettingsTable[Loading]))
    if chance.random() < 0.5:
        table["control"] = _steering(chance)
    if chance.random() < 0.5:
        table["lateral_offset_m"] = chance.choice([-20.0, 20.0, chance.uniform(-2.0, 2.0)])
        table["heading_offset_deg"] = chance.choice([-90.0, 90.0, chance.uniform(-5.0, 5.0)])
    if chance.random() < 0.3:
        table[chance.choice(["transmitter_off", "receiver_off"])] = drawn_spans(chance)
    if not lead:
        _put(table, "gap_sensor", _gap_sensor(chance))
    if not lead and chance.random() < 0.3:
        table["gap_m"] = chance.choice([51.0, 1000.0])
    return table


def _gap_sensor(chance: Random) -> Raw:
    table = drawn_table(chance, SettingsTable[GapSensorSettings], ("range_m",))
    if table:
        table["range_m"] = chance.choice([0.0, 1000.0, chance.uniform(0.0, 100.0)])
    return table


def _receiver(chance: Random, *leave_out: str) -> Raw:
    apart = ("entry_jump_m", "fix_states", "while_fixed", "while_float", "while_single")
    table = drawn_table(chance, GnssTable, (*apart, *leave_out))
    for key in ("drift", "common_drift"):
        if key in table:
            table[key] |= drawn_table(chance, SettingsTable[Drift], share=1.0)
    if "drift" in table and chance.random() < 0.5:
        table["entry_jump_m"] = chance.uniform(0.0, 2.0)
    fix = table.get("fix", "float" if table.get("preset") == "rtk_float" else "fixed")
    if chance.random() < 0.2 and not leave_out and fix != "single" and "preset" not in table:
        entry = {"at_s": chance.uniform(0.0, 2.0), "state": "single"}
        chain = [{"state": fix, "to": "single", "mean_s": chance.uniform(0.01, 2.0)}]
        table["fix_states"] = chance.choice(
            [{"kind": "schedule", "entries": [entry]}, {"kind": "chain", "transitions": chain}]
        )
        errors = drawn_table(chance, SettingsTable[StateErrors], ("entry_jump_m", "drift"))
        _put(table, "while_single", errors)
    if chance.random() < 0.2:
        table["outages"] = [{"kind": "time", "from_s": 0.0, "to_s": chance.uniform(0.1, 1.0)}]
    return table


def _sending(chance: Random) -> Raw:
    """A sending rule, most often the default."""
    if chance.random() < 0.7:
        return {}
    busy = [{"at_s": chance.uniform(0.0, 1.0), "busy_ratio": chance.random()}]
    dcc = {"dcc": {"busy": busy}} if chance.random() < 0.3 else {}
    rate_hz = chance.choice([0.01, 100.0, chance.uniform(1.0, 30.0)])
    profile = [{"at_s": 0.0, "rate_hz": rate_hz}, {"at_s": 0.5, "rate_hz": chance.uniform(0, 30)}]
    rule: Raw = chance.choice(
        [
            {"kind": "every_fix"},
            {"kind": "fixed", "rate_hz": rate_hz, "drawn_phase": chance.random() < 0.5},
            {"kind": "profile", "profile": profile},
            {"kind": "cam", "check_period_ms": chance.uniform(10.0, 100.0)},
            {"kind": "intervals", "table": chance.choice(tuple(CAM_SHARES))},
        ]
    )
    return rule | dcc


def _steering(chance: Random) -> Raw:
    table = drawn_table(chance, SteeringTable)
    if chance.random() < 0.5:
        table["controller"] = chance.choice([*LATERAL.shipped, *LATERAL.short_names])
    return table


def _link(chance: Random, names: Sequence[str]) -> Raw:
    receiver = chance.randrange(1, len(names))
    sender = chance.choice([names[0], names[receiver - 1], "*"])
    entry = {"sender": sender, "receiver": chance.choice([names[receiver], names[receiver], "*"])}
    return entry | _links(chance, LinkEntry, ONE_LINK_SHARE)


def _links(chance: Random, table: type[Table], share: float) -> Raw:
    apart = ("sender", "receiver", *SEPARATE_KEYS)
    return drawn_table(chance, table, apart) | drawn_channel(chance, share)


def _speed(chance: Random) -> Raw:
    table = drawn_table(chance, SpeedTable, ("lead", "profile", "gap"))
    table["lead"] = chance.choice(["set", "set", "profile", "recorded"])
    if table["lead"] == "profile":
        times = sorted({round(chance.uniform(0.0, 3.0), 3) for _ in range(chance.randint(1, 4))})
        table["profile"] = [
            {"at_s": at, "speed_mps": chance.choice([0.0, 100.0, chance.uniform(0.0, 30.0)])}
            for at in times
        ]
    _put(table, "gap", drawn_table(chance, GapTable))
    return table


def _duration_s(chance: Random, tables: Raw, names: Sequence[str]) -> float:
    rates = tables["control"].get("rate_hz", 50.0) + tables.get("gnss", {}).get("rate_hz", 20.0)
    rates += tables.get("imu", {}).get("rate_hz", 0.0)
    rates += max(
        own.get("gap_sensor", {}).get("rate_hz", 0.0)
        for own in (tables, *tables.get("vehicle", {}).values())
    )
    affordable: float = STEPS / (rates * len(names))
    return round(max(min(chance.choice([1.0, 2.0, 3.0]), affordable), 0.02), 3)


def _path(chance: Random, tables: Raw) -> Raw:
    speed = tables["speed"]
    fastest = max(
        speed.get("set_mps", 20.0), *(p["speed_mps"] for p in speed.get("profile", [])), 1.0
    )
    length_m = fastest * tables["duration_s"] * chance.uniform(1.01, 3.0) + 5.0
    is_timed = speed["lead"] == "recorded"
    if is_timed or chance.random() < 0.5:
        return _points(chance, tables["duration_s"], length_m, timed=is_timed)
    count, laps = chance.randint(1, 4), chance.choice([1, 1, 3, 1000])
    pieces = [_segment(chance, max(length_m / count / laps, 0.1)) for _ in range(count)]
    heading_deg = chance.choice([0.0, math.nextafter(360.0, 0.0), chance.uniform(0, 359)])
    return {"kind": "segments", "segments": pieces, "laps": laps, "heading_deg": heading_deg}


def _segment(chance: Random, length_m: float) -> Raw:
    bent = {"curvature_per_m": chance.choice([-1.0, 1.0, 0.0, chance.uniform(-0.05, 0.05)])}
    radius_m = chance.choice([1.0, 1e6, chance.uniform(5.0, 500.0)])
    turning = {"turn": chance.choice(["left", "right"]), "radius_m": radius_m}
    form: Raw = chance.choice([{}, bent, turning])
    return {"length_m": length_m} | form


def _points(chance: Random, duration_s: float, length_m: float, *, timed: bool) -> Raw:
    count = chance.randint(20, 200)
    step = max(length_m / count, 0.5)
    swing, wavelength = chance.uniform(0.0, 3.0), chance.uniform(20.0, 100.0)
    east = [k * step for k in range(count + 1)]
    north = [swing * math.sin(x / wavelength) for x in east]
    times = [k * 2.0 * duration_s / count for k in range(count + 1)]
    smoothing = {} if chance.random() < 0.5 else {"smoothing_m": chance.uniform(1.0, 20.0)}
    more = {"time_s": times} if timed else {}
    return {"kind": "points", "east_m": east, "north_m": north, **more, **smoothing}
