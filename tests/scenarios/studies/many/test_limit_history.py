"""The history of a limit agrees with the summary of the whole run."""

from itertools import pairwise
from math import inf

import pytest

from scenarios.definition.run_limits import Limit, parsed_limit
from scenarios.definition.scenario import load_scenario
from scenarios.results.limits.evaluation import broken_by, severity
from scenarios.runs.virtual.drive import drive
from scenarios.runs.virtual.unlogged_run import run_unlogged
from scenarios.studies.many.limit_history import LimitObserver, watch_limit, with_seed

SHORT = ["duration_s=2.5", "convoy.vehicles=3"]
RUNS = {
    "broken": [*SHORT, "links.loss_ratio=0.93", "control.degradation.reaction='extrapolate'",
               "path.segments=[{length_m=20.0}, {length_m=200.0, radius_m=500.0, turn='left'}]"],
    "held": [*SHORT, "links.loss_ratio=0.2"],
    "a collision ends it": [*SHORT, "links.loss_ratio=0.93", "convoy.gap_m=0.09",
                            "limits.collisions_max=0"],
    "a driver that fails": [*SHORT, "links.loss_ratio=1.0"],
}  # fmt: skip
LIMITS = (
    "lane", "error_m=0.3", "gap_m=2.5", "collision", "near_miss", "path_lost",
    "v2.lane", "v3.lane", "v2.error_m=0.3", "v3.error_m=0.3", "v2.gap_m=2.5", "v3.gap_m=2.5",
    "v1.collision", "v3.collision", "v3.path_lost", "stop", "v2.stop", "distrust",
    "road_error_m=0.3", "v1.road_error_m=0.001", "self_estimate_error_m=0.1",
    "v3.self_estimate_error_m=0.1", "blind_m=0.5", "v2.blind_m=0.5", "friction_ratio=0.1",
    "v1.friction_ratio=0.1",
)  # fmt: skip


@pytest.mark.spread(3)
@pytest.mark.parametrize("run", RUNS)
def test_broken_limits_equal_those_of_the_summary(run: str) -> None:
    scenario = load_scenario("lossy_lane_change", RUNS[run])
    summary = run_unlogged(scenario)
    limits = {text: parsed_limit(text, scenario.vehicle_names) for text in LIMITS}
    observers = {text: LimitObserver(scenario, limit) for text, limit in limits.items()}
    outcome = drive(scenario, list(observers.values()))
    for text, limit in limits.items():
        found = observers[text].finish(outcome.at)
        assert found.broken == broken_by(limit, summary), text
        if limit.row.figure and not found.broken:
            assert found.severity == pytest.approx(severity(limit, summary))


def test_a_gain_is_judged_at_the_end() -> None:
    overrides = [
        *RUNS["held"],
        "vehicle.v3.lateral_offset_m=0.4",
        "vehicle.v2.lateral_offset_m=0.2",
    ]
    scenario = load_scenario("lossy_lane_change", overrides)
    summary = run_unlogged(scenario)
    gain = summary.vehicles[2].string.lateral_gain_l2
    assert gain is not None
    for bound in (0.9 * gain, 1.1 * gain):
        limit = parsed_limit(f"v3.lateral_gain_l2={bound}", scenario.vehicle_names)
        found = watch_limit(scenario, limit)
        assert found.broken == broken_by(limit, summary) == (gain > bound)
        assert found.records[-1].at == scenario.start_at_ns + 25 * 10**8


@pytest.mark.parametrize("measure", ["limit", "silence"])
def test_severity_increases_and_a_breach_ends_the_run(measure: str) -> None:
    scenario = load_scenario("lossy_lane_change", RUNS["broken"])
    run = LimitObserver(scenario, Limit("cross_track_error_m_max", 0.3), measure=measure)  # type: ignore[arg-type]
    outcome = drive(scenario, [run], until=lambda: run.is_finished)
    records = run.finish(outcome.at).records
    assert all(a.at <= b.at and a.value < b.value for a, b in pairwise(records))
    assert records[-1].value == inf
    assert outcome.at == records[-1].at < scenario.start_at_ns + 25 * 10**8


def test_with_seed_equals_the_seed_of_the_command_line() -> None:
    again = with_seed(load_scenario("lossy_lane_change", SHORT), 9)
    limit = Limit("cross_track_error_m_max", 9.0)
    assert watch_limit(again, limit) == watch_limit(
        load_scenario("lossy_lane_change", SHORT, 9), limit
    )
