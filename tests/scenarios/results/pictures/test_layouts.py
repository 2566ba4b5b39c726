"""Layouts are written next to a log and never disturb a run."""

from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.pictures.layouts import (
    FOXGLOVE_NAME,
    RERUN_NAME,
    rerun_layout,
    write_foxglove_layout,
)
from scenarios.runs.run_log import scene_of
from tests.made.rerun_layouts import with_layouts

SCENARIO = load_scenario("lane_change")


@pytest.mark.parametrize("name", [FOXGLOVE_NAME, RERUN_NAME])
def test_a_file_of_the_user_is_left_as_it_is(name: str, tmp_path: Path) -> None:
    (tmp_path / LOG_NAME).touch()
    (tmp_path / name).write_text("mine")
    write_foxglove_layout(tmp_path, SCENARIO)
    with with_layouts(), rerun_layout(tmp_path, SCENARIO):
        pass
    assert (tmp_path / name).read_text() == "mine"


def test_without_a_run_no_layout_is_left(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), rerun_layout(tmp_path, SCENARIO):
        raise RuntimeError("the recorder cannot start")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_to_is_no_failure(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    write_foxglove_layout(gone, SCENARIO)
    with with_layouts(), rerun_layout(gone, SCENARIO):
        pass
    assert not gone.exists()


def test_a_scene_has_the_bodies_that_collide() -> None:
    cars = scene_of(SCENARIO).cars
    assert list(cars) == list(SCENARIO.vehicle_names)
    assert cars["v1"] == pytest.approx((4.93, 1.86, -0.1568))
