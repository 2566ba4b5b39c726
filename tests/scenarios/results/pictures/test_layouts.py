"""Layouts are written next to a log and never disturb a run."""

from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.pictures.layouts import (
    FOXGLOVE_NAME,
    write_foxglove_layout,
)
from scenarios.runs.run_log import scene_of

SCENARIO = load_scenario("lane_change")


def test_a_file_of_the_user_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / LOG_NAME).touch()
    (tmp_path / FOXGLOVE_NAME).write_text("mine")
    write_foxglove_layout(tmp_path, SCENARIO)
    assert (tmp_path / FOXGLOVE_NAME).read_text() == "mine"


def test_a_folder_that_cannot_be_written_to_is_no_failure(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    write_foxglove_layout(gone, SCENARIO)
    assert not gone.exists()


def test_a_scene_has_the_bodies_that_collide() -> None:
    cars = scene_of(SCENARIO).cars
    assert list(cars) == list(SCENARIO.vehicle_names)
    assert cars["v1"] == pytest.approx((4.93, 1.86, -0.1568))
