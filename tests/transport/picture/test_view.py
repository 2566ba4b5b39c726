import math
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from tests.made.ended import has_ended
from tests.made.scenarios import messages as made
from tests.made.transport import drive
from tests.made.transport.recording import Table, batch_of, scene_of
from tests.made.transport.recording import drawn as recorded
from transport.picture.batch import BATCH_NS, VehicleValues
from transport.picture.option import RerunOption, parse_rerun_option
from transport.picture.view import RerunView
from transport.picture.viewer_process import ViewerError
from transport.topics import valid_at
from vehicles.messages import Message, TruePose

CIRCLE = [2 * math.pi * step / 100 for step in range(101)]
ROAD = (
    [drive.RADIUS * math.cos(at) for at in CIRCLE],
    [drive.RADIUS * math.sin(at) for at in CIRCLE],
)


SCENE = scene_of(drive.VEHICLES, ROAD)


def off_circle(pose: TruePose) -> float:
    return drive.RADIUS - math.hypot(pose.east_m, pose.north_m)


def picture(
    path: Path,
    messages: Sequence[Message],
    parts: int = 1,
    error_of: Callable[[TruePose], float] = off_circle,
) -> Table:
    """Draw `messages` in parts into a recording at `path`; returns each entity's columns."""
    start = min(map(valid_at, messages))
    ends = [start + part * 10 * BATCH_NS // parts for part in range(parts + 1)]
    batches = []
    for begin, end in pairwise(ends):
        errors: dict[str, list[tuple[int, float]]] = defaultdict(list)
        for one in messages:
            if isinstance(one, TruePose) and begin <= one.true_at_ns < end:
                errors[one.vehicle].append((one.true_at_ns, error_of(one)))
        values = {
            name: VehicleValues(*map(np.array, zip(*errors[name], strict=True)))
            for name in drive.VEHICLES[1:]
            if errors[name]
        }
        some_messages = [one for one in messages if begin <= valid_at(one) < end]
        batches.append(batch_of(some_messages, start, values))
    return recorded(path, SCENE, *batches)


def driven(ticks: int) -> list[Message]:
    return [message for _, message in drive.drive(ticks)]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Table:
    return picture(tmp_path_factory.mktemp("view") / "run.rrd", driven(100))


@pytest.mark.parametrize("parts", [10, 70])
def test_batches_of_any_length_give_the_same_rows(drawn: Table, tmp_path: Path, parts: int) -> None:
    again = picture(tmp_path / "run.rrd", driven(100), parts)
    assert {**again, "/__properties": None} == {**drawn, "/__properties": None}


def test_without_a_picture_rerun_is_not_loaded(tmp_path: Path) -> None:
    program = """
import contextlib, sys
from scenarios.cli.main import cli
with contextlib.suppress(SystemExit):
    cli(["run", "lane_change", "--clock", "virtual", "--set", "duration_s=0.1", "--quiet"])
assert {"mcap", "scenarios.cli.display"} < set(sys.modules)
assert not {"rerun", "rerun_bindings"} & set(sys.modules)
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run(
        [sys.executable, "-c", program], check=True, cwd=tmp_path, env=environment, timeout=60
    )


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


def states(table: Table, entity: str) -> list[tuple[int, str]]:
    rows = table[entity]
    return [
        (at // 1_000_000, state[0])
        for at, state in zip(rows["run_time"], rows["StateChange:state"], strict=True)
        if state
    ]


def test_links_and_messages_have_states(tmp_path: Path) -> None:
    def messages() -> Iterator[Message]:
        outcomes = {30: "loss", 31: "loss", 34: "late"}
        for tick in range(200):
            now = drive.START + tick * drive.TICK
            yield drive.truth("v2", tick)
            if tick < 50 or tick >= 100:
                yield drive.verdict("v2", "v1", tick, now, outcomes.get(tick, "ok"))

    table = picture(tmp_path / "run.rrd", list(messages()), error_of=lambda pose: pose.north_m)
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


def test_the_vehicle_furthest_off_is_marked(tmp_path: Path) -> None:
    def messages() -> Iterator[Message]:
        for seq in range(150):
            offset = 0.5 if 50 <= seq < 100 else 0.05
            for name, behind, left in (("v1", 0.0, 0.0), ("v2", 15.0, 0.0), ("v3", 30.0, offset)):
                pose = made.truth(name, seq, 0.6 * seq - behind, left)
                yield pose

    table = picture(tmp_path / "run.rrd", list(messages()), error_of=lambda pose: pose.north_m)
    labels = table["/world/cars/v3/worst/name"]["Points2D:labels"]
    assert [label for label in labels if label] == [["v3 +0.50 m"]] * 2  # for one second
    assert not labels[-1]
    rings = table["/world/cars/v3/worst"]["Points2D:positions"]
    assert [ring for ring in rings if ring] == [[[0.0, 0.0]]] * 2  # in the car's own frame
    assert not rings[-1]
    assert not any(table["/world/cars/v2/worst"]["Points2D:positions"])


def test_lane_edges_lie_half_a_lane_beside_the_path(tmp_path: Path) -> None:
    straight = ([0.0, 50.0, 100.0], [0.0, 0.0, 0.0])
    table = recorded(tmp_path / "run.rrd", replace(SCENE, path=straight, lane_m=3.5))
    left, right = table["/world/road/lane"]["LineStrips2D:strips"][0]
    assert left == [[0.0, 1.75], [50.0, 1.75], [100.0, 1.75]]
    assert right == [[0.0, -1.75], [50.0, -1.75], [100.0, -1.75]]


def test_connecting_without_a_viewer_is_an_error() -> None:
    option = parse_rerun_option("connect=rerun+http://127.0.0.1:1/proxy")
    with pytest.raises(ViewerError, match="no Rerun viewer listens"):
        RerunView(option, recording_id="x", scene=SCENE)


def test_spawning_without_a_display_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(ViewerError, match="no display here"):
        RerunView(parse_rerun_option("spawn"), recording_id="x", scene=SCENE)


def test_a_recording_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ViewerError, match="cannot write the recording"):
        RerunView(
            RerunOption("save", str(tmp_path / "no" / "x.rrd")), recording_id="x", scene=SCENE
        )


SERVE = """
import time
from tests.made.transport import drive
from tests.made.transport.recording import batch_of, scene_of
from transport.picture.option import parse_rerun_option
from transport.picture.view import RerunView
scene = scene_of(drive.VEHICLES)
view = RerunView(parse_rerun_option("serve"), recording_id="x", scene=scene)
view.draw(batch_of([message for _, message in drive.drive(20)], drive.START))
print(view.destination, flush=True)
time.sleep(60)
"""


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
