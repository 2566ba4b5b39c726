"""`convoy paper reproduce`: its runs, and its report on small cases and on made-up findings."""

import json
import re
from dataclasses import replace
from math import cos, isfinite, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.cli.paper_commands import CASES
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.studies.paper.claims import CLAIMS, JUDGEMENTS
from scenarios.studies.paper.drives import drive_trial
from scenarios.studies.paper.plots import PICTURES
from scenarios.studies.paper.report import write_report
from scenarios.studies.paper.reproduce import chosen_cases, jobs_of, reproduce, simulate
from scenarios.studies.paper.runs import (
    FIRST_CHANGE,
    LANE,
    PERIODS,
    RADII,
    ROADS,
    RUNS_OF_CASE,
    TRAJECTORIES,
    PaperRun,
    at_radius,
    at_sine,
    lane_change_lengths,
    road,
)
from tests.scenarios.studies.paper.findings import findings_with_all_claims_true
from vehicles.car.parameters import NOMINAL_GAINS

RUNS = {key: run for case in RUNS_OF_CASE.values() for key, run in case.items()}

# ---- Runs


def test_every_run_is_a_valid_scenario() -> None:
    for key, run in RUNS.items():
        if run.seed not in {None, 2}:
            continue  # differs from another run in the seed only
        scenario = run.with_trajectory("paper")
        exact = run.seed is None and not key.endswith("own_state_estimated")
        recipe = "paper_prefix" if key.endswith("paper_prefix") else "paper"
        for name in scenario.vehicle_names:
            setup = scenario.vehicle(name)
            assert (setup.steering.own_state == "exact") is exact, f"{key}: {name}"
            assert (setup.gnss.position_noise == 0.0) is (run.seed is None), f"{key}: {name}"
            assert setup.steering.trajectory == recipe, f"{key}: {name}"
        speeds = scenario.route.profile.speeds
        assert max(speeds) == min(speeds) or run.scenario == "paper_variable_speed", key


def test_all_that_claims_and_pictures_need_is_run() -> None:
    needs = {need for claim in CLAIMS for need in claim.needs}
    needs |= {need for keys, _ in PICTURES.values() for need in keys}
    assert needs <= RUNS.keys() | {"gains", "propagation"}


@pytest.mark.parametrize(
    ("case", "speed", "loads"),
    [
        ("base", 30.0, [(1, 3)] * 4),
        ("a", 10.0, [(1, 2)] * 4),
        ("b", 10.0, [(1, 0)] * 4),
        ("c", 20.0, [(1, 0)] * 4),
        ("d", 30.0, [(1, 2), (1, 2), (1, 0), (1, 0)]),
    ],
)
def test_the_cases_are_the_papers(case: str, speed: float, loads: list[tuple[int, int]]) -> None:
    scenario = load_scenario(f"paper_{case}")
    assert scenario.route.profile.speeds == (speed,)
    for name, (front, rear) in zip(scenario.vehicle_names, loads, strict=True):
        setup = scenario.vehicle(name)
        mass = setup.assumed_parameters.mass + 120.0 * (front + rear)
        assert setup.parameters.mass == pytest.approx(mass)
        assert setup.steering.controller.use == "feedforward_feedback"
        assert (setup.steering.alpha_ratio, setup.steering.fusion.use) == (0.5, "composite")
        assert tuple(setup.steering.gains.model_dump().values()) == NOMINAL_GAINS


def test_the_field_course_is_closed() -> None:
    route = load_scenario("paper_field").route
    assert route.profile.speeds == (25.0,)
    start, end = route.path.at(route.start), route.path.at(route.path.length - 60.0)
    assert (end.east, end.north) == pytest.approx((start.east, 0.0), abs=0.01)
    assert end.yaw == pytest.approx(start.yaw + 2.0 * pi, abs=1e-4)


@pytest.mark.parametrize("radius", RADII)
def test_a_lane_change_is_a_lane_wide(radius: float) -> None:
    arc, straight = lane_change_lengths(radius)
    angle = arc / radius
    sideways = 2.0 * radius * (1.0 - cos(angle)) + straight * sin(angle)
    assert sideways == pytest.approx(LANE, abs=0.01)
    assert arc <= 30.0


@pytest.mark.parametrize("case", ["a", "c"])
def test_a_road_of_the_same_times_has_the_same_lateral_acceleration(case: str) -> None:
    route = RUNS[f"{case}/same_times"].with_trajectory("fitted").route
    speed = route.profile.speeds[0]
    curvature = [route.path.at(route.start + s * speed).curvature for s in (4.9, 5.5, 20.5)]
    assert speed**2 * np.array(curvature) == pytest.approx([0.0, -1.8, 1.8], rel=1e-4)


@pytest.mark.parametrize("case", ROADS)
def test_a_shifted_road_is_the_case_s_road_moved_ahead(case: str) -> None:
    speed, first, second = ROADS[case]
    own, again, moved = (
        load_scenario(f"paper_{case}", overrides).route
        for overrides in (
            (),
            (road(500.0, 30.0, 30.0, first, second),),
            RUNS[f"{case}/phase/0.5"].overrides,
        )
    )
    assert own.profile.at(first / speed)[0] == speed
    for station in np.arange(0.0, 750.0, 0.25):
        here = own.path.at(own.start + station).curvature
        assert again.path.at(again.start + station).curvature == pytest.approx(here, abs=1e-12)
        later = moved.path.at(moved.start + station + 0.05 * speed).curvature
        assert later == pytest.approx(here, abs=1e-12)


def test_the_lead_drives_the_sine_for_all_the_periods() -> None:
    frequency = 2.5
    scenario = RUNS[at_sine(0.8, frequency)].with_trajectory("fitted")
    speed = scenario.tables.speed.set_mps
    east = np.arange(0.0, speed * scenario.duration_s, 0.5)
    last = east > east[-1] - PERIODS * 2.0 * pi * speed / frequency
    path = scenario.route.path
    heights = np.array([path.at(scenario.route.start + e).north for e in east[last]])
    assert heights.max() == pytest.approx(1.5 / frequency**2, rel=0.03)
    assert heights.min() == pytest.approx(-1.5 / frequency**2, rel=0.03)


def test_the_paper_s_trajectory_gives_the_paper_s_numbers() -> None:
    largest = {}
    for key in ("a", "c", "base", at_radius(250.0), "base/noise/1"):
        until = (FIRST_CHANGE[key],) if key in {"a", "c"} else ()
        run = RUNS[key]._replace(overrides=(*RUNS[key].overrides, *until))
        largest[key] = 100.0 * max(drive_trial(run.with_trajectory("paper")).tracking)
    assert largest["a"] == pytest.approx(4.1, abs=0.3)
    assert largest["c"] == pytest.approx(9.8, abs=0.4)
    assert largest["base"] == pytest.approx(6.8, abs=0.5)
    assert largest[at_radius(250.0)] > 12.0
    assert largest["base/noise/1"] > 9.0


def test_the_samples_of_the_base_case_are_counted(tmp_path: Path) -> None:
    short = ("duration_s=6.0", "convoy.vehicles=3", "path.segments=[{length_m=300.0}]")
    _, samples = simulate(PaperRun(short, logged=True), "fitted", "base", tmp_path)
    assert samples is not None
    assert samples.lead == 16  # 24 m of preview, a sample each 1.5 m
    assert 0 < samples.predecessor <= 16
    assert samples.rule_error == pytest.approx(0.5 * pi, abs=0.01)  # one beside the other


# ---- Reports


def numbers_in(value: Any) -> list[float]:
    if isinstance(value, dict):
        return [number for entry in value.values() for number in numbers_in(entry)]
    if isinstance(value, list):
        return [number for entry in value for number in numbers_in(entry)]
    return [value] if isinstance(value, float) else []


def test_a_whole_report_has_a_row_for_each_claim_and_every_picture(tmp_path: Path) -> None:
    findings = findings_with_all_claims_true()
    for key in RUNS:
        findings.trials.setdefault(key, findings.trials[key.partition("/phase")[0]])
    both = {"fitted": findings, "paper": replace(findings, trajectory="paper")}
    write_report(both, list(RUNS_OF_CASE), tmp_path)  # type: ignore[arg-type]
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    rows = re.findall(r"^\| .*\|$", text, flags=re.MULTILINE)
    for claim in CLAIMS:
        paper = claim.paper.replace("|", "\\|")
        assert any(f"| {paper} |" in row for row in rows), claim.name
    pictures = {f"{name}_{kind}.png" for name in PICTURES for kind in TRAJECTORIES}
    assert set(re.findall(r"!\[.*?\]\((.*?)\)", text)) == pictures == set(report["pictures"])
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in pictures)
    assert [claim["name"] for claim in report["claims"]] == [claim.name for claim in CLAIMS]
    verdicts = [claim["trajectories"]["fitted"]["verdict"] for claim in report["claims"]]
    for verdict, words in JUDGEMENTS.items():
        assert f"{verdicts.count(verdict)} {words}" in text
    assert report["runs"]["paper"].keys() == RUNS.keys()
    assert report["runs"]["fitted"]["base"]["tracking_error_m_max"] == pytest.approx(
        [0.08, 0.06, 0.05]
    )
    assert all(map(isfinite, numbers_in(report)))


def test_a_small_reproduction_from_end_to_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny = {"base": PaperRun(("duration_s=26.0", "convoy.vehicles=2"), logged=True)}
    monkeypatch.setitem(RUNS_OF_CASE, "base", tiny)
    progress: list[str] = []
    assert reproduce(["base"], tmp_path / "paper", progress.append, workers=0) == 0
    report = json.loads((tmp_path / "paper" / "report.json").read_text(encoding="utf-8"))
    claims = {claim["name"]: claim["trajectories"] for claim in report["claims"]}
    assert {row["verdict"] for row in claims["base_below_9_cm"].values()} == {"holds"}
    errors = [report["runs"][kind]["base"]["tracking_error_m_max"] for kind in ("fitted", "paper")]
    assert errors[0] < errors[1]
    assert "mass" not in claims  # it needs runs of other cases
    assert report["logs"] == [f"{kind}/base/{LOG_NAME}" for kind in ("fitted", "paper")]
    assert all((tmp_path / "paper" / name).exists() for name in report["logs"])
    assert any("2 of 2 runs" in line for line in progress)
    assert "report.md" in progress[-1]
    with pytest.raises(ScenarioError, match="exists"):
        reproduce(["base"], tmp_path / "paper", progress.append)


def test_every_run_is_a_job_with_each_trajectory_and_logged_runs_come_first(tmp_path: Path) -> None:
    jobs = list(jobs_of(chosen_cases([]), tmp_path))
    assert set(jobs) == {"gains"} | {f"{kind}/{key}" for kind in TRAJECTORIES for key in RUNS}
    assert jobs.index("paper/variable_speed") < jobs.index("fitted/base/noise/1")


def test_cases_come_in_the_order_of_the_paper_and_unknown_ones_are_refused() -> None:
    assert chosen_cases(["field", "a", "base"]) == ["base", "a", "field"]
    assert tuple(chosen_cases([])) == CASES
    with pytest.raises(ScenarioError, match=r"no such case, did you mean radius\?, allowed base"):
        chosen_cases(["radios"])
