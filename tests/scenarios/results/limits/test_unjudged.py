"""A limit over figures with a hole in the log is not judged, and the run has failed."""

from collections.abc import Callable, Iterator

import pytest

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.log_summary import summarise
from scenarios.results.summary import RunIdentity, RunSummary, from_json, to_json
from scenarios.results.tables import Collector, RunTables
from tests.made.scenarios.messages import STRAIGHT, gps, health, start, tracking, truth
from transport.topics import valid_at
from vehicles.messages import GpsPose, Message, Tracking, TruePose
from vehicles.schedule import SECOND

NAMES = ("v1", "v2", "v3", "v4")
SECONDS = 10
IDENTITY = RunIdentity(scenario="made", seed=1, clock="wall", run_id="made", versions={})
Keep = Callable[[Message], bool]


def scenario_with(*limits: str) -> Scenario:
    text = STRAIGHT.replace("duration_s = 20.0", f"duration_s = {SECONDS}.0")
    return scenario_from_text("\n".join([text, "[limits]", *limits]))


def messages(mode: Callable[[str, int], str] = lambda _name, _k: "composite") -> Iterator[Message]:
    """Four vehicles on a straight road, 20 m apart; `mode` by vehicle and control step."""
    yield start()
    for k in range(50 * SECONDS):
        for place, name in enumerate(NAMES):
            distance = 0.4 * k - 20.0 * place
            yield truth(name, k, distance, 0.0, distance=distance)
            yield tracking(name, k, mode=mode(name, k))
            if k < 20 * SECONDS:
                yield gps(name, k)
    for name in NAMES:
        yield health(name, 0, seconds=1.0)
        yield health(name, 1, seconds=SECONDS, final=True)


def run_of(scenario: Scenario, keep: Keep = lambda _: True, **more: object) -> RunSummary:
    collector = Collector()
    for message in messages(**more):  # type: ignore[arg-type]
        if keep(message):
            collector.listen(valid_at(message), message)
    run = RunTables(scenario, collector.tables(), SECONDS * SECOND)
    summary = summarise(IDENTITY, run, reason="", rejected={})
    read = from_json(to_json(summary))
    assert (read.limits, read.events) == (summary.limits, summary.events)
    return summary


def lacks(kind: type[Message], vehicles: tuple[str, ...], begin: int, end: int) -> Keep:
    """Keep all but the messages of a kind with some numbers."""
    return lambda one: (
        not (isinstance(one, kind) and one.vehicle in vehicles and begin <= one.seq < end)
    )


LIMITS = ("collisions_max = 0", "cross_track_error_m_max = 0.5", "true_gap_m_min = 1.0")
FOUR_SECONDS = lacks(TruePose, NAMES, 150, 350)
GAPS = ("true_gap_m_min = 1.0", "stops_max = 0", "friction_ratio_max = 0.9")
ERRORS = ("cross_track_error_m_max = 0.5", "friction_ratio_max = 0.9")
FRICTION = ("friction_ratio_max = 0.9",)


def silent_from_6_s(one: Message) -> bool:
    return one.vehicle != "v3" or (getattr(one, "seq", 0) < 300 and not _is_final(one))


def until_9_3_s(one: Message) -> bool:
    """A router lost at 9.3 s: neither final counters nor the last poses are recorded."""
    rate = 20 if isinstance(one, GpsPose) else 50
    return getattr(one, "seq", 0) < 9.3 * rate and not _is_final(one)


Unjudged = set[tuple[str, str]]
"""Limits that are not judged, each with its vehicle."""


@pytest.mark.parametrize(
    ("limits", "keep", "unjudged"),
    [
        (LIMITS, lacks(TruePose, ("v3",), 0, 50 * SECONDS),
         {("collisions_max", ""), ("true_gap_m_min", "v3"),
          ("cross_track_error_m_max", "v3"), ("cross_track_error_m_max", "v4")}),
        (LIMITS, FOUR_SECONDS,
         {("collisions_max", ""), *((key, name) for name in NAMES[1:]
                                    for key in ("cross_track_error_m_max", "true_gap_m_min"))}),
        ((*LIMITS, "holes_s_max = 3.9"), FOUR_SECONDS,
         {("collisions_max", ""), *((key, name) for name in NAMES[1:]
                                    for key in ("cross_track_error_m_max", "true_gap_m_min"))}),
        ((*LIMITS, "holes_s_max = 4.1"), FOUR_SECONDS, set()),
        (GAPS, lacks(TruePose, ("v2",), 150, 160),
         {("stops_max", ""), *((key, name) for name in ("v2", "v3")
                               for key in ("true_gap_m_min", "friction_ratio_max"))}),
        # all limits need the lead's poses
        (ERRORS, lacks(TruePose, ("v1",), 150, 160),
         {*(("friction_ratio_max", one) for one in NAMES),
          *(("cross_track_error_m_max", one) for one in NAMES[1:])}),
        (FRICTION, silent_from_6_s, {("friction_ratio_max", "v3"), ("friction_ratio_max", "v4")}),
        (FRICTION, until_9_3_s, {("friction_ratio_max", name) for name in NAMES}),
    ],
)  # fmt: skip
def test_limits_that_need_missing_messages_are_not_judged_and_fail_the_run(
    limits: tuple[str, ...], keep: Keep, unjudged: Unjudged
) -> None:
    summary = run_of(scenario_with(*limits), keep)
    assert {(one.limit, one.vehicle) for one in summary.limits if not one.judged} == unjudged
    assert (summary.outcome == "failed") == bool(unjudged)
    for one in summary.limits:
        if one.limit == "holes_s_max":
            assert one.value == pytest.approx(4.0, abs=0.02)


def test_a_broken_limit_stays_broken() -> None:
    summary = run_of(scenario_with("true_gap_m_min = 18.0"), FOUR_SECONDS)
    assert summary.outcome == "failed"
    assert all(limit.judged for limit in summary.limits)


def test_the_last_second_is_a_hole_too() -> None:
    summary = run_of(scenario_with(), until_9_3_s)
    assert {(hole.vehicle, hole.poses) for hole in summary.holes} == {(name, 14) for name in NAMES}


def _is_final(one: Message) -> bool:
    return bool(getattr(one, "final", False))


def test_events_that_began_in_a_hole_have_an_interval() -> None:
    """A stop from 4 s on, of which decisions from 3 to 5 s are missing."""

    def mode(name: str, k: int) -> str:
        return "stop" if name == "v3" and k >= 200 else "composite"

    seen = run_of(scenario_with(), mode=mode)
    stops = [event for event in seen.events if event.kind == "stop"]
    assert [(event.after_s, event.at_s) for event in stops] == [(None, 4.0)]
    torn = run_of(scenario_with(), lacks(Tracking, ("v3",), 150, 250), mode=mode)
    (stop,) = (event for event in torn.events if event.kind == "stop")
    assert [stop.after_s, stop.at_s] == pytest.approx([2.98, 5.0])
    assert "between 2.98 and 5.00 s" in stop.line
    assert "between 2.98 and 5.00 s" in torn.outcome_line
    other = run_of(scenario_with(), lacks(Tracking, ("v2",), 150, 250), mode=mode)
    assert next(event.after_s for event in other.events if event.kind == "stop") is None


@pytest.mark.parametrize(
    ("late", "allowed", "judged"),
    [(0.9, "", True), (1.2, "", False), (1.2, "late_s_max = 2.0", True)],
)
def test_a_vehicle_that_was_driven_late_is_not_judged(
    late: float, allowed: str, judged: bool
) -> None:
    scenario = scenario_with(*LIMITS, *filter(None, [allowed]))
    collector = Collector()
    for message in (*messages(), health("v2", 2, seconds=SECONDS, lateness_ms_max=1000.0 * late)):
        collector.listen(valid_at(message), message)
    run = RunTables(scenario, collector.tables(), SECONDS * SECOND)
    summary = summarise(IDENTITY, run, reason="", rejected={})
    assert (summary.outcome == "completed") == judged
    unjudged = {limit.vehicle for limit in summary.limits if not limit.judged}
    assert ("v2" in unjudged) == (not judged)
    assert judged or "v2 was driven up to 1.20 s late" in summary.reason


def test_a_run_that_lacks_many_poses_is_incomplete() -> None:
    few = run_of(scenario_with(), lacks(GpsPose, ("v3",), 40, 47))
    assert few.outcome == "completed"
    many = run_of(scenario_with(), lacks(GpsPose, ("v3",), 40, 90))
    assert many.outcome == "incomplete"
    assert many.outcome_line.startswith("INCOMPLETE: 50 of 800 poses not recorded")
