"""Axes, tabs, legend and name tags of the picture."""

from collections.abc import Iterator
from itertools import combinations
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import pytest

from tests.made.scenarios.messages import at, start, truth
from tests.made.transport.recording import columns
from transport.picture.blueprint import LEGEND_WIDTH, MARKS, RunExtent, blueprint
from transport.picture.option import parse_rerun_option
from transport.picture.recording_writer import LINE_LENGTH
from transport.picture.shapes import MARK_CLEARANCE_M, legend, road_with_marks
from transport.picture.view import RerunView
from vehicles.messages import LogText


def convoy(count: int) -> list[str]:
    return [f"v{place}" for place in range(1, count + 1)]


def rows(count: int, extent: RunExtent) -> list[list[Any]]:
    """Views of each row of tabs on the right side."""
    layout: Any = blueprint(convoy(count), spacing_m=15.0, road=None, extent=extent)
    _, right = layout.root_container.contents
    return [list(row.contents) for row in right.contents]


def ends(view: Any) -> tuple[float, float]:
    """First and last time (s) on the time axis of a view."""
    (shown,) = view.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()
    return shown["start"] / 1e9, shown["end"] / 1e9


EXTENT = RunExtent(600.0, worst="v3")


@pytest.mark.parametrize("count", [4, 12])
def test_every_plot_shows_the_whole_run(count: int) -> None:
    for view in (view for row in rows(count, EXTENT) for view in row):
        assert ends(view) == (0.0, 600.0)


def test_there_are_four_rows_with_the_worst_vehicle_in_front() -> None:
    views = rows(12, EXTENT)
    assert len(views) == 4
    assert views[1][0].origin == "plots/closing/v3"
    assert {f"plots/closing/{name}" for name in convoy(12)[1:]} <= {
        str(view.origin) for view in views[1]
    }


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
    _, marks = road_with_marks(east, north, 4.0)
    assert marks.positions is not None
    places = marks.positions.as_arrow_array().to_pylist()
    assert len(places) >= 4
    for a, b in combinations(places, 2):
        assert (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 >= 0.99 * MARK_CLEARANCE_M**2


def run_of(seconds: int, text: str) -> Iterator[Any]:
    yield start()
    for seq in range(50 * seconds):
        for place, name in enumerate(convoy(2)):
            yield truth(name, seq, 0.6 * seq - 15.0 * place, 0.0)
    yield LogText(vehicle="v2", seq=0, logged_at_ns=at(seconds), level="warning", text=text)


def test_log_lines_are_wrapped_and_state_the_whole_time(tmp_path: Path) -> None:
    text = "the radio is " + "very " * 60 + "slow"
    option = parse_rerun_option(f"save={tmp_path / 'run.rrd'}")
    with RerunView(option, recording_id="x", vehicles=convoy(2)) as view:
        for message in run_of(2, text):
            view.draw(at(0.0), message)
    lines = [line for (line,) in columns(tmp_path / "run.rrd")["/log/v2"]["TextLog:text"]]
    assert len(lines) > 2
    assert max(map(len, lines)) <= LINE_LENGTH
    assert " ".join(" ".join(lines).split()) == f"2.00 s v2: {text}"
