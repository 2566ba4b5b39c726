import json
import math
import platform
from dataclasses import fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import get_args

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.versions import PACKAGES
from scenarios.results.events import EventKind
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import late_lines, scenario_in, summary_of
from scenarios.results.summary import (
    ENTRIES,
    SCHEMA,
    RunIdentity,
    RunSummary,
    documented_fields,
    from_json,
    to_json,
)
from scenarios.results.summary_columns import EVENT_FIGURES
from scenarios.results.vehicle_figures import vehicle_summaries
from scenarios.runs.live import LiveRun
from scenarios.runs.run_log import RunLog
from tests.made.scenarios.messages import START, at, gps, health, text, tracking, truth, verdict
from tests.made.scenarios.tables import run_of
from transport.codec import encode
from transport.log.errors import LogError
from transport.log.mcap_file import repair
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import TOPIC_OF, key
from vehicles.messages import Message

LINKS = [
    "links.latency_ms=30",
    'link=[{sender="v1", receiver="v3", loss_ratio=0.25}]',
]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("lane_change", ["duration_s=5", "convoy.vehicles=3", *LINKS], seed=3)


def written(scenario: Scenario, folder: Path) -> RunLog:
    live = LiveRun(scenario)
    run = RunLog(scenario, folder, clock="wall", run_id="today", live=live, observers=[live])
    run.start(START, START)
    for seq in range(40):
        for name in scenario.vehicle_names:
            sound: list[Message] = [
                truth(name, seq, 0.6 * seq, 0.0),
                tracking(name, seq, lateral_error_m=0.01 * seq),
                gps(name, seq),
                verdict("v1", name, seq, dropped="" if seq % 4 else "loss"),
            ]
            for message in sound[: 3 if name == "v1" else 4]:
                run.recorder.accept(
                    key(name, TOPIC_OF[type(message)]), encode(message), at(seq / 20)
                )
    return run


def test_a_run_is_known_by_scenario_seed_clock_and_versions(scenario: Scenario) -> None:
    identity = RunIdentity.here(scenario, "wall", "today")
    what = identity.metadata()
    assert what["schema"] == SCHEMA
    assert (what["scenario"], what["seed"], what["run_id"]) == ("lane_change", "3", "today")
    assert what["python"] == platform.python_version()
    assert {name: what[name] for name in PACKAGES} == {name: version(name) for name in PACKAGES}
    assert all(isinstance(value, str) for value in what.values())  # metadata of a log are texts
    assert RunIdentity.of_values(what) == RunIdentity.of_values(identity.values()) == identity


def test_a_summary_survives_a_round_trip_through_json(scenario: Scenario, tmp_path: Path) -> None:
    run = written(scenario, tmp_path)
    run.end(at(5.0), "")
    summary = run.close(at(5.0))
    text = to_json(summary)
    assert from_json(text) == summary
    assert to_json(from_json(text)) == text
    assert json.loads(text)["links"][0]["requested"] == scenario.links["v1", "v2"].model_dump()


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_a_summary_is_json_whatever_was_measured(
    scenario: Scenario, tmp_path: Path, wrong: float
) -> None:
    run = written(scenario, tmp_path)
    run.end(at(5.0), "")
    summary = run.close(at(5.0))
    lead = replace(summary.vehicles[0], distance_m=wrong)
    link = replace(summary.links[0], latency_ms_max=wrong)
    text = to_json(replace(summary, vehicles=(lead,), links=(link,)))

    def refuse(word: str) -> None:
        pytest.fail(f"{word} is no JSON")

    values = json.loads(text, parse_constant=refuse)
    assert values["vehicles"][0]["distance_m"] is None
    assert values["links"][0]["latency_ms_max"] is None
    assert math.isnan(from_json(text).vehicles[0].distance_m)


def test_the_summary_of_an_incomplete_log_is_computed_from_its_messages(
    scenario: Scenario, tmp_path: Path
) -> None:
    whole = written(scenario, tmp_path / "whole")
    whole.end(at(2.0), "stopped by SIGTERM")
    expected = whole.close(at(2.0))
    broken = written(scenario, tmp_path / "broken")
    broken.flush()
    log = tmp_path / "broken" / LOG_NAME
    found = summary_of(log)
    assert (found.outcome, found.reason) == ("failed", "the log breaks off")
    assert found.ran_s == pytest.approx(39 / 20)
    assert found.outcome_line.startswith("FAILED: the log breaks off; ran 1.9 of 5.0 s; ")
    of_the_end = replace(found, reason=expected.reason, ran_s=expected.ran_s)
    assert found.log_faults.endswith("was not completed")
    of_the_end = replace(of_the_end, outcome_line=expected.outcome_line, log_faults="")
    assert of_the_end == expected
    assert found.links[1].loss_ratio == 0.25
    # A repaired log is complete, but has no summary either.
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(log.read_bytes())
    assert repair(copy)
    repaired = summary_of(copy)
    assert repaired.log_faults.endswith("was not completed, and repaired")
    assert replace(repaired, log_faults=found.log_faults) == found
    broken.end(at(2.0), "")
    broken.close(at(2.0))


def test_a_log_without_its_scenario_is_refused_in_one_line(tmp_path: Path) -> None:
    log = tmp_path / "foreign.mcap"
    with LogWriter(log) as writer:
        writer.write(START, text("v1", 0, "hello"))
    with pytest.raises(LogError, match="holds no scenario") as refused:
        summary_of(log)
    assert str(log) in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_the_scenario_of_a_log_is_the_one_that_ran(scenario: Scenario, tmp_path: Path) -> None:
    run = written(scenario, tmp_path)
    run.end(at(5.0), "")
    run.close(at(5.0))
    log = tmp_path / LOG_NAME
    again = scenario_in(LogReader(log))
    assert again.tables == scenario.tables
    assert again.text == scenario.text


def test_each_field_is_documented() -> None:
    identity = RunIdentity.here(load_scenario("lane_change"), "wall", "today").values()
    own = {one.name for one in fields(RunSummary)} - {"identity"}
    lists = {group.removesuffix("[]") for group in ENTRIES if group.endswith("[]")}
    expected = {"summary.json": {*identity, *own} - lists}
    expected |= {group: {one.name for one in fields(kind)} for group, kind in ENTRIES.items()}
    docs = documented_fields()
    assert {group: set(found) for group, found in docs.items()} == expected
    for kind in get_args(EventKind):
        assert kind in docs["events[]"]["kind"]
    for figure in EVENT_FIGURES:
        assert figure in docs["events[]"]["figures"]


@pytest.mark.parametrize(("late", "reported"), [(10, []), (11, ["1.1 %"]), (500, ["50 %"])])
def test_a_run_that_did_not_keep_up_has_a_warning(late: int, reported: list[str]) -> None:
    """From more than one tick in a hundred on, of all vehicles together."""
    reports = (
        health("v1", 1, ticks=500, final=True),
        health("v2", 1, ticks=500, late_ticks=late, lateness_ms_max=31.4, final=True),
    )
    lines = list(late_lines(vehicle_summaries(run_of(*reports, count=2), {})))
    assert [
        line.partition(" of the ticks began late, by up to 31 ms (v2)")[0] for line in lines
    ] == (reported)


def test_the_summary_of_a_running_run_has_no_failure(scenario: Scenario, tmp_path: Path) -> None:
    run = written(scenario, tmp_path)
    run.flush()
    found = summary_of(tmp_path / LOG_NAME, running=True)
    assert (found.outcome, found.reason) == ("running", "")
    assert found.outcome_line.startswith("RUNNING: 1.9 of 5.0 s; ")
    run.end(at(2.0), "")
    run.close(at(2.0))
