import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.image import imread

from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report
from scenarios.studies.gains.subject import PICTURES
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Gains, Loading, loaded
from vehicles.theory.linear_model import closed_loop_at

SPEEDS = [DEFAULT_SPEEDS[k] for k in (0, 2, 3, -1)]
Report = dict[str, Any]


@pytest.fixture(scope="module")
def nominal(tmp_path_factory: pytest.TempPathFactory) -> Report:
    before, folder = dict(mpl.rcParams), tmp_path_factory.mktemp("gains") / "new" / "folder"
    report = gains_report(LINCOLN_MKZ, NOMINAL_GAINS, SPEEDS, out_dir=folder)
    assert dict(mpl.rcParams) == before
    assert report == json.loads((folder / "gains.json").read_text(encoding="utf-8"))
    again = gains_report(LINCOLN_MKZ, NOMINAL_GAINS, [30.0], [Loading()], folder)
    assert again["pictures"] == report["pictures"]  # an earlier report is replaced
    return report


def test_the_paper_s_gains_have_the_properties_of_section_v(nominal: Report) -> None:
    sets = nominal["stabilising_set"]
    assert sets["inside_at_all_speeds_and_loadings"]
    ball = sets["ball_over_speeds_and_loadings"]
    assert ball["radius_in_gain_units"] == pytest.approx(0.06)
    assert sets["relative_ball_over_speeds_and_loadings"]["radius_ratio"] > 0.8
    assert sets["not_convex_between"] is not None
    assert len(nominal["loadings"]) == 8
    assert all(row["stable_at_every_speed"] for row in nominal["loadings"])
    for steering in ("instantaneous", "second_order"):
        assert nominal["propagation"][-1][steering]["norm_ratio"] > 1.0
    assert nominal["gains"] == {
        "lateral_rad_per_m": 0.06,
        "heading_rad_per_rad": 0.96,
        "yaw_rate_s": 0.08,
    }


def test_lowest_rates_agree_with_simulated_convoys(nominal: Report) -> None:
    """Without an inertial sensor, convoys were unstable below 6 Hz at 15 m/s, 10 Hz at 30 m/s."""
    rows = {round(row["speed_mps"]): row for row in nominal["sampled"]}
    assert all(row["decay_per_s"] > 0.0 for row in nominal["sampled"])
    assert 4 <= rows[13]["lowest_rate_without_imu_hz"] <= 7
    assert 10 < rows[30]["lowest_rate_without_imu_hz"] <= 20
    for row in nominal["sampled"]:
        assert row["lowest_imu_rate_hz"] <= row["lowest_rate_without_imu_hz"]


def test_roots_are_those_of_the_loaded_cars(nominal: Report) -> None:
    for row in nominal["loadings"]:
        load = {key: row[key] for key in ("front_passengers", "rear_passengers")}
        car = loaded(LINCOLN_MKZ, Loading(**load))
        expected = np.linalg.eigvals(closed_loop_at(car, NOMINAL_GAINS, 30.0))
        roots = np.array([complex(*root) for root in row["roots_per_s"]])
        assert roots == pytest.approx(np.sort_complex(expected), rel=1e-6)


def test_certificate_exceeds_dry_asphalt(nominal: Report) -> None:
    varying = nominal["varying_speed"]
    assert varying["stable_at_every_speed"]
    assert all(row["certified_mps2"] > 9.81 for row in varying["table"])
    assert 0.0 < varying["mean_acceleration_mps2"] < varying["table"][0]["certified_mps2"]


def test_gains_that_do_not_stabilise_are_reported(tmp_path: Path) -> None:
    report = gains_report(LINCOLN_MKZ, Gains(0.06, 3.0, 0.0), [30.0], [Loading()], tmp_path)
    sets = report["stabilising_set"]
    assert not sets["inside_at_all_speeds"]
    assert sets["ball_at_reference_speed"]["radius_in_gain_units"] == 0.0
    assert sets["ball_at_reference_speed"]["root_there_radps"] is None  # not a number in JSON
    assert "relative_ball_at_reference_speed" not in sets  # k_omega is 0
    assert report["varying_speed"]["table"] == []
    assert report["propagation"] == [{"speed_mps": 30.0, "stable": False}]
    assert report["pictures"] == [f"{name}.png" for name in PICTURES]
    for name in report["pictures"]:
        pixels = imread(tmp_path / name)
        assert pixels.shape[:2] > (400, 600)
        assert pixels[..., :3].std() > 0.03  # something is drawn


def test_no_speed_or_no_loading_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        gains_report(LINCOLN_MKZ, NOMINAL_GAINS, [])
    with pytest.raises(ValueError, match="at least one"):
        gains_report(LINCOLN_MKZ, NOMINAL_GAINS, [30.0], [])
