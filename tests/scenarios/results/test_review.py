from collections.abc import Iterator
from pathlib import Path

import pytest

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.review import open_view, review, widest_gap
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport import drive
from tests.made.transport.recording import Table, columns
from transport.codec import encode
from transport.log.records import LogError
from transport.log.writer import LogWriter
from transport.picture.option import parse_rerun_option
from transport.topics import TOPIC_OF
from vehicles.messages import Message

SCENARIO = """
name = "circle"
duration_s = 2.0
[convoy]
vehicles = 3
gap_m = 12.0
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
            log.write(TOPIC_OF[type(message)], message.vehicle, encode(message), at, None, message)


def reviewed(log: Path, warnings: list[str] | None = None) -> Table:
    recording = log.with_suffix(".rrd")
    option = parse_rerun_option(f"save={recording}")
    heard: list[str] = [] if warnings is None else warnings
    count = review(log, option, wait=lambda _: pytest.fail("waits"), warn=heard.append)
    assert count > 0
    return columns(recording)


def without_start_time(table: Table) -> Table:
    return {entity: rows for entity, rows in table.items() if entity != "/__properties"}


def test_a_reviewed_log_is_drawn_as_the_run_was(tmp_path: Path) -> None:
    live = tmp_path / "live.rrd"
    with open_view(parse_rerun_option(f"save={live}"), scenario(), "circle") as view:
        for now, message in recorded():
            view.draw(now, message)
    write_log(tmp_path / "run.mcap", attached=scenario().text.encode())
    again = reviewed(tmp_path / "run.mcap")
    assert without_start_time(again) == without_start_time(columns(live))
    assert "/world/road/path" in again
    assert len(again["/world/cars/v3"]["run_time"]) == 50


def test_the_picture_has_the_title_of_the_run(tmp_path: Path) -> None:
    """So that two runs of other settings can be told apart in the viewer."""
    asked = scenario_from_text(SCENARIO, overrides=["convoy.gap_m=8"], seed=7)
    write_log(tmp_path / "run.mcap", attached=asked.text.encode())
    said = str(reviewed(tmp_path / "run.mcap")["/__properties"])
    assert "circle, seed 7, α 0.5, loss 0 %, convoy.gap_m=8" in said


@pytest.mark.parametrize("attached", [None, b'name = "written by a later version"\nx = 1\n'])
def test_without_a_scenario_only_the_road_is_missing(
    tmp_path: Path, attached: bytes | None
) -> None:
    write_log(tmp_path / "with.mcap", attached=scenario().text.encode())
    write_log(tmp_path / "without.mcap", attached=attached)
    warnings: list[str] = []
    road = {"/world/road/path", "/world/road/marks", "/world/road/lane"}
    whole = without_start_time(reviewed(tmp_path / "with.mcap"))
    rest = without_start_time(reviewed(tmp_path / "without.mcap", warnings))
    assert {entity: rows for entity, rows in whole.items() if entity not in road} == rest
    assert len(warnings) == (attached is not None)
    assert all("the road is left out" in line for line in warnings)


def largest(table: Table, quantity: str, vehicle: str) -> float | None:
    """Largest magnitude of a vehicle's curve, None if it has none."""
    rows = table.get(f"/plots/{quantity}/{vehicle}", {}).get("Scalars:scalars", [])
    return max((abs(value[0]) for value in rows if value), default=None)


ASKEW = "[vehicle.v1]\nheading_offset_deg = 3.0\n"


@pytest.mark.parametrize("extra", ["", ASKEW, "[links]\nloss_ratio = 0.5\n" + ASKEW])
def test_the_largest_value_drawn_is_the_table_s(extra: str, tmp_path: Path) -> None:
    """Live and reviewed: whoever reads the curve finds the number of the table there."""
    driven = scenario(extra)
    live = tmp_path / "live.rrd"
    with open_view(parse_rerun_option(f"save={live}"), driven, "run") as view:
        summary = run_virtual(driven, tmp_path, Stop(), listeners=[view.draw])
    for table in (columns(live), reviewed(tmp_path / "run.mcap")):
        for row in summary.vehicles:
            name, error = row.name, row.cross_track_error_m_max
            assert largest(table, "cross_track", name) == error
            assert largest(table, "tracking", name) == row.lateral_error_m_max
            assert (error is None) == (name == "v1")
            assert error is None or 0.0 < error < 1.0
            if name != "v1":
                gaps = table[f"/plots/gap/{name}"]["Scalars:scalars"]
                assert min(value[0] for value in gaps if value) == row.gap_m_min


def test_a_log_that_breaks_off_is_shown_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = tmp_path / "whole.mcap"
    write_log(whole, attached=None)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-3000])
    warnings: list[str] = []
    assert "/world/cars/v1" in reviewed(cut, warnings)
    assert len(warnings) == 1
    assert "breaks off" in warnings[0]


def test_served_pictures_wait_until_nobody_looks(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", attached=None)
    asked: list[str] = []
    review(tmp_path / "run.mcap", parse_rerun_option("serve"), wait=asked.append)
    assert len(asked) == 1
    assert asked[0].startswith("http://127.0.0.1:")


def test_a_log_without_vehicles_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        start = next(message for _, message in recorded())
        log.write(TOPIC_OF[type(start)], "run", encode(start), 0, None, start)
    with pytest.raises(LogError, match="no vehicle's messages"):
        review(path, parse_rerun_option("off"), wait=lambda _: None)


def test_the_view_leaves_room_for_the_widest_gap() -> None:
    assert widest_gap(scenario()) == 12.0
    keeping = 'followers = "gap"\ngap = { standstill_m = 8.0, headway_s = 0.5 }\n'
    assert widest_gap(scenario(keeping)) == pytest.approx(8.0 + 0.5 * 10.0, abs=0.2)
    assert widest_gap(scenario_from_text(SCENARIO.replace("vehicles = 3", "vehicles = 1"))) > 0
