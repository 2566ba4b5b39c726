"""Viewers come and go while a run is drawn; each sees all of it."""

import pytest

from tests.system.screenshot import can_take_pictures, headless_viewer, take_picture
from tests.transport import drive
from transport.rerun_blueprint import colour_of
from transport.rerun_view import RerunView, parse_rerun_option

pytestmark = pytest.mark.skipif(
    not can_take_pictures(), reason="no Vulkan driver here to draw with (mesa-vulkan-drivers)"
)


def test_each_viewer_sees_the_whole_run() -> None:
    option = parse_rerun_option("serve")
    messages = list(drive.drive(150))
    half = len(messages) // 2
    with RerunView(option, run_id="circle", vehicles=drive.VEHICLES) as view:
        data_url = view.where.partition("url=")[2].replace("%3A", ":").replace("%2F", "/")
        for now, message in messages[:half]:
            view.draw(now, message)
        with headless_viewer(data_url.replace("%2B", "+")) as viewer:
            first = take_picture(viewer, 0.5)
        for now, message in messages[half:]:
            view.draw(now, message)
        with headless_viewer(data_url.replace("%2B", "+")) as viewer:
            again = take_picture(viewer, 0.5)
            late = take_picture(viewer, 2.5)
    for picture in (first, again, late):
        colours = {colour: count for count, colour in picture.getcolors(maxcolors=2**24)}
        for place in range(len(drive.VEHICLES)):
            assert colours.get(colour_of(place), 0) > 200  # a car fills that many pixels
