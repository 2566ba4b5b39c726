import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import psutil
import pytest

from tests.made.ended import has_ended
from tests.made.scenarios import messages as made
from tests.made.transport import drive
from tests.made.transport.recording import Table, columns
from transport.colours import colour_of
from transport.picture import viewer_process
from transport.picture.blueprint import MARKS, Reach
from transport.picture.option import DATA_PORT, PAGE_PORT, RerunOption, parse_rerun_option
from transport.picture.view import RerunView
from transport.picture.viewer_process import ViewerError
from vehicles.geometry.driven_path import CrossTrackError
from vehicles.messages import LogText, Message, TruePose

SECOND = 1_000_000_000
CIRCLE = [2 * math.pi * step / 100 for step in range(101)]
ROAD = (
    [drive.RADIUS * math.cos(at) for at in CIRCLE],
    [drive.RADIUS * math.sin(at) for at in CIRCLE],
)


def picture(path: Path, messages: Iterator[tuple[int, Message]]) -> Table:
    """Draw `messages` into a recording at `path`; returns each entity's columns, in time order."""
    option = parse_rerun_option(f"save={path}")
    errors = CrossTrackError(drive.VEHICLES[0])
    with RerunView(option, recording_id="circle", vehicles=drive.VEHICLES, path=ROAD) as view:
        for now, message in messages:
            view.draw(now, message)
            if isinstance(message, TruePose):
                for foot in errors.add(message):
                    view.error(foot.vehicle, foot.at_ns, foot.lateral)
    return columns(path)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Table:
    return picture(tmp_path_factory.mktemp("view") / "run.rrd", drive.drive(100))


def test_without_a_picture_rerun_is_not_loaded() -> None:
    program = """
import sys
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView
with RerunView(parse_rerun_option("off"), recording_id="x", vehicles=("v1",)) as view:
    view.draw(0, None)
assert view.destination == ""
assert not {"rerun", "rerun_bindings", "pyarrow"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_cars_are_drawn_at_their_true_poses(drawn: Table) -> None:
    car = drawn["/world/cars/v2"]
    assert car["run_time"] == [tick * drive.TICK for tick in range(0, 100, 2)]  # 25 Hz
    for tick, translation, matrix in zip(
        range(0, 100, 2), car["Transform3D:translation"], car["Transform3D:mat3x3"], strict=True
    ):
        truth = drive.truth("v2", tick)
        assert translation[0] == pytest.approx([truth.east_m, truth.north_m, 0.0], abs=1e-5)
        forward, left = matrix[0][0:3], matrix[0][3:6]  # columns of the matrix
        assert forward == pytest.approx(
            [math.cos(truth.yaw_rad), math.sin(truth.yaw_rad), 0.0], abs=1e-6
        )
        assert left == pytest.approx(
            [-math.sin(truth.yaw_rad), math.cos(truth.yaw_rad), 0.0], abs=1e-6
        )


def seen_from(frame: dict[str, list[Any]], row: int, east: float, north: float) -> Any:
    """Where a point of the world appears in a view from `frame`: to the right, down."""
    world_from_view = np.array(frame["Transform3D:mat3x3"][row][0]).reshape(3, 3).T
    origin = np.array(frame["Transform3D:translation"][row][0])
    return np.linalg.solve(world_from_view, np.array([east, north, 0.0]) - origin)[:2]


def test_north_is_up_in_the_plan(drawn: Table) -> None:
    plan = drawn["/world/plan"]
    assert seen_from(plan, 0, 1.0, 0.0) == pytest.approx([1.0, 0.0])
    assert seen_from(plan, 0, 0.0, 1.0) == pytest.approx([0.0, -1.0])


def test_left_turns_turn_left_in_the_moving_view(drawn: Table) -> None:
    """The middle car stays in place facing right; on a left circle the lead is ahead and up."""
    convoy = drawn["/world/convoy"]
    for row, tick in enumerate(range(0, 100, 2)):
        middle, lead = drive.truth("v2", tick), drive.truth("v1", tick)
        assert seen_from(convoy, row, middle.east_m, middle.north_m) == pytest.approx(
            [0.0, 0.0], abs=1e-4
        )
        right, down = seen_from(convoy, row, lead.east_m, lead.north_m)
        turn = drive.SPACING / drive.RADIUS
        assert right == pytest.approx(drive.RADIUS * math.sin(turn), abs=1e-3)
        inside = drive.offset_of(1)
        assert down == pytest.approx(drive.RADIUS * (math.cos(turn) - 1.0) + inside, abs=1e-3)
        assert down < -1.0


def test_each_cross_track_error_is_drawn(drawn: Table) -> None:
    assert "/plots/cross_track/v1" not in drawn
    curve = drawn["/plots/cross_track/v2"]["Scalars:scalars"]
    values = [value[0] for value in curve if value]
    assert len(values) == 100  # all of them: a missing value might be the largest
    late = values[-10:]  # earlier it is next to the lead's run-in
    assert late == pytest.approx([drive.offset_of(1)] * 10, abs=1e-3)


def test_a_picture_that_breaks_off_holds_all_that_was_drawn(tmp_path: Path) -> None:
    *messages, _end = drive.drive(30)
    curve = picture(tmp_path / "run.rrd", iter(messages))["/plots/tracking/v3"]
    assert len([value for value in curve["Scalars:scalars"] if value]) == 30


def test_the_band_of_an_error_is_three_deviations_wide(drawn: Table) -> None:
    band = drawn["/plots/tracking/v3/band"]
    variances = [value[0] for value in band["Measurements:variances"] if value]
    assert variances == pytest.approx([0.06**2] * len(variances))
    assert len(variances) >= 9  # 100 ticks of 20 ms, drawn every 200 ms
    curve = drawn["/plots/tracking/v3"]
    known = dict(zip(curve["run_time"], curve["Scalars:scalars"], strict=True))
    for at, value in zip(band["run_time"], band["Measurements:values"], strict=True):
        if value:
            assert value == known[at]


def test_curves_are_those_of_the_messages(drawn: Table) -> None:
    steering = drawn["/plots/steering/v3"]["Scalars:scalars"]
    assert [v[0] for v in steering if v] == pytest.approx([3.0] * 50)  # degrees
    seen = drawn["/plots/tracking/v3"]
    values = {
        at: value[0]
        for at, value in zip(seen["run_time"], seen["Scalars:scalars"], strict=True)
        if value
    }
    assert values == {tick * drive.TICK: pytest.approx(0.01 * tick) for tick in range(100)}
    assert "/plots/gap/v1" not in drawn
    assert [v[0] for v in drawn["/plots/gap/v2"]["Scalars:scalars"] if v] == [drive.SPACING] * 100
    for source, age in (("lead", 0.03), ("predecessor", 0.02)):
        ages = drawn[f"/plots/age/v3/{source}"]["Scalars:scalars"]
        assert [v[0] for v in ages if v] == [age] * 10
    assert "/plots/age/v2/predecessor" not in drawn  # its predecessor is the lead
    lead, predecessor = (
        drawn[f"/plots/age/v3/{source}"]["SeriesLines:colors"][0]
        for source in ("lead", "predecessor")
    )
    assert lead != predecessor


def test_samples_have_the_colour_of_their_sender(drawn: Table) -> None:
    def colour(vehicle: str) -> int:
        value: int = drawn[f"/world/cars/{vehicle}/dot"]["Points2D:colors"][0][0]
        return value

    samples = drawn["/world/samples/v3"]
    shown = [colours for colours in samples["Points2D:colors"] if colours]
    assert shown == [[colour("v1"), colour("v2")]] * 20
    assert len({colour(vehicle) for vehicle in drive.VEHICLES}) == 3
    strip = drawn["/world/trajectory/v3"]["LineStrips2D:colors"][0]
    assert strip == [colour("v3")]


def test_driven_pieces_join_to_the_driven_path(drawn: Table) -> None:
    strips = drawn["/world/driven/v1"]["LineStrips2D:strips"]
    pieces = [strip[0] for strip in strips if strip]
    for piece, following in pairwise(pieces):
        assert piece[-1] == following[0]
    last = drive.truth("v1", 90)
    assert pieces[-1][-1] == pytest.approx([last.east_m, last.north_m], abs=1e-4)
    assert sum(len(piece) - 1 for piece in pieces) == 45


def test_text_has_speaker_and_level(drawn: Table) -> None:
    change = 'run: change by hand: {"at_s": 0.0, "kind": "heal"}'
    lines = [text for (text,) in drawn["/log/run"]["TextLog:text"]]
    assert [line.split(maxsplit=2) for line in lines] == [
        ["0.00", "s", "run: off"], ["0.00", "s", change],
    ]  # fmt: skip
    assert drawn["/log/run"]["TextLog:level"] == [["WARN"], ["INFO"]]


def states(table: Table, entity: str) -> list[tuple[int, str]]:
    rows = table[entity]
    return [
        (at // 1_000_000, state[0])
        for at, state in zip(rows["run_time"], rows["StateChange:state"], strict=True)
        if state
    ]


def test_links_and_messages_have_states(tmp_path: Path) -> None:
    def messages() -> Iterator[tuple[int, Message]]:
        outcomes = {30: "loss", 31: "loss", 34: "late"}
        for tick in range(200):
            now = drive.START + tick * drive.TICK
            yield now, drive.truth("v2", tick)
            if tick < 50 or tick >= 100:
                yield now, drive.verdict("v2", "v1", tick, now, outcomes.get(tick, "ok"))

    table = picture(tmp_path / "run.rrd", messages())
    assert states(table, "/links/v1_to_v2") == [
        (0, "ok"), (500, "10 % lost"), (1000, "silent"), (2000, "ok"),
    ]  # fmt: skip
    loss = table["/plots/loss/v1_to_v2"]
    shares = [
        (at // 1_000_000, value[0])
        for at, value in zip(loss["run_time"], loss["Scalars:scalars"], strict=True)
        if value
    ]
    assert shares == [(0, 0.0), (500, 8.0), (2000, 0.0), (2500, 0.0), (3000, 0.0)]
    assert states(table, "/messages/v1_to_v2") == [
        (0, "ok"), (600, "lost"), (640, "ok"), (680, "late"), (700, "ok"),
    ]  # fmt: skip


def test_a_recorder_that_is_seconds_behind_shows_the_same(tmp_path: Path) -> None:
    """Windows close by the receiver's time: 95 % of a run came at once, and nothing is silent."""

    def messages(delay: int) -> Iterator[tuple[int, Message]]:
        for tick in range(200):
            at = drive.START + tick * drive.TICK
            now = at if tick < 10 else drive.START + delay
            yield max(now, at), drive.truth("v2", tick)
            yield max(now, at), drive.verdict("v2", "v1", tick, at, "ok")

    for delay in (0, 30 * SECOND):
        table = picture(tmp_path / f"{delay}.rrd", messages(delay))
        assert states(table, "/links/v1_to_v2") == [(0, "ok")]


def test_the_vehicle_furthest_off_is_marked(tmp_path: Path) -> None:
    def messages() -> Iterator[tuple[int, Message]]:
        for seq in range(150):
            offset = 0.5 if 50 <= seq < 100 else 0.05
            for name, behind, left in (("v1", 0.0, 0.0), ("v2", 15.0, 0.0), ("v3", 30.0, offset)):
                pose = made.truth(name, seq, 0.6 * seq - behind, left)
                yield pose.true_at_ns, pose

    table = picture(tmp_path / "run.rrd", messages())
    labels = table["/world/cars/v3/worst/name"]["Points2D:labels"]
    assert labels[0] == ["v3 +0.50 m"]
    assert not labels[-1]
    rings = table["/world/cars/v3/worst"]["Points2D:positions"]
    assert rings[0] == [[0.0, 0.0]]  # in the car's own frame, so it moves with it
    assert not rings[-1]
    assert "/world/cars/v2/worst" not in table


FAR = 400.0


@pytest.mark.parametrize("lead", ["ahead", "aside"])
def test_the_moving_view_contains_the_lead(tmp_path: Path, lead: str) -> None:
    """However far away it is: then the view shows more."""
    option = parse_rerun_option(f"save={tmp_path / 'run.rrd'}")
    reach = Reach.of(3, 15.0, None)
    with RerunView(option, recording_id="x", vehicles=("v1", "v2", "v3"), spacing_m=15.0) as view:
        for seq in range(20):
            far = FAR if seq >= 10 else 30.0
            first = (far, 0.0) if lead == "ahead" else (30.0, far - 30.0)
            for name, (x, left) in {"v1": first, "v2": (15.0, 0.0), "v3": (0.0, 0.0)}.items():
                pose = made.truth(name, seq, x + 0.4 * seq, left)
                view.draw(pose.true_at_ns, pose)
    table = columns(tmp_path / "run.rrd")
    convoy, car = table["/world/convoy"], table["/world/cars/v1"]
    for row in range(len(convoy["run_time"])):
        east, north, _ = car["Transform3D:translation"][row][0]
        right, down = seen_from(convoy, row, east, north)
        assert -reach.behind < right < reach.ahead
        assert abs(down) < reach.lateral


def test_a_car_is_drawn_in_its_size(tmp_path: Path) -> None:
    option = parse_rerun_option(f"save={tmp_path / 'run.rrd'}")
    with RerunView(option, recording_id="x", vehicles=("v1",), cars={"v1": (6.0, 2.0, 0.5)}):
        pass
    body = columns(tmp_path / "run.rrd")["/world/cars/v1/body"]
    *lines, _screen = body["LineStrips2D:strips"][0]
    radius = body["LineStrips2D:radii"][0][0]
    x, y = ([point[axis] for line in lines for point in line] for axis in (0, 1))
    outline = (min(x) - radius, max(x) + radius, min(y) - radius, max(y) + radius)
    assert outline == pytest.approx((-2.5, 3.5, -1.0, 1.0))


def test_a_mark_stands_at_its_place_and_at_its_instant(tmp_path: Path) -> None:
    """Also if the event is detected later."""
    option = parse_rerun_option(f"save={tmp_path / 'run.rrd'}")
    with RerunView(option, recording_id="x", vehicles=("v1", "v2")) as view:
        for seq in range(50):
            pose = made.truth("v1", seq, 0.4 * seq, 0.0)
            view.draw(pose.true_at_ns, pose)
        at = made.truth("v1", 20, 0.0, 0.0).true_at_ns
        view.mark("near_miss", at, (8.0, 1.0), ("v1", "v2"))
    table = columns(tmp_path / "run.rrd")
    spot, name = table["/world/events/near_miss"], table["/world/events/near_miss/name"]
    assert spot["run_time"] == name["run_time"] == [400_000_000]
    assert spot["Points2D:positions"] == [[[8.0, 1.0]]]
    assert name["Points2D:labels"] == [["near miss v2 v1"]]
    assert name["Points2D:positions"][0][0][1] < 0.0  # to the right, off the road
    for plot in ("cross_track", "true_gap"):
        curve = table[f"/plots/{plot}/events/near_miss"]
        shown = [
            (at, value)
            for at, value in zip(curve["run_time"], curve["Scalars:scalars"], strict=True)
            if value
        ]
        assert shown == [(400_000_000, [0.0])]


def test_colours_of_events_are_those_of_no_car() -> None:
    for colour, _, _ in MARKS.values():
        for place in range(20):
            apart = [abs(a - b) for a, b in zip(colour, colour_of(place), strict=True)]
            assert sum(apart) > 120
    assert len({shape for _, shape, _ in MARKS.values()}) == len(MARKS)


def test_lane_edges_lie_half_a_lane_beside_the_path(tmp_path: Path) -> None:
    option = parse_rerun_option(f"save={tmp_path / 'run.rrd'}")
    straight = ([0.0, 50.0, 100.0], [0.0, 0.0, 0.0])
    with RerunView(option, recording_id="x", vehicles=drive.VEHICLES, path=straight, lane_m=3.5):
        pass
    left, right = columns(tmp_path / "run.rrd")["/world/road/lane"]["LineStrips2D:strips"][0]
    assert left == [[0.0, 1.75], [50.0, 1.75], [100.0, 1.75]]
    assert right == [[0.0, -1.75], [50.0, -1.75], [100.0, -1.75]]


def test_messages_from_before_the_start_have_negative_times(tmp_path: Path) -> None:
    start, (now, text), *others = drive.drive(1)
    assert isinstance(text, LogText)
    early = (now, replace(text, logged_at_ns=now - 2 * SECOND))
    drawn = picture(tmp_path / "run.rrd", iter((early, start, *others)))
    assert drawn["/log/run"]["run_time"] == [-2 * SECOND, 0]  # the text, and a change at the start
    assert drawn["/world/cars/v1"]["run_time"] == [0]


def test_the_view_follows_a_vehicle_that_still_sends(tmp_path: Path) -> None:
    def messages() -> Iterator[tuple[int, Message]]:
        for tick in range(150):
            for vehicle in drive.VEHICLES:
                if vehicle != "v2" or tick < 20:
                    yield drive.START + tick * drive.TICK, drive.truth(vehicle, tick)

    convoy = picture(tmp_path / "run.rrd", messages())["/world/convoy"]
    last = drive.truth("v3", 148)
    assert seen_from(convoy, -1, last.east_m, last.north_m) == pytest.approx([0.0, 0.0], abs=1e-4)


@pytest.mark.parametrize("first", [drive.command("x", 0), drive.tracking("x", 0)])
def test_an_unannounced_vehicle_is_drawn_too(tmp_path: Path, first: Message) -> None:
    start = next(drive.drive(1))
    table = picture(tmp_path / "run.rrd", iter((start, (drive.START, first), start)))
    assert "/world/cars/x/body" in table


def test_connecting_without_a_viewer_is_an_error() -> None:
    option = parse_rerun_option("connect=rerun+http://127.0.0.1:1/proxy")
    with pytest.raises(ViewerError, match="no Rerun viewer listens"):
        RerunView(option, recording_id="x", vehicles=("v1",))


def test_spawning_without_a_display_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(ViewerError, match="no display here"):
        RerunView(parse_rerun_option("spawn"), recording_id="x", vehicles=("v1",))


def test_a_recording_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ViewerError, match="cannot write the recording"):
        RerunView(
            RerunOption("save", str(tmp_path / "no" / "x.rrd")), recording_id="x", vehicles=("v1",)
        )


SERVE = """
import time
from tests.made.scenarios import messages as made
from tests.made.transport import drive
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView
view = RerunView(parse_rerun_option("serve"), recording_id="x", vehicles=drive.VEHICLES)
for now, message in drive.drive(20):
    view.draw(now, message)
print(view.destination, flush=True)
time.sleep(60)
"""


TAKEN = """
import socket, sys, time
taken = socket.create_server(("127.0.0.1", 0))
print(taken.getsockname()[1], flush=True)
time.sleep(60)
"""


@pytest.fixture
def taken_port() -> Iterator[int]:
    """Yield a port that another program listens on."""
    program = subprocess.Popen([sys.executable, "-c", TAKEN], stdout=subprocess.PIPE, text=True)
    try:
        assert program.stdout
        yield int(program.stdout.readline())
    finally:
        program.kill()
        program.communicate()


def test_a_free_port_that_is_taken_meanwhile(
    taken_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    free, requested = viewer_process.free_port, Counter[int]()

    def outrun(address: str, preferred: int) -> int:
        requested[preferred] += 1
        return taken_port if requested[preferred] == 1 else free(address, 0)

    monkeypatch.setattr(viewer_process, "free_port", outrun)
    with RerunView(parse_rerun_option("serve"), recording_id="x", vehicles=drive.VEHICLES) as view:
        assert requested == {PAGE_PORT: 2, DATA_PORT: 2}
        assert str(taken_port) not in view.destination
        page, data = (
            int(port) for port in re.findall(r"127\.0\.0\.1(?::|%3A)(\d+)", view.destination)
        )
        listening = {c.laddr.port for c in psutil.Process().net_connections("tcp") if not c.raddr}
        assert data in listening
        assert urlopen(f"http://127.0.0.1:{page}", timeout=5.0).status == 200


def test_a_requested_port_that_is_taken_later(
    taken_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer_process, "_bound", lambda _address, port: port)
    option = parse_rerun_option(f"serve=127.0.0.1:0:{taken_port}")
    with pytest.raises(ViewerError, match=f"{taken_port}: address already in use.*--serve-at"):
        RerunView(option, recording_id="x", vehicles=drive.VEHICLES)


def test_the_web_page_is_local_and_ends_with_its_parent() -> None:
    server = subprocess.Popen([sys.executable, "-c", SERVE], stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout
        assert server.stdout.readline().startswith("http://127.0.0.1:")
        ours = psutil.Process(server.pid)
        everyone = [ours, *ours.children(recursive=True)]
        listening = [
            c.laddr.ip
            for process in everyone
            for c in process.net_connections("inet")
            if c.status == psutil.CONN_LISTEN
        ]
        assert len(listening) == 2  # the page and its data
        assert set(listening) == {"127.0.0.1"}
        page = everyone[1]
        assert page.environ()["CI"] == "1"  # no usage statistics
    finally:
        os.kill(server.pid, signal.SIGKILL)
        server.wait()
    deadline = time.monotonic() + 5.0
    while time.monotonic() < deadline and not has_ended(page):
        time.sleep(0.02)
    assert has_ended(page)
