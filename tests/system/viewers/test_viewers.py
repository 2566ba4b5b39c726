"""Viewers that connect during a run show all of it."""

import time
from pathlib import Path
from typing import Any

import pytest
from rerun.experimental import ViewerClient

from scenarios.definition.scenario import load_scenario
from scenarios.results.pictures.layouts import rerun_layout
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from tests.made.rerun_layouts import with_layouts
from tests.made.transport import drive
from tests.system.processes import until
from tests.system.screenshot import (
    can_take_pictures,
    headless_viewer,
    picture_now,
    take_picture,
)
from transport.colours import colour_of
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView

pytestmark = pytest.mark.skipif(
    not can_take_pictures(), reason="no Vulkan driver (mesa-vulkan-drivers)"
)


NEARLY, FEWEST_PIXELS = 30, 100
"""Colour distance and number of pixels of a curve, whose edges are blurred."""
PATIENCE_S = 20.0
"""Longest time (s) for a viewer on a busy machine to draw its data."""


def has_cars(picture: Any) -> bool:
    """Whether a picture has pixels of every car's colour."""
    colours = {colour: count for count, colour in picture.getcolors(maxcolors=2**24)}
    return all(colours.get(colour_of(place), 0) > 200 for place in range(len(drive.VEHICLES)))


def shows_cars(viewer: ViewerClient, at_s: float) -> bool:
    """Whether a viewer shows every car at a time of the run (s) within `PATIENCE_S`."""
    deadline = time.monotonic() + PATIENCE_S
    while (
        not (seen := has_cars(take_picture(viewer, at_s, settled=False)))
        and time.monotonic() < deadline
    ):
        pass
    return seen


def test_each_viewer_sees_the_whole_run() -> None:
    option = parse_rerun_option("serve")
    messages = list(drive.drive(150))
    half = len(messages) // 2
    with RerunView(option, recording_id="circle", vehicles=drive.VEHICLES) as view:
        data_url = view.destination.partition("url=")[2].replace("%3A", ":").replace("%2F", "/")
        for now, message in messages[:half]:
            view.draw(now, message)
        with headless_viewer(data_url.replace("%2B", "+")) as viewer:
            assert shows_cars(viewer, 0.5)
        for now, message in messages[half:]:
            view.draw(now, message)
        with headless_viewer(data_url.replace("%2B", "+")) as viewer:
            assert shows_cars(viewer, 0.5)
            assert shows_cars(viewer, 2.5)


def test_a_log_opens_without_this_project(tmp_path: Path) -> None:
    """With the layout next to it, Rerun draws true and estimated values without this project."""
    scenario = load_scenario("lossy_lane_change", ["duration_s=3"])
    run_virtual(scenario, tmp_path, Stop())
    layout = tmp_path / "rerun.rbl"
    with with_layouts(), rerun_layout(tmp_path, scenario):  # waits for up to 1 s on exit
        assert until(layout.exists, PATIENCE_S)
    with headless_viewer(str(tmp_path / "run.mcap"), layout=layout) as viewer:
        assert until(lambda: all(has_curves(picture_now(viewer))), PATIENCE_S)


def has_curves(picture: Any) -> list[bool]:
    """Whether each third of the right side has a curve in the first follower's colour."""
    thirds = []
    for third in range(3):
        top = third * picture.height // 3
        part = picture.crop((picture.width * 5 // 9, top, picture.width, top + picture.height // 3))
        pixels = sum(
            count
            for count, colour in part.getcolors(maxcolors=2**24)
            if max(abs(a - b) for a, b in zip(colour, colour_of(1), strict=True)) < NEARLY
        )
        thirds.append(pixels > FEWEST_PIXELS)
    return thirds
