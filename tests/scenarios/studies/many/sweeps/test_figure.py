"""Figures have the values of summary.json."""

import json
from functools import cache
from typing import Any

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario
from scenarios.results.summary import RunSummary, to_json
from scenarios.runs.virtual import run_unlogged
from scenarios.studies.many.plan import LINK_FIELDS, VEHICLE_FIELDS, parsed_figure

NAMES = ("v1", "v2", "v3")


@cache
def run() -> RunSummary:
    overrides = ["duration_s=4", "convoy.vehicles=3", "links.loss_ratio=0.9", "convoy.gap_m=1"]
    return run_unlogged(load_scenario("lane_change", overrides))


def of(name: str) -> float | None:
    return parsed_figure(name, NAMES).of(run())


def test_figures_are_those_of_the_summary() -> None:
    whole: dict[str, Any] = json.loads(to_json(run()))
    _, v2, v3 = whole["vehicles"]
    errors = [row["cross_track_error_m_max"] for row in (v2, v3)]
    gaps = [row["true_gap_m_min"] for row in (v2, v3)]
    assert of("cross_track_error_m_max") == max(errors)
    assert of("true_gap_m_min") == min(gaps) < max(gaps)
    assert of("v2.cross_track_error_m_max") == errors[0]
    assert of("v1.cross_track_error_m_max") is None
    assert of("v3.reaction.mode_changes") == v3["reaction"]["mode_changes"] > 0
    assert of("v3.ticks_by_mode.composite") == v3["ticks_by_mode"].get("composite", 0)
    assert of("ran_s") == whole["ran_s"]
    links = {(row["sender"], row["receiver"]): row for row in whole["links"]}
    assert of("v1:v3.delivered") == links["v1", "v3"]["delivered"]
    assert of("links.age_ms_max") == max(row["age_ms_max"] or 0.0 for row in links.values())
    assert of("v1:v2.dropped.loss") == links["v1", "v2"]["dropped"]["loss"]
    assert of("v1:v2.dropped.cut") == 0
    assert of("links.safe_time_ratio.500") == min(
        row["safe_time_ratio"]["500"] for row in links.values() if row["safe_time_ratio"]
    )
    kinds = [event["kind"] for event in whole["events"]]
    assert kinds, "the run needs events"
    for kind in ("path_lost", "collision", "stop"):
        assert of(f"events.{kind}") == kinds.count(kind)


def test_every_allowed_name_has_a_value_or_none() -> None:
    for name in (*VEHICLE_FIELDS, *(f"links.{path}" for path in LINK_FIELDS)):
        value = of(name)
        assert value is None or isinstance(value, float), name


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ("cross_track_eror_m_max", "cross_track_error_m_max"),
        ("v3.distance", "v3.distance_m"),
        ("events.colision", "events.collision"),
        ("links.age_max", "links.age_ms_max"),
        ("v1:v2.los_ratio", "v1:v2.loss_ratio"),
        ("gap", "true_gap_m_min"),
        ("v7.distance_m", "distance_m"),
        ("xyz", "convoy reference fields"),
        ("", "convoy reference fields"),
    ],
)
def test_an_unknown_name_is_refused_with_similar_names(text: str, near: str) -> None:
    with pytest.raises(ScenarioError) as error:
        parsed_figure(text, NAMES)
    (line,) = error.value.lines
    assert line.startswith(f"--metric: unknown metric {text!r}, ")
    assert near in line
