"""The outcome line: the most important fact first, for each end of a run."""

from dataclasses import replace
from typing import Any

from scenarios.results.outcome import with_outcome_line
from scenarios.results.reaction import ReactionSummary
from scenarios.results.record import RecordHole
from scenarios.results.run_event import RunEvent
from scenarios.results.summary import LimitFigure, RunIdentity, RunSummary
from scenarios.results.vehicle_figures import vehicle_summaries
from tests.made.scenarios.tables import run_of


def vehicles(*errors: float | None) -> tuple[Any, ...]:
    """Summaries of v1 and of followers with these largest errors (m)."""
    lead, *followers = vehicle_summaries(run_of(count=len(errors) + 1), {})
    return lead, *(
        replace(one, cross_track_error_m_max=error, cross_track_error_max_at_s=8.18, ticks=1000)
        for one, error in zip(followers, errors, strict=True)
    )


def event(kind: Any, at_s: float, *names: str, **figures: float) -> RunEvent:
    return RunEvent(kind=kind, at_s=at_s, vehicles=names, figures=figures)


def line(errors: tuple[float | None, ...] = (0.02, 0.05, 0.062), **changed: Any) -> str:
    run = RunSummary(
        identity=RunIdentity(scenario="trial", seed=1, clock="wall", run_id="x", versions={}),
        outcome="failed" if changed.get("reason") else changed.get("outcome", "completed"),
        reason="",
        duration_s=35.0,
        ran_s=35.0,
        recorder_rejected_messages={},
        vehicles=vehicles(*errors),
    )
    return with_outcome_line(replace(run, **changed)).outcome_line


LEFT = tuple(event("lane_departure", 6.0, name) for name in ("v2", "v3", "v2", "v4"))
STOPS = (event("stop", 7.5, "v3"), event("stop", 7.9, "v2"))
KEPT = LimitFigure(limit="collisions_max", bound=0, value=0)
UNMEASURED = LimitFigure(limit="modes[0]", bound=1.0, value=None)


def test_a_run_without_events_is_ok() -> None:
    assert line() == "OK: 4 vehicles, 35.0 s, worst error 6.2 cm (v4), no events"
    assert line(limits=(KEPT,)).endswith(", no events, limits: 1 kept")
    assert line(limits=(KEPT, UNMEASURED)).endswith(", limits: 1 kept, 1 not measured")
    assert line(()) == "OK: 1 vehicle, 35.0 s, no events"
    assert line((None,)) == "OK: 2 vehicles, 35.0 s, no events"


def test_incomplete_figures_and_lateness_stand_with_the_ok() -> None:
    hole = RecordHole(vehicle="v1", from_s=2.0, to_s=6.7, poses=95)
    assert line(holes=(hole,)).startswith("OK (95 poses not recorded): 4 vehicles")
    lead, *followers = vehicles(0.02)
    late = (lead, *(replace(one, late_ticks=20) for one in followers))
    assert line(vehicles=late).startswith("OK (2 % of the ticks late): 2 vehicles")


def test_the_worst_incident_comes_first() -> None:
    errors = (2.8, 0.9, 1.2)
    assert line(errors, events=LEFT) == (
        "3 of 4 vehicles left the lane, worst v2 2.80 m at 8.18 s; 0 collisions; limits: none set"
    )
    collided = event("collision", 9.0, "v2", "v3", closing_speed_mps=3.0)
    assert line(errors, events=(*LEFT, collided), limits=(UNMEASURED,)) == (
        "1 collision, v2 and v3 at 9.00 s; 3 of 4 vehicles left the lane, worst v2 2.80 m at "
        "8.18 s; limits: 0 kept, 1 not measured"
    )
    assert line(errors, events=(collided, collided)).startswith("2 collisions, first v2 and v3 at")


def test_the_blind_distance_stands_with_the_stops() -> None:
    lead, second, *others = vehicles(0.02, 0.05, 0.062)
    blind = replace(second, reaction=ReactionSummary(stops=1, blind_m=72.94))
    assert ", first v3 at 7.50 s, up to 72.9 m blind; " in line(
        vehicles=(lead, blind, *others), events=STOPS
    )


def test_a_vehicle_without_messages_is_no_ok_unless_the_run_goes_on() -> None:
    lead, second, *others = vehicles(0.02, 0.05)
    silent = (lead, replace(second, silent_from_s=7.0), *others)
    assert line(vehicles=silent).startswith("v2 silent from 7.00 s; worst error 5.0 cm (v3)")
    assert "silent" not in line(vehicles=silent, outcome="running")


def test_a_failure_begins_with_its_reason() -> None:
    assert line(reason="v2 failed 12.3 s after the start", ran_s=12.34) == (
        "FAILED: v2 failed 12.3 s after the start; ran 12.3 of 35.0 s; worst error 6.2 cm (v4); "
        "no events"
    )
    assert line((2.8, 0.9, 1.2), reason="stopped by SIGINT; a; b", events=LEFT) == (
        "FAILED: stopped by SIGINT; 2 more reasons; ran 35.0 s; 3 of 4 vehicles left the lane, "
        "worst v2 2.80 m at 8.18 s; 0 collisions"
    )


def test_the_worst_that_a_traffic_engineer_would_notice_replaces_the_ok() -> None:
    braked = event("hard_braking", 10.3, "v3", braking_mps2_max=6.0)
    behind = event("falls_behind", 12.8, "v3", gap_excess_m_max=332.4)
    further = event("falls_behind", 14.0, "v4", gap_excess_m_max=340.0)
    rest = "; worst error 6.2 cm (v4); 0 collisions; limits: none set"
    assert line(events=(braked,)) == (
        f"v3 brakes at up to 6.0 m/s² without a cause ahead, at 10.30 s{rest}"
    )
    assert line(events=(braked, behind, further)) == (
        f"v4 falls behind by up to 340 m, at 14.00 s (2 of 4 vehicles); also: hard braking{rest}"
    )
    guarded = event("overridden", 2.0, "v2", overridden_ratio=0.31)
    assert "v2 overridden by its guard for 0.31 of the time, at 2.00 s" in line(events=(guarded,))
    stood = event("stranded", 9.0, "v2", duration_s=26.0)
    assert line(events=(guarded, stood)).startswith("v2 stands for 26 s although the lead drives")
