"""`convoy report --html`: figures of the summary, one file, no network."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import cli
from scenarios.definition.scenario import load_scenario
from scenarios.results.data_table import DataTable
from scenarios.results.frequency_gains import frequency_gains
from scenarios.results.report.page import MOST_BYTES, report_page
from scenarios.results.report.plots import thinned
from scenarios.results.report.tables import element
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual


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
    """Tables as rows of (text, data-value), and all attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: list[list[list[tuple[str, str | None]]]] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.attributes += [(tag, name, value) for name, value in given.items()]
        if tag != "meta":
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in {"td", "th"}:
            self.tables[-1][-1].append(("", given.get("data-value")))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if {"td", "th"} & set(self.open):
            text, value = self.tables[-1][-1][-1]
            self.tables[-1][-1][-1] = (text + data, value)

    def table(self, heading: str) -> list[list[tuple[str, str | None]]]:
        return next(table for table in self.tables if table[0][0][0] == heading)


def figures(rows: Any) -> dict[tuple[str, str], str | None]:
    """Exact values by name of the column and of the row."""
    head, *body = rows
    return {
        (head[place][0], row[0][0]): cell[1]
        for row in body
        for place, cell in enumerate(row)
        if place
    }


def test_figures_equal_the_summary(folder: Path, page: str) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    content = Page(page)
    assert content.open == []
    rows = {row["name"]: row for row in summary["vehicles"]}
    largest = figures(content.table("vehicle"))["largest error, cm", "v2"]
    assert largest == repr(rows["v2"]["cross_track_error_m_max"])


def test_the_page_needs_no_network(page: str) -> None:
    assert len(page.encode()) < MOST_BYTES
    for tag, name, value in Page(page).attributes:
        assert name not in {"src", "href", "srcset", "action", "data"}, (tag, name, value)
        assert not name.startswith("on"), (tag, name)
    assert not re.search(r"https?://|url\(|@import|fetch\(|XMLHttpRequest|import\(", page)
    policies = [value for _, _, value in Page(page).attributes if "default-src" in value]
    assert policies[0].startswith("default-src 'none';")


class LargeRecord(RunRecord):
    """The record of a small run, as if it had many vehicles, whose modes change all the time."""

    def __init__(self, path: Path, count: int, length: int) -> None:
        super().__init__(path)
        self.start_at_ns = 0
        self.vehicle_names = [f"v{number}" for number in range(1, count + 1)]
        t_s = np.linspace(0.0, 600.0, length)
        noise = np.random.default_rng(1).normal(0.0, 1.0, (4, length))
        kinds = np.array(["composite", "stop", "lead"], object)[np.arange(length) % 3]
        true = {"t_s": t_s, "error_m": noise[0], "gap_m": 5.0 + noise[1], "speed_mps": noise[2]}
        true |= {"east_m": 30.0 * t_s, "north_m": noise[0], "station_m": 30.0 * t_s}
        true |= {"at_ns": np.round(1e9 * t_s).astype(np.int64), "distance_m": 30.0 * t_s}
        own = {"t_s": t_s, "lateral_error_m": noise[3], "lateral_deviation_m": noise[3] ** 2}
        verdicts = np.array(["delivered", "dropped"], object)[(noise[0] > 0.0).astype(int)]
        tables = {
            "true": DataTable(true),
            "tracking": DataTable({**own, "mode": kinds}),
            "outcomes": DataTable({"t_s": t_s, "outcome": verdicts}),
        }
        self.vehicles = dict.fromkeys(self.vehicle_names, SimpleNamespace(**tables))  # type: ignore[assignment]
        links = [(self.vehicle_names[0], name) for name in self.vehicle_names[1:]]
        self.links = dict.fromkeys(links, SimpleNamespace(**tables))  # type: ignore[assignment]

    def columns_of(self, topic: str) -> Any:
        poses = Poses(np.zeros(1, np.int64))
        return dict.fromkeys(self.vehicle_names, poses) if topic == "truth" else {}

    def topics_of(self, vehicle: str) -> set[str]:
        return {"truth", "tracking"} if vehicle else set()

    def large_summary(self) -> RunSummary:
        first, second, *_ = self.summary.vehicles
        rows = [replace(second, name=name) for name in self.vehicle_names[1:]]
        links = [replace(self.summary.links[0], receiver=row.name) for row in rows]
        warnings = tuple(f"warning number {number} " + 100 * "x" for number in range(1000))
        return replace(
            self.summary,
            vehicles=(first, *rows),
            links=(*links, *links),
            events=200 * self.summary.events,
            warnings=warnings,
            ran_s=600.0,
        )


class Poses(NamedTuple):
    """Columns of true poses, of which only the first instant is read."""

    at_ns: Any

    def __len__(self) -> int:
        return 1


@pytest.mark.parametrize(("count", "length"), [(10, 2000), (60, 500), (200, 60)])
def test_a_report_of_any_run_fits_the_size(folder: Path, count: int, length: int) -> None:
    record = LargeRecord(folder, count, length)
    page = report_page(record, record.large_summary())
    assert 0.2 * MOST_BYTES < len(page.encode()) < MOST_BYTES
    assert "Pictures along the path of the lead, m" in page
    assert Page(page).open == []


def test_curves_over_time_and_place_are_those_of_the_run(folder: Path, page: str) -> None:
    """The points of the curves are read back by the scales of their plots."""
    vehicles = RunRecord(folder).vehicles
    compared = 0
    for plot in re.findall(r"<svg[^>]*class=.plot.*?</svg>", page, re.DOTALL):
        data = dict(re.findall(r'data-(\w+)="([^"]*)"', plot[: plot.index(">")]))
        low, high = float(data["low"]), float(data["high"])
        first, last = float(data["from"]), float(data["to"])
        for path, name in re.findall(r'class="curve" d="([^"]*)"[^>]*data-name="(\w+)"', plot):
            points = np.array(re.findall(r"[ML]([-\d.]+) ([-\d.]+)", path), float)
            at = first + (points[:, 0] - 58.0) / (892.0 - 58.0) * (last - first)
            values = low + (146.0 - points[:, 1]) / 138.0 * (high - low)
            true, own = vehicles[name].true, vehicles[name].tracking
            if data["axis"] == "frequency":
                gains = frequency_gains(RunRecord(folder))
                known_at, known = (
                    gains[of][gains.vehicle == name] for of in ("frequency_hz", "gain")
                )
                assert at == pytest.approx(known_at, abs=(last - first) / 8000.0)
                assert values == pytest.approx(known, abs=(high - low) / 1300.0)
                continue
            if data["quantity"] == "own_m":
                known_at, known = own.t_s, own.lateral_error_m
            else:
                known_at = true.t_s if data["axis"] == "time" else true.station_m
                known = true[data["quantity"]]
            resolution = (last - first) / 8340.0 * np.abs(np.gradient(known, known_at)).max()
            tolerance = (high - low) / 1380.0 + resolution
            assert values == pytest.approx(np.interp(at, known_at, known), abs=tolerance + 1e-6)
            compared += 1
    assert compared == 4 * 4 - 2 + 2 * 3


def test_texts_of_a_log_are_escaped(folder: Path) -> None:
    record = RunRecord(folder)
    text = report_page(record, replace(record.summary, warnings=("</td><script>x</script>",)))
    assert "&lt;/td&gt;&lt;script&gt;x&lt;/script&gt;" in text
    assert text.count("<script>") == 1
    assert element("p", "a & b", title='"x"') == '<p title="&quot;x&quot;">a &amp; b</p>'


def test_thinning_keeps_extremes_and_breaks() -> None:
    at = np.linspace(0.0, 10.0, 5000)
    values = np.sin(7.0 * at)
    values[1234] = 5.0
    values[4000:4100] = np.nan
    times, kept = thinned(at, values, 100)
    assert times.size < 200
    assert (np.nanmax(kept), np.nanmin(kept)) == (5.0, np.nanmin(values))
    assert np.isnan(kept).any()
    assert (times[0], times[-1]) == (0.0, 10.0)
