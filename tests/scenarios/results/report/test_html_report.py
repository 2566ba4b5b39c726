"""`convoy report --html`: figures of the summary, one file, no network."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from click.testing import CliRunner, Result
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.figure_style import MODE_COLOURS, vehicle_colour
from scenarios.results.report.page import report_page
from scenarios.results.run_figures import (
    LEAST_HEIGHT,
    QUANTITIES,
    draw_curve,
    over_place,
    over_time,
    thinned,
)
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from vehicles.messages import Mode


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose links are cut, with events."""
    out = tmp_path_factory.mktemp("cut") / "run"
    settings = ["duration_s=4.0", "change=[{kind='cut', at_s=1, for_s=2}]"]
    run_virtual(load_scenario("lossy_lane_change", settings), out, Stop())
    return out


@pytest.fixture(scope="module")
def page(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    out = tmp_path_factory.mktemp("page") / "run.html"
    assert run("report", folder, "--html", out).exit_code == 0
    return out.read_text(encoding="utf-8")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


class Page(HTMLParser):
    """All attributes as (tag, name, value), and the tags that are not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.attributes: list[tuple[str, str, str]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        self.open += [tag] if tag != "meta" else []

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_figures_equal_the_summary(folder: Path, page: str) -> None:
    content, summary = Page(page), json.loads((folder / "summary.json").read_text())
    assert content.open == []
    exact = {value for tag, name, value in content.attributes if name == "data-value"}
    for row in summary["vehicles"][1:]:
        known = row["cross_track_error_m_max"], row["cross_track_error_m_rms"]
        assert " / ".join(map(repr, known)) in exact
    for link in summary["links"]:
        assert repr(link["delivered"]) in exact


def test_the_page_needs_no_network(page: str) -> None:
    assert len(page.encode()) < 500_000
    for tag, name, value in Page(page).attributes:
        assert name not in {"src", "href", "srcset", "action", "data"}, (tag, name, value)
        assert name != "xlink:href" or value.startswith(("#", "data:")), (tag, name, value)
        assert not name.startswith("on"), (tag, name)
    assert not re.search(r"https?://|url\((?!#)|@import|fetch\(|XMLHttpRequest|import\(", page)
    policies = [value for _, _, value in Page(page).attributes if "default-src" in value]
    assert policies[0].startswith("default-src 'none';")


def test_the_figures_of_the_page_are_svg_in_its_colours(page: str) -> None:
    figures = re.findall(r"<figcaption>(.*?)</figcaption>(<svg.*?</svg>)", page, re.DOTALL)
    assert [title for title, _ in figures][:3] == [
        "Plan, north up", "Over time", "Along the path of the lead",
    ]  # fmt: skip
    over_time = figures[1][1]
    for text in ("true error", "true gap", "speed", "self-estimated", "modes", "messages lost"):
        assert text in over_time
    assert {"var(--ink)", "var(--soft)", "var(--grid)"} <= set(re.findall(r"var\(.*?\)", over_time))
    assert "#000000" not in over_time


def large(summary: RunSummary, count: int) -> RunSummary:
    """A summary with many vehicles, links, events and warnings."""
    first, second, *_ = summary.vehicles
    rows = [replace(second, name=f"v{number}") for number in range(2, count + 1)]
    links = [replace(summary.links[0], receiver=row.name) for row in rows]
    warnings = tuple(f"warning number {number} " + 100 * "x" for number in range(1000))
    return replace(
        summary,
        vehicles=(first, *rows),
        links=(*links, *links),
        events=200 * summary.events,
        warnings=warnings,
    )


def test_a_report_of_any_run_fits_the_size(folder: Path) -> None:
    record = RunRecord(folder)
    page = report_page(record, large(record.summary, 200))
    assert len(page.encode()) < 1_000_000
    assert "140 more are in summary.json" in page
    assert Page(page).open == []


def test_curves_are_those_of_the_run(folder: Path) -> None:
    record = RunRecord(folder)
    errors, gaps, speeds, own = QUANTITIES
    true, tracking = record.vehicles["v2"].true, record.vehicles["v2"].tracking
    for quantity, table, known in (
        (gaps, true, true.gap_m),
        (speeds, true, true.speed_mps),
        (own, tracking, tracking.lateral_error_m),
    ):
        at_s, values = over_time(record.tables, "v2", quantity, 500)
        assert at_s.size > 30
        assert values == pytest.approx(np.interp(at_s, table.t_s, known), abs=1e-3)
    station, values = over_place(record.tables, "v2", errors, 500)
    known = np.isfinite(values)
    assert known.sum() > 30
    expected = np.interp(station, true.station_m, true.error_m)
    assert values[known] == pytest.approx(expected[known], abs=5e-3)
    assert over_time(record.tables, "v1", errors, 500)[0].size == 0


def test_rounding_errors_do_not_fill_an_axis() -> None:
    axes = Figure().subplots()
    draw_curve(axes, (np.arange(3.0), np.array([0.0, 1e-9, 0.0])))
    low, high = axes.get_ylim()
    assert high - low >= LEAST_HEIGHT


def test_colours_are_distinct_and_visible_on_white_and_on_black() -> None:
    colours = [vehicle_colour(place) for place in range(12)]
    assert len(set(colours)) == 12
    assert MODE_COLOURS.keys() == set(get_args(Mode))
    assert not set(colours) & set(MODE_COLOURS.values())
    for colour in MODE_COLOURS.values():
        red, green, blue = to_rgb(colour)
        assert 0.25 < 0.299 * red + 0.587 * green + 0.114 * blue < 0.65


def test_texts_of_a_log_are_escaped(folder: Path) -> None:
    record = RunRecord(folder)
    text = report_page(record, replace(record.summary, warnings=("</td><script>x</script>",)))
    assert "&lt;/td&gt;&lt;script&gt;x&lt;/script&gt;" in text
    assert "<script" not in text


def test_thinning_keeps_extremes_and_breaks() -> None:
    at = np.linspace(0.0, 10.0, 5000)
    values = np.sin(7.0 * at)
    values[1234] = 5.0
    values[4000:4100] = np.nan
    times, kept = thinned((at, values), 100)
    assert times.size < 200
    assert (np.nanmax(kept), np.nanmin(kept)) == (5.0, np.nanmin(values))
    assert np.isnan(kept).any()
    assert (times[0], times[-1]) == (0.0, 10.0)
