"""The table of panels names fields that messages have."""

from dataclasses import fields

import pytest

from transport.panels import PANELS, Panel, panels_of
from transport.topics import TOPICS
from vehicles.messages import Tracking


@pytest.mark.parametrize("panel", PANELS.values(), ids=lambda panel: panel.name)
def test_the_fields_of_a_panel_stand_in_messages_of_one_topic(panel: Panel) -> None:
    assert {series.topic for series in panel.series} == {panel.topic}
    if panel.topic in TOPICS:
        known = {field.name for field in fields(TOPICS[panel.topic].message)}
        used = {name for series in panel.series for name in (series.field, series.flag) if name}
        assert used <= known


def test_the_panels_of_a_message_are_those_that_read_its_topic() -> None:
    names = {panel.name for panel in panels_of(Tracking)}
    assert names == {name for name, panel in PANELS.items() if panel.topic == "tracking"}


def test_layouts_of_a_plain_log_show_one_follower_where_each_has_its_own_plot() -> None:
    convoy = ["v1", "v2", "v3", "v4"]
    assert dict(PANELS["closing"].followers(convoy)) == {2: "v3"}
    assert dict(PANELS["true_gap"].followers(convoy)) == {1: "v2", 2: "v3", 3: "v4"}
    assert not PANELS["closing"].applies_to(["v1"])
