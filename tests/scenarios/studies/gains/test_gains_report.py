import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread

from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report, refuse_foreign_files
from scenarios.studies.gains.results import GainsReport, as_json
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Gains, Loading, loaded
from vehicles.theory.linear_model import closed_loop_at

SPEEDS = [DEFAULT_SPEEDS[k] for k in (0, 2, 3, -1)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("gains") / "new" / "folder"


@pytest.fixture(scope="module")
def nominal(folder: Path) -> GainsReport:
    before = dict(mpl.rcParams)
    report = gains_report(LINCOLN_MKZ, NOMINAL_GAINS, SPEEDS, out_dir=folder)
    assert dict(mpl.rcParams) == before
    return report


def _check_files(folder: Path, report: GainsReport) -> None:
    read = json.loads((folder / "gains.json").read_text(encoding="utf-8"))
    assert read["pictures"] == list(report.pictures)
    assert len(report.pictures) == 4
    for name in report.pictures:
        pixels = imread(folder / name)
        assert pixels.shape[0] > 400
        assert pixels.shape[1] > 600
        assert pixels[..., :3].std() > 0.03  # something is drawn


def test_the_paper_s_gains_have_the_properties_of_section_v(nominal: GainsReport) -> None:
    sets = nominal.stabilising_set
    assert sets.inside_at_all_speeds_and_loadings
    assert sets.ball_over_speeds_and_loadings.radius_in_gain_units == pytest.approx(0.06)
    relative = sets.relative_ball_over_speeds_and_loadings
    assert relative is not None
    assert relative.radius_ratio > 0.8
    assert sets.not_convex_between is not None
    assert len(nominal.loadings) == 8
    assert all(row.stable_at_every_speed for row in nominal.loadings)
    for at in (nominal.propagation[-1].instantaneous, nominal.propagation[-1].second_order):
        assert at is not None
        assert at.norm_ratio > 1.0


def test_lowest_rates_agree_with_simulated_convoys(nominal: GainsReport) -> None:
    """Without an inertial sensor, convoys were unstable below 6 Hz at 15 m/s, 10 Hz at 30 m/s."""
    rows = {round(row.speed_mps): row for row in nominal.sampled}
    assert all(row.decay_per_s > 0.0 for row in nominal.sampled)
    alone = [rows[speed].lowest_rate_without_imu_hz for speed in (13, 18, 30)]
    assert alone[0] is not None
    assert alone[2] is not None
    assert 4 <= alone[0] <= 7
    assert 10 < alone[2] <= 20
    for row in nominal.sampled:
        assert row.lowest_imu_rate_hz is not None
        assert row.lowest_rate_without_imu_hz is not None
        assert row.lowest_imu_rate_hz <= row.lowest_rate_without_imu_hz


def test_roots_are_those_of_the_loaded_cars(nominal: GainsReport) -> None:
    for row in nominal.loadings:
        load = Loading(front_passengers=row.front_passengers, rear_passengers=row.rear_passengers)
        car = loaded(LINCOLN_MKZ, load)
        expected = np.linalg.eigvals(closed_loop_at(car, NOMINAL_GAINS, 30.0))
        roots = np.array([complex(*root) for root in row.roots_per_s])
        assert roots == pytest.approx(np.sort_complex(expected), rel=1e-6)


def test_certificate_exceeds_dry_asphalt(nominal: GainsReport) -> None:
    varying = nominal.varying_speed
    assert varying.stable_at_every_speed
    for row in varying.table:
        assert row.certified_mps2 > 9.81
    assert 0.0 < varying.mean_acceleration_mps2 < varying.table[0].certified_mps2


@pytest.fixture(scope="module")
def unstable(tmp_path_factory: pytest.TempPathFactory) -> tuple[GainsReport, Path]:
    folder = tmp_path_factory.mktemp("unstable")
    return gains_report(LINCOLN_MKZ, Gains(0.06, 3.0, 0.0), [30.0], [Loading()], folder), folder


def test_gains_that_do_not_stabilise_are_reported(unstable: tuple[GainsReport, Path]) -> None:
    report, folder = unstable
    assert not report.stabilising_set.inside_at_all_speeds
    assert report.stabilising_set.ball_at_reference_speed.radius_in_gain_units == 0.0
    assert report.varying_speed.table == ()
    assert not report.propagation[-1].stable
    _check_files(folder, report)
    read = json.loads((folder / "gains.json").read_text(encoding="utf-8"))
    ball = read["stabilising_set"]["ball_at_reference_speed"]
    assert ball["root_there_radps"] is None  # not a number in JSON
    assert read["propagation"][-1] == {"speed_mps": 30.0, "stable": False}
    assert "relative_ball_at_reference_speed" not in read["stabilising_set"]  # k_omega is 0


def test_the_form_in_json(nominal: GainsReport, folder: Path) -> None:
    report = as_json(nominal)
    assert report == json.loads((folder / "gains.json").read_text(encoding="utf-8"))
    assert report["gains"] == {
        "lateral_rad_per_m": 0.06,
        "heading_rad_per_rad": 0.96,
        "yaw_rate_s": 0.08,
    }
    row, first = report["varying_speed"]["table"][0], nominal.varying_speed.table[0]
    assert row["certified_mps2"] == first.certified_mps2
    assert "relative_ball_at_reference_speed" in report["stabilising_set"]
    assert report["loadings"][0]["rear_passengers"] == 0


def test_no_speed_or_no_loading_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        gains_report(LINCOLN_MKZ, NOMINAL_GAINS, [])
    with pytest.raises(ValueError, match="at least one"):
        gains_report(LINCOLN_MKZ, NOMINAL_GAINS, [30.0], [])


def test_an_earlier_report_is_replaced(nominal: GainsReport, folder: Path) -> None:
    assert nominal.pictures
    refuse_foreign_files(folder)
