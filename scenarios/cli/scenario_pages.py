"""Reference pages about scenario files: scenario, links, presets, gnss, degradation, limits."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from scenarios.cli.table_keys import (
    models_at,
    print_section,
    print_text,
    scenario_tables,
    tables_at,
)
from scenarios.definition.channel.presets import presets, read_preset
from scenarios.definition.schema.limit_rows import LIMITS
from scenarios.definition.schema.settings_table import keys_with
from vehicles.car.gnss_settings import PRESETS, GnssSettings
from vehicles.driver.modes import FINDINGS, STATES, TRANSITIONS
from vehicles.messages import MODES, OVERRIDES, State


def _print_tables(key: str) -> None:
    for table in tables_at(key):
        reason = getattr(table.model, "reason", None)
        drops = f" Drops messages with the reason {reason}." if reason else ""
        print_section(table.place, table.keys.items(), table.text + drops)


OTHER_PAGES = ("links", "link", "gnss", "control.degradation", "limits")
"""Tables that have pages of their own."""


def scenario_page() -> None:
    print_text(
        "The keys of a scenario file. A key ends in its unit. A ratio has no unit; most are from 0 "
        "to 1. Headings are compass courses. Curvature, steering and lateral offsets are positive "
        "to the left. Links, gnss, degradation and limits have pages of their own."
    )
    for table in scenario_tables():
        if not table.place.startswith(tuple(f"[{key}{end}" for key in OTHER_PAGES for end in ".]")):
            print_section(table.place, table.keys.items(), table.text)


def links_page() -> None:
    print_text(
        "The keys of [links] apply to all links. An entry of [[link]] replaces them for the links "
        'from `sender` to `receiver`: vehicle names, roles (lead, predecessor, follower), or "*" '
        "for any vehicle. The most specific entry applies. Delays add up; a message is lost if any "
        "law drops it."
    )
    _print_tables("links")
    (entry,) = models_at("link")
    own = entry.model_fields.keys() - models_at("links")[0].model_fields.keys()
    keys = next(table.keys for table in tables_at("link") if table.model is entry)
    text = "The ends of the links, and all keys of [links]. With a preset, [links] does not apply."
    print_section("[[link]]", [(key, text) for key, text in keys.items() if key in own], text)


def presets_page() -> None:
    print_text(
        'A preset is a complete channel: links.preset = "bursty". Other keys of [links] replace '
        "its values. `convoy channel show PRESET` compares its laws with a sample."
    )
    for name in presets():
        preset = read_preset(name)
        print_section(name, [("channel", preset.description), ("source", preset.source)])


def gnss_page() -> None:
    print_text(
        "The emulated GNSS receiver of each vehicle. [vehicle.NAME.gnss] has the same keys for one "
        "vehicle. Other keys replace the values of a preset."
    )
    for table in tables_at("gnss"):
        keys = table.keys
        if table.place.startswith("[gnss.while_"):
            keys = {key: _with_preset_default(key, text) for key, text in keys.items()}
        print_section(table.place, keys.items(), table.text)
    for name, rows in gnss_presets().items():
        print_section(f'gnss.preset = "{name}"', rows)


def _with_preset_default(key: str, text: str) -> str:
    """Replace the default of a key of `[gnss.while_...]` that the preset of the state sets."""
    if key not in keys_with(GnssSettings, PRESETS["rtk_fixed"]):
        return text
    return f"{text.partition(', default ')[0]}, default: from the preset"


def gnss_presets() -> dict[str, list[tuple[str, str]]]:
    return {
        name: [(key, _toml(value)) for key, value in keys_with(GnssSettings, figures).items()]
        for name, figures in PRESETS.items()
    }


def _toml(value: Any) -> str:
    if value is None:
        return "not set"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(entry)}' for key, entry in value.items())} }}"
    return json.dumps(value)


def degradation_page() -> None:
    print_text(
        "Reaction of a follower to missing data. Its sources are the vehicles of "
        "[information_flow], by default the lead and the predecessor. A source is fresh, late, "
        "lost, or distrusted as implausible. The follower steers along the sources that remain. "
        "Its longitudinal law acts on the predicted motion of the vehicles ahead. A source is lost "
        "after a silence that its usual losses do not explain, and used again after probation_s."
    )
    _print_tables("control.degradation")
    print_section("states of a follower", STATES.items())
    print_section("what is received", FINDINGS.items())
    rows = [(finding, _next_states(TRANSITIONS[finding])) for finding in FINDINGS]
    print_section("transitions by what is received", rows)
    reasons = [(name or "none", text) for name, text in OVERRIDES.items()]
    print_section("overrides of the longitudinal law", reasons)


def _next_states(transitions: Mapping[State, State]) -> str:
    """Next state by state, those with the same one together."""
    before: dict[State, list[str]] = {}
    for state in STATES:
        before.setdefault(transitions.get(state, state), []).append(state)
    return "; ".join(f"{', '.join(states)} → {after}" for after, states in before.items())


def limits_page() -> None:
    print_text(
        "A run that breaks a limit fails with exit code 1. [limits.NAME] has the same keys for one "
        "vehicle. Commands with --limit take the words in brackets, and figures of your own: "
        "--limit SteeringEffort_max=0.02."
    )
    print_section("bounds in [limits]", limit_texts())
    for table in tables_at("limits"):
        rows = [(key, text) for key, text in table.keys.items() if key not in LIMITS]
        print_section(table.place, rows, table.text)
    print_section("modes of a vehicle", MODES.items())


def limit_texts() -> Iterator[tuple[str, str]]:
    for key, row in LIMITS.items():
        word = f" (--limit {row.word}{'' if row.event else '=VALUE'})" if row.word else ""
        yield key, f"{row.doc}{word}"
