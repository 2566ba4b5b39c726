"""Rows of a drill: the worst value of each limit over all seeds, and its margin."""

from typing import Any
from xml.etree import ElementTree as Xml

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.results.summary import LimitFigure
from scenarios.studies.drill import (
    UNMEASURED,
    DrillResult,
    DrillRow,
    as_xml,
    drill_rows,
    drill_variants,
    machine_readable,
    rows_of_drill,
    run_drills,
)
from scenarios.studies.job import Job
from tests.made.many.engines import SyntheticEngine


def limit(figure: float | None, name: str = "cross_track_error_m_max", **more: Any) -> LimitFigure:
    return LimitFigure(limit=name, bound=0.5, value=figure, vehicle="v3", **more)


def run(*limits: LimitFigure, seed: int = 1, drill: str = "one", other: str = "") -> DrillResult:
    command = f"convoy run {drill} --seed {seed} --clock virtual"
    return DrillResult(
        drill=drill, seed=seed, limits=limits, other_reason=other, command=command, duration_s=0.25
    )


def only_row(*runs: DrillResult) -> DrillRow:
    (row,) = rows_of_drill(runs)
    return row


def test_the_value_is_the_worst_of_all_vehicles_and_seeds() -> None:
    runs = [
        run(limit(0.2), limit(0.3), seed=1),
        run(limit(0.4), limit(0.1), seed=2),
        run(limit(0.25), seed=3),
    ]
    row = only_row(*runs)
    assert (row.value, row.seed, row.passed) == (0.4, 2, True)
    assert row.margin_ratio == pytest.approx(0.2)
    assert row.command == "convoy run one --seed 2 --clock virtual"


def test_a_broken_limit_has_a_negative_margin_and_a_message() -> None:
    row = only_row(run(limit(0.3)), run(limit(0.75, message="too far"), seed=2))
    assert (row.passed, row.value, row.message) == (False, 0.75, "too far")
    assert row.margin_ratio == pytest.approx(-0.5)


def test_a_missing_reaction_is_worse_than_a_late_one() -> None:
    late = limit(0.9, "modes[0]", action="in mode stop", message="late")
    never = limit(None, "modes[0]", action="in mode stop", message="never")
    row = only_row(run(late), run(never, seed=2))
    assert (row.message, row.value, row.margin_ratio, row.passed) == ("never", None, None, False)
    assert row.label == "v3 in mode stop, within 0.5 s"


def test_an_unmeasured_limit_fails() -> None:
    row = only_row(run(limit(None)))
    assert not row.passed
    assert row.message == f"limits.cross_track_error_m_max {UNMEASURED}"


def test_another_failure_has_a_separate_row() -> None:
    first, second = rows_of_drill([run(limit(0.3), other="v2 failed")])
    assert (first.limit, first.passed, first.message, first.label) == (
        "run",
        False,
        "v2 failed",
        "run",
    )
    assert second.passed


def test_a_scenario_without_limits_is_not_a_drill() -> None:
    with pytest.raises(ScenarioError, match=r"^lane_change: limits: missing, .*collisions_max"):
        drill_variants("lane_change")
    with pytest.raises(ScenarioError, match="limits: missing"):
        drill_variants("lane_change", ['limits.after_collision="end"'])
    (one,) = drill_variants("lane_change", ["limits.collisions_max=0", "seed=7"])
    assert one.seed == 7
    assert [one.seed for one in drill_variants("tunnel", seeds=(1, 2, 3))] == [1, 2, 3]


def test_each_drill_is_simulated_once() -> None:
    variants = [*drill_variants("tunnel", seeds=(1, 2)), *drill_variants("lead_lost", seeds=(1,))]

    def result(job: Job) -> DrillResult:
        name, seed = job.key.split()
        return run(limit(0.1), drill=name, seed=int(seed))

    found = run_drills(variants, SyntheticEngine(result))
    assert [(one.drill, one.seed) for one in found] == [
        ("tunnel", 1),
        ("tunnel", 2),
        ("lead_lost", 1),
    ]
    assert found[0] == run(limit(0.1), drill="tunnel", seed=1)


# ---- JSON and XML


RUNS = [
    run(limit(0.3), limit(0.2, "modes[0]", action="in mode stop"), drill="good"),
    run(limit(0.75, message="v3 was <far> & off"), drill="bad"),
    run(drill="odd", other="v2 failed"),
]


def test_xml_has_a_case_for_each_limit_and_failure_messages() -> None:
    rows = drill_rows(RUNS)
    root = Xml.fromstring(Xml.tostring(as_xml(rows, RUNS)))
    assert root.tag == "testsuites"
    assert (root.get("tests"), root.get("failures"), root.get("time")) == ("4", "2", "0.750")
    suites = {one.get("name"): one for one in root}
    assert [*suites] == ["good", "bad", "odd"]
    cases = suites["good"].findall("testcase")
    assert [one.get("name") for one in cases] == [
        "cross_track_error_m_max = 0.5",
        "v3 in mode stop, within 0.5 s",
    ]
    assert all(one.get("classname") == "good" and one.find("failure") is None for one in cases)
    assert (cases[0].findtext("system-out") or "").startswith("value 0.3, margin 0.400")
    assert [one.get("time") for one in cases] == ["0.250", "0.250"]
    failure = suites["bad"].find("testcase/failure")
    assert failure is not None
    assert failure.get("message") == "v3 was <far> & off"
    assert "convoy run bad --seed 1 --clock virtual" in (failure.text or "")
    assert suites["odd"].find("testcase/failure") is not None


def test_json_has_rows_and_runs() -> None:
    found = machine_readable(drill_rows(RUNS), RUNS)
    assert found["schema"] == "convoy.drills/1"
    assert found["passed"] is False
    assert [row["passed"] for row in found["rows"]] == [True, True, False, False]
    assert [one["drill"] for one in found["runs"]] == ["good", "bad", "odd"]
    assert "duration_s" not in found["runs"][0]  # equal results give equal files
    assert machine_readable([], [])["passed"] is True


def test_the_smallest_value_of_a_lower_limit_is_the_worst() -> None:
    name = "true_gap_m_min"
    row = only_row(run(limit(0.8, name)), run(limit(0.6, name), seed=2))
    assert row.value == 0.6
    assert row.margin_ratio == pytest.approx(0.2)
