"""The paper's cases as scenarios, and their runs."""

from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.drives import Drive, Trial
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import scenario_in
from scenarios.runs.virtual import drive_trial, record_trial
from scenarios.studies.paper.experiments import (
    BASE,
    FIRST_CHANGE_S,
    LANE,
    RADII,
    ROADS,
    RUNS_OF_CASE,
    A,
    C,
    Experiment,
    RunKey,
    at_radius,
    at_the_same_times,
    lane_change_lengths,
    road,
)
from scenarios.studies.paper.findings import (
    PERIODS,
    SampleCounter,
    amplitudes,
    predict_errors,
    sine_scenario,
)
from scenarios.studies.paper.reproduce import as_run, field_runs, run_experiment
from tests.made.scenarios.messages import truth
from transport.log.reader import LogReader
from vehicles.car.parameters import NOMINAL_GAINS
from vehicles.messages import CompositeTrajectory, RunStart
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.linear_model import Transfer

EXPERIMENTS = {key: run for case in RUNS_OF_CASE.values() for key, run in case.items()}


def test_every_experiment_is_a_valid_scenario() -> None:
    for key, run in EXPERIMENTS.items():
        if key.seed not in {None, 2}:
            continue  # differs from another run in the seed only
        scenario = load_scenario(run.scenario, run.overrides, run.seed)
        exact = key.seed is None and key.variant != "own_state_estimated"
        for name in scenario.vehicle_names:
            setup = scenario.vehicle(name)
            assert (setup.steering.own_state == "exact") is exact, f"{key}: {name}"
            assert (setup.gnss.position_noise == 0.0) is (key.seed is None), f"{key}: {name}"
        assert max(scenario.route.profile.speeds) == min(scenario.route.profile.speeds) or (
            run.scenario == "paper_variable_speed"
        ), f"{key}: slowed down in curves"


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
        assert setup.gnss.position_noise == 0.0


def test_variable_speed_reaches_30_and_field_drives_25() -> None:
    assert max(load_scenario("paper_variable_speed").route.profile.speeds) == 30.0
    assert load_scenario("paper_field").route.profile.speeds == (25.0,)


def test_the_field_course_is_closed() -> None:
    path = load_scenario("paper_field").route.path
    start = load_scenario("paper_field").route.start
    end = path.at(path.length - 60.0)
    assert (end.east, end.north) == pytest.approx((path.at(start).east, 0.0), abs=0.01)
    assert end.yaw == pytest.approx(path.at(start).yaw + 2.0 * pi, abs=1e-4)


@pytest.mark.parametrize("radius", RADII)
def test_a_lane_change_is_a_lane_wide(radius: float) -> None:
    arc, straight = lane_change_lengths(radius)
    angle = arc / radius
    sideways = 2.0 * radius * (1.0 - cos(angle)) + straight * sin(angle)
    assert sideways == pytest.approx(LANE, abs=0.01)
    assert arc <= 30.0


@pytest.mark.parametrize("speed", [10.0, 20.0])
def test_a_road_of_the_same_times_has_the_same_lateral_acceleration(speed: float) -> None:
    scenario = load_scenario("paper_c", [*at_the_same_times(speed), f"speed.set_mps={speed}"])
    path, start = scenario.route.path, scenario.route.start
    curvature = path.at(start + 5.5 * speed).curvature
    assert speed**2 * curvature == pytest.approx(-1.8, rel=1e-4)
    assert path.at(start + 4.9 * speed).curvature == 0.0
    assert path.at(start + 20.5 * speed).curvature == pytest.approx(-curvature, rel=1e-4)


@pytest.mark.parametrize("case", ROADS)
def test_a_shifted_road_is_the_case_s_road_moved_ahead(case: RunKey) -> None:
    speed, begins = ROADS[case]
    own, again, moved = (
        load_scenario(f"paper_{case}", overrides).route
        for overrides in (
            (),
            (road(500.0, 30.0, 30.0, begins),),
            RUNS_OF_CASE[str(case)][case.moved(0.5)].overrides,
        )
    )
    assert own.profile.at(begins[0] / speed)[0] == speed
    for station in np.arange(0.0, 750.0, 0.25):
        here = own.path.at(own.start + station).curvature
        assert again.path.at(again.start + station).curvature == pytest.approx(here, abs=1e-12)
        later = moved.path.at(moved.start + station + 0.05 * speed).curvature
        assert later == pytest.approx(here, abs=1e-12)


def test_an_unlogged_run_gives_the_figures_of_the_logged_run(tmp_path: Path) -> None:
    scenario = load_scenario("lane_change", ["duration_s=7.0", "convoy.vehicles=2"])
    logged, kept = record_trial(scenario, tmp_path), drive_trial(scenario)
    assert kept.tracking == logged.tracking
    assert kept.cross_track == logged.cross_track
    assert kept.tracking[0] > 0.01


def test_the_field_runs_are_a_convoy_one_car_at_a_time(tmp_path: Path) -> None:
    scenario = load_scenario("paper_field", ["duration_s=6.0"])
    runs = field_runs(scenario, tmp_path)
    for lateral, trial in (
        ("lead_and_predecessor", runs.with_lead_data),
        ("predecessor", runs.without_lead_data),
    ):
        at_once = drive_trial(
            load_scenario(
                "paper_field", ["duration_s=6.0", f'information_flow.lateral="{lateral}"']
            )
        )
        for drive, live in zip(trial.drives, at_once.drives, strict=True):
            assert drive.name == live.name
            assert np.abs(drive.east - live.east).max() < 1e-6
            assert np.abs(drive.lateral_error - live.lateral_error).max() < 1e-6
    assert runs.logs == (
        "run_1_PL1",
        "run_2_PL2",
        "run_3_PL3_composite",
        "run_3_PL3_predecessor",
    )
    starts = []
    for name in runs.logs[:3]:
        reader = LogReader(tmp_path / name / LOG_NAME)
        (start,) = (message for _, _, message in reader.messages(("start",)))
        assert isinstance(start, RunStart)
        starts.append(start.start_at_ns)
    assert np.diff(starts).tolist() == [300_000_000_000] * 2
    last = tmp_path / runs.logs[2] / LOG_NAME
    assert scenario_in(LogReader(last)).vehicle_names == ("PL1", "PL2", "PL3")


def test_a_run_of_the_field_experiment_has_only_the_cars_up_to_its_own() -> None:
    run = as_run(load_scenario("paper_field"), 1, "predecessor")
    assert run.vehicle_names == ("PL1", "PL2")
    assert run.vehicle("PL2").lateral_offset_m == 0.4
    assert as_run(load_scenario("paper_field"), 2, "predecessor").vehicle("PL3").flow.lateral == (
        "PL2",
    )


def a_drive(name: str, east: np.ndarray, north: np.ndarray, speed: float) -> Drive:
    nothing = np.zeros(len(east))
    return Drive(
        name=name,
        at=(east - east[0]) / speed,
        east=east,
        north=north,
        speed=np.full(len(east), speed),
        lateral_error=nothing,
        heading_error=nothing,
        station=east,
        cross_track=nothing,
    )


def test_amplitudes_are_fitted_in_spite_of_a_drift() -> None:
    east, frequency, speed = np.arange(0.0, 900.0, 0.6), 2.0, 30.0
    swing = frequency * east / speed
    drives = (
        a_drive("v1", east, 0.5 * np.sin(swing) + 0.2, speed),
        a_drive("v2", east, 0.6 * np.sin(swing - 0.3) + 0.001 * east, speed),
    )
    first, second = amplitudes(Trial(drives), frequency)
    assert abs(first) == pytest.approx(0.5)
    assert abs(second) == pytest.approx(0.6)
    assert np.angle(second / first) == pytest.approx(-0.3)


def test_the_lead_drives_the_sine_for_all_the_periods() -> None:
    frequency = 2.5
    scenario = sine_scenario(frequency)
    speed = scenario.tables.speed.set_mps
    east = np.arange(0.0, speed * scenario.duration_s, 0.5)
    assert scenario.tables.information_flow.lateral.word == "predecessor"
    last = east > east[-1] - PERIODS * 2.0 * pi * speed / frequency
    path = scenario.route.path
    heights = np.array([path.at(scenario.route.start + e).north for e in east[last]])
    assert heights.max() == pytest.approx(1.5 / frequency**2, rel=0.03)
    assert heights.min() == pytest.approx(-1.5 / frequency**2, rel=0.03)


def test_linear_theory_of_a_chain_with_a_gain_of_1_1() -> None:
    east = np.linspace(0.0, 1000.0, 2001)
    lead = a_drive("v1", east, -3.0 * np.exp(-(((east - 500.0) / 80.0) ** 2)), 30.0)
    gain = Transfer(np.array([1.1]), np.array([1.0]))
    tracking, true = predict_errors(lead, gain, 1.0, 3)
    assert tracking == pytest.approx((0.3, 0.33, 0.363), rel=1e-3)
    assert true == pytest.approx((0.3, 0.63, 0.993), rel=1e-3)
    tracking, true = predict_errors(lead, gain, 0.5, 3)
    assert tracking == pytest.approx((0.3, 0.315, 0.32325), rel=1e-3)
    assert true == pytest.approx((0.3, 0.465, 0.55575), rel=1e-3)


def test_samples_are_counted_ahead_of_the_car_and_by_source() -> None:
    counter = SampleCounter()
    counter.listen(0, truth("v3", 0, 5.0, 200.0, yaw=0.5 * pi, distance=200.0))
    counter.listen(
        0,
        CompositeTrajectory(
            vehicle="v3",
            seq=0,
            decided_at_ns=0,
            mode="composite",
            piece_east_m=(),
            piece_north_m=(),
            piece_yaw_rad=(),
            piece_curvature_per_m=(),
            piece_length_m=(),
            sample_east_m=(5.0, 5.0, 5.0, 5.1, 5.1),
            sample_north_m=(199.0, 202.0, 203.0, 200.1, 201.1),
            sample_source=(0, 0, 0, 1, 1),
            residual_m_rms=0.0,
            residual_m_max=0.0,
            piece_curvature_rate_per_m2=(),
        ),
    )
    assert (counter.figures.lead, counter.figures.predecessor) == (2, 2)
    # The two closest samples are at (5.1, 200.1) and (5.0, 199.0).
    assert counter.figures.rule_error == pytest.approx(np.arctan2(0.1, 1.1))


def test_the_samples_of_a_logged_run_are_counted(tmp_path: Path) -> None:
    short = ("duration_s=6.0", "convoy.vehicles=3", "path.segments=[{length_m=300.0}]")
    logged = run_experiment(Experiment(overrides=short, logged=True), tmp_path)
    assert logged.samples is not None
    assert logged.samples.lead == 16  # 24 m of preview, a sample each 1.5 m
    assert 0 < logged.samples.predecessor <= 16
    assert run_experiment(Experiment(overrides=short), tmp_path).samples is None


def test_the_base_case_is_logged_and_its_variants_are_not() -> None:
    assert EXPERIMENTS[BASE] == Experiment(logged=True)
    assert not EXPERIMENTS[BASE.with_variant("blend")].logged
    assert sqrt(len(EXPERIMENTS)) < 13.0  # two runs each, under two minutes in total


@pytest.mark.parametrize("kind", ["fitted", "paper"])
def test_a_run_uses_its_trajectory(kind: Trajectory) -> None:
    for key in (BASE, BASE.with_variant("blend"), BASE.with_variant("paper_prefix")):
        run = EXPERIMENTS[key].with_trajectory(kind)
        scenario = load_scenario(run.scenario, run.overrides, run.seed)
        expected = "paper_prefix" if key.variant == "paper_prefix" else kind
        for name in scenario.vehicle_names:
            assert scenario.vehicle(name).steering.trajectory == expected


def test_the_paper_s_trajectory_gives_the_paper_s_numbers() -> None:
    largest = {}
    for key in (A, C, BASE, at_radius(250.0), BASE.noisy(1)):
        run = EXPERIMENTS[key].with_trajectory("paper")
        until = [f"duration_s={FIRST_CHANGE_S[key]}"] if key in (A, C) else []
        scenario = load_scenario(run.scenario, [*run.overrides, *until], run.seed)
        largest[key] = 100.0 * max(drive_trial(scenario).tracking)
    assert largest[A] == pytest.approx(4.1, abs=0.3)
    assert largest[C] == pytest.approx(9.8, abs=0.4)
    assert largest[BASE] == pytest.approx(6.8, abs=0.5)
    assert largest[at_radius(250.0)] > 12.0
    assert largest[BASE.noisy(1)] > 9.0
