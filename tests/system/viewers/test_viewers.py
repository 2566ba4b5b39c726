"""Viewers that connect during a run show all of it."""

import time
from typing import Any

import pytest
from rerun.experimental import ViewerClient

from tests.made.transport import drive
from tests.made.transport.recording import batch_of, scene_of
from tests.system.screenshot import (
    can_take_pictures,
    headless_viewer,
    take_picture,
)
from transport.panels import colour_of
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView

pytestmark = pytest.mark.skipif(
    not can_take_pictures(), reason="no Vulkan driver (mesa-vulkan-drivers)"
)


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
    messages = [message for _, message in drive.drive(150)]
    half = len(messages) // 2
    scene = scene_of(drive.VEHICLES)
    with RerunView(option, recording_id="circle", scene=scene) as view:
        data_url = view.destination.partition("url=")[2].replace("%3A", ":").replace("%2F", "/")
        view.draw(batch_of(messages[:half], drive.START))
        with headless_viewer(data_url.replace("%2B", "+")) as viewer:
            assert shows_cars(viewer, 0.5)
        view.draw(batch_of(messages[half:], drive.START))
        with headless_viewer(data_url.replace("%2B", "+")) as viewer:
            assert shows_cars(viewer, 0.5)
            assert shows_cars(viewer, 2.5)
