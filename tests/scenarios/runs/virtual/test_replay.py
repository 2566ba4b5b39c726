"""A recorded vehicle on the bus: the same messages, and the same followers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.drives import Trial
from scenarios.results.files import LOG_NAME
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.recorded_vehicle import (
    RecordedVehicle,
    Replay,
    read_recorded_vehicle,
)
from scenarios.runs.node.sink import BusSink
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.virtual import drive_trial, record_trial
from tests.made.transport.links import inbox as inbox_of
from transport.bus.bus import MemoryBus
from transport.codec import decode, encode
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import TOPICS
from vehicles.messages import GpsPose, Message, TruePose

SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def convoy() -> Scenario:
    return load_scenario("lane_change", ["duration_s=6.0", "convoy.vehicles=3"], seed=5)


@pytest.fixture(scope="module")
def recorded(convoy: Scenario, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Trial]:
    folder = tmp_path_factory.mktemp("recorded")
    return folder / LOG_NAME, record_trial(convoy, folder)


@pytest.fixture(scope="module")
def lead(recorded: tuple[Path, Trial]) -> RecordedVehicle:
    return read_recorded_vehicle(recorded[0], "v1")


def published(drive: RecordedVehicle, start_at: int) -> list[Message]:
    """What comes over the bus while the record is replayed."""
    received: list[Message] = []
    bus = MemoryBus()
    bus.subscribe("convoy/v1/gps", lambda _, data: received.append(decode(TOPICS["gps"], data)))
    bus.subscribe("convoy/v1/truth", lambda _, data: received.append(decode(TOPICS["truth"], data)))
    play(drive.replay(start_at=start_at), start_at, bus)
    return received


def play(replay: Replay, start_at: int, bus: MemoryBus) -> list[int]:
    """Send the messages of a replay in a run from `start_at`; return the instants of its ticks."""
    builder = VehicleBuilder(load_scenario("lane_change", ["duration_s=6.0"]), "v1", replay)
    node = builder.node(start_at, BusSink("v1", bus), NoProbe())
    ticks = list(builder.ticks(start_at))
    for tick in ticks:
        node.step(tick)
    return [tick.at for tick in ticks]


def test_a_replayed_vehicle_sends_the_recorded_messages(
    convoy: Scenario, recorded: tuple[Path, Trial], lead: RecordedVehicle
) -> None:
    later = convoy.start_at_ns + 300 * SECOND
    reported = published(lead, later)
    log = [m for _, _, m in LogReader(recorded[0]).messages(topics=("gps",), vehicles=("v1",))]
    poses = [message for message in reported if isinstance(message, GpsPose)]
    back = [
        replace(
            p,
            measured_at_ns=p.measured_at_ns - 300 * SECOND,
            sent_at_ns=p.sent_at_ns - 300 * SECOND,
            relayed_stops_at_ns=tuple(at and at - 300 * SECOND for at in p.relayed_stops_at_ns),
        )
        for p in poses
    ]
    assert len(poses) == 120
    # As bytes: a number that is not known is unlike itself.
    assert [encode(pose) for pose in back] == [encode(pose) for pose in log]
    truth = [message for message in reported if isinstance(message, TruePose)]
    assert [t.true_at_ns - later for t in truth] == [k * SECOND // 50 for k in range(300)]


def test_followers_treat_replayed_and_live_cars_alike(
    convoy: Scenario, recorded: tuple[Path, Trial]
) -> None:
    log, live = recorded
    replays = [
        read_recorded_vehicle(log, name).replay(start_at=convoy.start_at_ns)
        for name in ("v1", "v2")
    ]
    again = drive_trial(convoy, replays)
    assert [drive.name for drive in again.drives] == ["v1", "v2", "v3"]
    for drive, before in zip(again.drives, live.drives, strict=True):
        assert np.array_equal(drive.east, before.east)
        assert np.array_equal(drive.cross_track, before.cross_track)
    assert np.array_equal(again.drives[2].lateral_error, live.drives[2].lateral_error)
    assert again.drives[0].lateral_error.size == 0  # a replayed car decides nothing


def test_a_record_longer_than_the_run_counts_up_to_the_end_of_the_run(
    recorded: tuple[Path, Trial], tmp_path: Path
) -> None:
    short = load_scenario("lane_change", ["duration_s=3.0", "convoy.vehicles=3"], seed=5)
    lead = read_recorded_vehicle(recorded[0], "v1")
    assert lead.poses[-1].measured_at_ns - lead.started_at > 5 * SECOND
    logged = record_trial(short, tmp_path, [lead.replay(start_at=short.start_at_ns)])
    kept = drive_trial(short, [lead.replay(start_at=short.start_at_ns)])
    assert [len(drive.at) for drive in kept.drives] == [150, 150, 150]
    for drive, again in zip(kept.drives, logged.drives, strict=True):
        assert np.array_equal(drive.cross_track, again.cross_track)


def test_a_vehicle_that_the_log_does_not_hold_is_named_with_those_it_does(
    recorded: tuple[Path, Trial],
) -> None:
    with pytest.raises(LogError, match=r"no poses of 'v9', but of v1, v2, v3"):
        read_recorded_vehicle(recorded[0], "v9")


def test_it_is_replayed_in_order_of_time(lead: RecordedVehicle) -> None:
    instants = play(lead.replay(start_at=7 * SECOND), 7 * SECOND, MemoryBus())
    assert instants == sorted(instants)
    assert instants[0] == 7 * SECOND


def test_an_inbox_takes_every_replayed_pose(lead: RecordedVehicle) -> None:
    start_at = 1_000 * SECOND
    inbox = inbox_of(
        "v2", {"v1": LinkTable()}, start_at=start_at, origin=load_scenario("lane_change").origin
    )
    bus = MemoryBus()
    bus.subscribe(inbox.keys[0], inbox.on_bytes)
    replay = lead.replay(start_at=start_at)
    play(replay, start_at, bus)
    received = inbox.take(start_at + 10 * SECOND)
    assert not inbox.rejected
    assert len(received) == sum(isinstance(message, GpsPose) for message in replay.messages)
