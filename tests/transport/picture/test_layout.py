"""Axes, tabs, legend and name tags of the picture."""

from itertools import combinations
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest

from tests.made.scenarios.messages import START, at
from tests.made.transport.recording import batch_of, drawn, scene_of
from transport.picture.layout import LEGEND_WIDTH, MARKS, RunExtent, blueprint
from transport.picture.run_picture import LINE_LENGTH
from transport.picture.shapes import MARK_CLEARANCE_M, legend, road_marks
from vehicles.messages import LogText


def convoy(count: int) -> list[str]:
    return [f"v{place}" for place in range(1, count + 1)]


def rows(count: int, extent: RunExtent) -> list[list[Any]]:
    """Views of each row of tabs on the right side."""
    layout: Any = blueprint(scene_of(convoy(count)), extent)
    _, right = layout.root_container.contents
    return [list(row.contents) for row in right.contents]


def ends(view: Any) -> tuple[float, float]:
    """First and last time (s) on the time axis of a view."""
    (shown,) = view.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()
    return shown["start"] / 1e9, shown["end"] / 1e9


EXTENT = RunExtent(600.0, vehicles=["v3", "v7"], links=["v5_to_v6"])


@pytest.mark.parametrize("count", [4, 12])
def test_every_plot_shows_the_whole_run(count: int) -> None:
    for view in (view for row in rows(count, EXTENT) for view in row):
        assert ends(view) == (0.0, 600.0)


def test_vehicles_with_problems_have_their_own_tabs() -> None:
    first, second, others, *_ = rows(12, EXTENT)[1]
    assert [first.origin, second.origin] == ["plots/closing/v3", "plots/closing/v7"]
    quiet = [name for name in convoy(12)[1:] if name not in EXTENT.vehicles]
    assert others.contents == [f"/plots/closing/{name}/known" for name in quiet]


def test_links_with_problems_come_first() -> None:
    first, others, *_ = rows(12, EXTENT)[3]
    assert first.contents == ["/links/v5_to_v6"]
    assert others.contents == ["/links/**", "- /links/v5_to_v6"]


def test_entries_of_the_legend_do_not_overlap() -> None:
    items = [(name, (0, 0, 0)) for name in (*convoy(12), "comfortable stop", *MARKS)]
    places = legend(items).positions
    assert places is not None
    x, y = zip(*places.as_arrow_array().to_pylist(), strict=True)
    assert len(x) == len(items)
    assert 0.0 < min(x) < max(x) < LEGEND_WIDTH
    for (left, text), (right, after) in combinations(
        zip(zip(x, y, strict=True), items, strict=True), 2
    ):
        letters = 0.5 * (len(text[0]) + len(after[0]))
        assert right[1] > left[1] or right[0] - left[0] > 0.7 * letters


def test_later_laps_have_no_distance_marks_of_their_own() -> None:
    circle = [2.0 * pi * step / 100.0 for step in range(1001)]
    east, north = [30.0 * cos(turn) for turn in circle], [30.0 * sin(turn) for turn in circle]
    marks = road_marks(east, north, 4.0)
    assert marks.positions is not None
    places = marks.positions.as_arrow_array().to_pylist()
    assert len(places) >= 4
    for a, b in combinations(places, 2):
        assert (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 >= 0.99 * MARK_CLEARANCE_M**2


def test_log_lines_are_wrapped_and_state_the_whole_time(tmp_path: Path) -> None:
    text = "the radio is " + "very " * 60 + "slow"
    line = LogText(vehicle="v2", seq=0, logged_at_ns=at(2.0), level="warning", text=text)
    table = drawn(tmp_path / "run.rrd", scene_of(convoy(2)), batch_of([line], START))
    lines = [line for (line,) in table["/log/v2"]["TextLog:text"]]
    assert len(lines) > 2
    assert max(map(len, lines)) <= LINE_LENGTH
    assert " ".join(" ".join(lines).split()) == f"2.00 s v2: {text}"
