from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.log_summary import summary_of
from scenarios.results.review import Excerpt, review
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from scenarios.results.true_motion import BodySize
from scenarios.runs.run_drawing import open_drawing
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport import drive
from tests.made.transport.recording import Table, columns
from transport.log.errors import LogError
from transport.log.writer import LogWriter
from transport.picture.layout import EVENTS
from transport.picture.option import parse_rerun_option
from vehicles.messages import Message

SCENARIO = """
name = "circle"
duration_s = 2.0
[convoy]
vehicles = 3
gap_m = 7.0
[speed]
set_mps = 10.0
[path]
kind = "segments"
heading_deg = 0.0
segments = [{ length_m = 60.0 }, { length_m = 60.0, radius_m = 50.0, turn = "left" }]
"""


def scenario(extra: str = "") -> Scenario:
    return scenario_from_text(SCENARIO.replace("[path]", extra + "[path]"))


def recorded() -> Iterator[tuple[int, Message]]:
    return drive.drive(100)


def write_log(path: Path, *, attached: bytes | None) -> None:
    with LogWriter(path) as log:
        if attached is not None:
            log.attach("scenario.toml", "application/toml", attached)
        for at, message in recorded():
            log.write(at, message)


def reviewed(log: Path, warnings: list[str] | None = None) -> Table:
    recording = log.with_suffix(".rrd")
    option = parse_rerun_option(f"save={recording}")
    received: list[str] = [] if warnings is None else warnings
    count = review(log, option, wait=lambda _: pytest.fail("waits"), warn=received.append)
    assert count > 0
    return columns(recording)


def without_start_time(table: Table) -> Table:
    return {entity: rows for entity, rows in table.items() if entity != "/__properties"}


@pytest.mark.parametrize("attached", [None, b'name = "written by a later version"\nx = 1\n'])
def test_a_log_without_a_known_scenario_is_refused(tmp_path: Path, attached: bytes | None) -> None:
    log = tmp_path / "without.mcap"
    write_log(log, attached=attached)
    for use in (reviewed, summary_of, lambda log: RunRecord(log).vehicles):
        with pytest.raises(LogError, match="scenario") as refused:
            use(log)
        assert "\n" not in str(refused.value)


def values(table: Table, quantity: str, vehicle: str) -> list[float]:
    """All values of a vehicle's curve; none if it has none."""
    rows = table.get(f"/plots/{quantity}/{vehicle}", {}).get("Scalars:scalars", [])
    return [value[0] for value in rows if value]


def largest(values: list[float]) -> float | None:
    return max(map(abs, values), default=None)


ASKEW = "[vehicle.v1]\nheading_offset_deg = 3.0\n"
BRAKING = """
name = "braking"
duration_s = 6.0
[convoy]
gap_m = 5.0
vehicles = 3
[path]
kind = "segments"
segments = [{ length_m = 300.0 }, { length_m = 40.0, radius_m = 40.0, turn = "left" }]
[speed]
lead = "profile"
followers = "gap"
profile = [{ at_s = 0.0, speed_mps = 25.0 }, { at_s = 3.0, speed_mps = 5.0 }]
[links]
loss_ratio = 0.95
[vehicle.v1]
heading_offset_deg = 3.0
[vehicle.v2]
parameters.length_m = 5.6
"""
DRIVEN = {
    "lossy": SCENARIO.replace("[path]", "[links]\nloss_ratio = 0.5\n" + ASKEW + "[path]")
    .replace("gap_m = 7.0", "gap_m = 2.0")
    .replace("set_mps = 10.0", "set_mps = 20.0"),
    "braking": BRAKING,
}


@dataclass(frozen=True)
class Drawn:
    """A run, and its picture as drawn live and again from its log."""

    folder: Path
    scenario: Scenario
    summary: RunSummary
    tables: tuple[Table, Table]


@pytest.fixture(scope="module", params=list(DRIVEN.values()), ids=list(DRIVEN))
def drawn(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    folder = tmp_path_factory.mktemp("drawn")
    driven = scenario_from_text(request.param)
    option = parse_rerun_option(f"save={folder / 'live.rrd'}")
    with open_drawing(option, driven, folder / "run.mcap") as view:
        summary = run_virtual(driven, folder, Stop(), observers=[view], watchers=[view])
    again = reviewed(folder / "run.mcap")
    return Drawn(folder, driven, summary, (columns(folder / "live.rrd"), again))


def test_the_largest_value_drawn_is_the_table_s(drawn: Drawn) -> None:
    """A curve has the extremes of the summary, live and reviewed."""
    for table in drawn.tables:
        for row in drawn.summary.vehicles:
            name = row.name
            assert largest(values(table, "cross_track", name)) == row.cross_track_error_m_max
            assert largest(values(table, "tracking", name)) == row.lateral_error_m_max
            assert min(values(table, "true_gap", name), default=None) == row.true_gap_m_min
            assert max(values(table, "true_gap", name), default=None) == row.true_gap_m_max
            assert min(values(table, "gap", name), default=None) == row.estimated_gap_m_min
            assert max(values(table, "gap", name), default=None) == row.estimated_gap_m_max
            assert (row.cross_track_error_m_max is None) == (name == "v1")
            assert (row.true_gap_m_min is None) == (name == "v1")


def place_of(table: Table, vehicle: str, at: int) -> tuple[float, float]:
    """Where a vehicle is drawn next to an instant (ns)."""
    car = table[f"/world/cars/{vehicle}"]
    near = min(range(len(car["run_time"])), key=lambda row: abs(car["run_time"][row] - at))
    east, north, _ = car["Transform3D:translation"][near][0]
    return east, north


def test_an_event_is_marked_where_it_happened(drawn: Drawn) -> None:
    """At the vehicle, or in the middle between both."""
    for table in drawn.tables:
        for kind in EVENTS:
            marks = table.get(f"/world/events/{kind}", {"run_time": []})
            for number, at in enumerate(marks["run_time"]):
                if at < 0:  # the style
                    continue
                label = table[f"/world/events/{kind}/name"]["Points2D:labels"][number][0]
                names = [name for name in drawn.scenario.vehicle_names if name in label.split()]
                places = [place_of(table, name, at) for name in names]
                east, north = (fmean(place[axis] for place in places) for axis in (0, 1))
                marked = marks["Points2D:positions"][number][0]
                assert hypot(marked[0] - east, marked[1] - north) < 1.0


def test_cars_are_drawn_as_large_as_they_collide(drawn: Drawn) -> None:
    """The outline of a car in the picture is that of its body in the figures."""
    for table in drawn.tables:
        for name in drawn.scenario.vehicle_names:
            body = table[f"/world/cars/{name}/body"]
            *lines, _screen = body["LineStrips2D:strips"][0]
            radius = body["LineStrips2D:radii"][0][0]
            x, y = ([point[axis] for line in lines for point in line] for axis in (0, 1))
            outline = (min(x) - radius, max(x) + radius, min(y) - radius, max(y) + radius)
            length, width, forward = BodySize.of(drawn.scenario.vehicle(name).parameters)
            assert outline == pytest.approx(
                (forward - length / 2, forward + length / 2, -width / 2, width / 2), abs=1e-5
            )


def test_a_truncated_log_is_shown_up_to_its_end(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    write_log(whole, attached=scenario().text.encode())
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-3000])
    warnings: list[str] = []
    assert "/world/cars/v1" in reviewed(cut, warnings)
    assert len(warnings) == 1
    assert "truncated" in warnings[0]


def test_served_pictures_wait_until_they_are_stopped(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", attached=scenario().text.encode())
    requested: list[str] = []
    review(tmp_path / "run.mcap", parse_rerun_option("serve"), wait=requested.append)
    assert len(requested) == 1
    assert requested[0].startswith("http://127.0.0.1:")


def test_a_part_has_the_rows_of_the_whole_run(drawn: Drawn, tmp_path: Path) -> None:
    option = parse_rerun_option(f"save={tmp_path / 'part.rrd'}")
    review(drawn.folder / "run.mcap", option, wait=lambda _: None, excerpt=Excerpt(0.6, 1.4))
    table, whole = columns(tmp_path / "part.rrd"), drawn.tables[1]
    for entity in [f"/plots/{name}/v3" for name in ("cross_track", "true_gap", "tracking")]:
        expected = [row for row in curve_of(whole, entity) if 0.6 <= row[0] / 1e9 <= 1.4]
        assert curve_of(table, entity) == expected
        assert len(expected) > 20
    assert all(0.6 <= at / 1e9 <= 1.4 for at in table["/world/cars/v3"]["run_time"] if at >= 0)


def curve_of(table: Table, entity: str) -> list[tuple[int, Any]]:
    rows = table[entity]
    curve = zip(rows["run_time"], rows["Scalars:scalars"], strict=True)
    return [(at, value) for at, value in curve if value]


def test_loss_shares_drawn_add_up_to_the_table_s(drawn: Drawn) -> None:
    """The table has the mean of all messages, the picture that of each half second."""
    for table in drawn.tables:
        for link in drawn.summary.links:
            shares = values(table, "loss", f"{link.sender}_to_{link.receiver}")
            assert min(shares) <= 100.0 * link.loss_ratio <= max(shares) or link.judged < 30


def test_the_review_of_a_run_has_the_rows_of_the_live_picture(drawn: Drawn) -> None:
    """Entities, components and values; also of events, lost messages and links."""
    live, again = map(without_start_time, drawn.tables)
    assert set(live) == set(again)
    for entity, table in live.items():
        assert set(table) == set(again[entity]), entity
        for name, rows in table.items():
            assert rows == again[entity][name], (entity, name)
