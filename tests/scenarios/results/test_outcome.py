"""The outcome line: the most important fact first, for each end of a run."""

from dataclasses import replace
from typing import Any

import pytest

from scenarios.results.outcome import with_outcome_line
from scenarios.results.record import RecordHole
from scenarios.results.run_event import RunEvent
from scenarios.results.summary import LimitFigure, RunIdentity, RunSummary
from scenarios.results.vehicle_figures import vehicle_summaries
from tests.made.scenarios.tables import run_of


def vehicles(**second: Any) -> tuple[Any, ...]:
    """Summaries of v1 to v4, of which v4 is the furthest off and v2 has other figures."""
    lead, *followers = vehicle_summaries(run_of(count=4), {})
    errors = (0.02, 0.05, 0.062)
    rows = [
        replace(one, cross_track_error_m_max=error, ticks=1000)
        for one, error in zip(followers, errors, strict=True)
    ]
    return lead, replace(rows[0], **second), *rows[1:]


def event(kind: Any, at_s: float, *names: str, **figures: float) -> RunEvent:
    return RunEvent(kind=kind, at_s=at_s, vehicles=names, figures=figures)


def line(**changed: Any) -> str:
    run = RunSummary(
        identity=RunIdentity(scenario="trial", seed=1, clock="wall", run_id="x", versions={}),
        outcome="failed" if changed.get("reason") else "completed",
        reason="",
        duration_s=35.0,
        ran_s=35.0,
        recorder_rejected_messages={},
        vehicles=vehicles(),
    )
    return with_outcome_line(replace(run, **changed)).outcome_line


LEFT = tuple(event("lane_departure", 6.0, name) for name in ("v2", "v3", "v2", "v4"))
COLLIDED = event("collision", 9.0, "v2", "v3", closing_speed_mps=3.0)
BRAKED = event("hard_braking", 10.3, "v3", braking_mps2_max=6.0)
BEHIND = event("falls_behind", 12.8, "v3", gap_excess_m_max=332.4)
STOOD = event("stranded", 9.0, "v2", duration_s=26.0)
KEPT = LimitFigure(limit="collisions_max", bound=0, value=0)
UNMEASURED = LimitFigure(limit="modes[0]", bound=1.0, value=None)
HOLE = RecordHole(vehicle="v1", from_s=2.0, to_s=6.7, poses=95)


@pytest.mark.parametrize(
    ("changed", "facts"),
    [
        ({}, ["OK:", "4 vehicles", "35.0 s", "6.2 cm (v4)", "no events"]),
        ({"limits": (KEPT, UNMEASURED)}, ["OK:", "1 kept", "1 not measured"]),
        ({"holes": (HOLE,)}, ["OK (95 poses"]),
        ({"vehicles": vehicles(late_ticks=60)}, ["OK (2 %"]),
        ({"vehicles": vehicles(silent_from_s=7.0)}, ["v2 silent from 7.00 s"]),
        ({"vehicles": vehicles(silent_from_s=7.0), "outcome": "running"}, ["RUNNING", "6.2 cm"]),
        ({"events": LEFT}, ["3 of 4 vehicles", "worst v4 6.2 cm", "0 collisions"]),
        ({"events": (*LEFT, COLLIDED)}, ["1 collision", "v2 and v3 at 9.00 s", "3 of 4"]),
        ({"events": (event("stop", 7.5, "v3"),)}, ["1 of 4", "first v3 at 7.50 s"]),
        ({"events": (BRAKED,)}, ["v3", "6.0 m/s²", "at 10.30 s"]),
        ({"events": (BRAKED, BEHIND)}, ["v3 falls behind", "332 m", "hard braking"]),
        ({"events": (BEHIND, STOOD)}, ["v2 stands for 26 s", "falls behind"]),
        ({"reason": "a; b; c", "ran_s": 12.34}, ["FAILED: a", "2 more", "12.3 of 35.0 s"]),
        ({"reason": "a", "outcome": "incomplete"}, ["INCOMPLETE: a", "6.2 cm"]),
    ],
)
def test_the_line_has_the_facts_the_most_important_first(
    changed: dict[str, Any], facts: list[str]
) -> None:
    text = line(**changed)
    places = [text.find(fact) for fact in facts]
    assert places[0] == 0
    assert places == sorted(places)
