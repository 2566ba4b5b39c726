"""Another Zenoh client puts what does not belong there on a convoy's keys."""

import random
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.runs.control.open_runs import open_runs
from tests.made.scenarios.hostile_messages import Put, Stranger
from tests.system.logs import (
    Run,
    agreement,
    assert_equal_while_nothing_was_late,
    assert_nothing_missing,
    assert_sound,
    assert_summary_is_in_the_log,
)
from tests.system.processes import Process, run_to_the_end, start
from transport.bus.bus import Bus
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.codec import RefusedMessageError, encode
from transport.telemetry import BatchRecord, packed, records_key, unpacked
from transport.topics import RUN_SENDER, TOPIC_OF, TOPICS, Topic, key, valid_at
from vehicles.messages import GpsPose, LogText, Message, RunEnd, RunStart, Tracking

BURST, BREATH_S = 20, 0.01
"""Messages put at once, and the pause after them: of more than its queue holds a router drops what
is honest, too."""
LOST_RATIO = 0.05
"""Of the log, on a machine that is too busy to pass all of a flood on; it is named as missing."""
AROUND_S = 2.0
"""So much longer than the attack is the run."""
DRAWN = 100
"""Messages drawn at random in each round, beside those that are known to be of interest."""
LARGEST = 20_000
"""Bytes of a message drawn; larger ones are among those of interest, a few a round."""
VEHICLES = ("v1", "v2", "v3")


def way_into(convoy: Process) -> ZenohOptions:
    """Return how to join a run: where its router listens, and its name."""
    convoy.await_start()
    of_it = next(one for one in open_runs() if Path(one.folder).parent == convoy.printed.parent)
    return ZenohOptions(connect=(of_it.endpoint,), run=of_it.run)


def examples(run: Run) -> dict[str, dict[Topic, Message]]:
    """Return of each vehicle a message of each topic, from the middle of a run."""
    middle = run.start_at + 2_000_000_000
    found: dict[str, dict[Topic, Message]] = {}
    for message in run.messages:
        topic = TOPIC_OF[type(message)]
        of_vehicle = found.setdefault(message.vehicle, {})
        if topic not in of_vehicle or valid_at(message) <= middle:
            of_vehicle[topic] = message
    return found


def now(message: Message) -> Message:
    """Return a message that is valid at this moment, and of a number that is still to come."""
    instants = dict.fromkeys([TOPIC_OF[type(message)].instant], time.time_ns())
    if isinstance(message, GpsPose):
        instants["measured_at_ns"] = instants["sent_at_ns"]
    return replace(message, seq=message.seq + 100, **instants)  # type: ignore[arg-type]


def spoilt(data: bytes) -> Iterator[bytes]:
    """Give bytes that are no message at all, or no longer."""
    yield b""
    yield b"hello convoy"
    yield b"\xff\x00\xfe" * 40
    yield random.Random(len(data)).randbytes(150)
    yield data[: len(data) // 2]
    yield data[:-1]
    yield data + b"\xff"
    yield data * (20_000 // len(data))
    yield bytes(40_000)


def misplaced(message: Message, others: dict[Topic, Message]) -> Iterator[Put]:
    """Give whole messages of vehicle and time that have no business under a key of the convoy."""
    topic, vehicle = TOPIC_OF[type(message)], message.vehicle
    here = key(vehicle, topic)
    yield here, encode(replace(now(message), vehicle="ghost"))
    yield here, encode(replace(now(message), vehicle="v1" if vehicle != "v1" else "v3"))
    yield here, encode(message)  # of the run from which the example is, long ago
    yield here, encode(replace(message, seq=message.seq + 150))
    for other in others.values():
        if type(other) is not type(message):
            yield here, encode(now(other))
    data = encode(now(message))
    yield key("ghost", topic), data
    yield key(vehicle, topic) + "/deeper", data
    yield f"convoy/{vehicle}/nothing", data
    yield "convoy", data


def absurd(pose: GpsPose) -> Iterator[Put]:
    """Give poses of a listened-to vehicle that nobody can have measured."""
    here = key(pose.vehicle, TOPICS["gps"])
    for fields in (
        {"latitude_deg": float("nan")},
        {"latitude_deg": 91.0},
        {"speed_mps": float("inf")},
        {"heading_deg": -1e9},
        {"measured_at_ns": -(2**63)},
        {"measured_at_ns": 2**63 - 1},
        {"seq": 2**64 - 1},
    ):
        yield here, encode(replace(pose, **fields))
    yield here, encode(replace(now(pose), seq=2**63))


def conducting(others: dict[Topic, Message]) -> Iterator[Put]:
    """Give what might be taken for the start or the end of a run."""
    at = time.time_ns()
    text = LogText(vehicle="v1", seq=0, logged_at_ns=at, level="fatal", text="stop")
    impostors: list[Message] = [
        RunStart(vehicle="v1", seq=0, start_at_ns=0, run_id="x"),
        RunEnd(vehicle="v1", seq=0, end_at_ns=at, reason="enough"),
        RunEnd(vehicle="ghost", seq=0, end_at_ns=at, reason="enough"),
        text,
        replace(text, vehicle=RUN_SENDER),
        *others.values(),
    ]
    for name in ("start", "end"):
        here = key(RUN_SENDER, TOPICS[name])
        for data in spoilt(encode(impostors[0])):
            yield here, data
        for impostor in impostors:
            yield here, encode(impostor)


def one_round(known: dict[str, dict[Topic, Message]]) -> Iterator[Put]:
    """Give everything once."""
    for vehicle in VEHICLES:
        for topic, message in known[vehicle].items():
            for data in spoilt(encode(message)):
                yield key(vehicle, topic), data
            yield from misplaced(message, known[vehicle])
        yield from batched(known[vehicle])
    yield from conducting(known["v2"])
    yield key("v1", TOPICS["gps"]), bytes(1_000_000)


def batched(known: dict[Topic, Message]) -> Iterator[Put]:
    """Give batches that are none, and batches with records that are none."""
    vehicle, at = known[TOPICS["truth"]].vehicle, time.time_ns()
    truth = encode(known[TOPICS["truth"]])
    foreign = encode(replace(now(known[TOPICS["truth"]]), vehicle="ghost"))
    records = [BatchRecord("truth", at, data) for data in (*spoilt(truth), foreign)]
    records += [
        BatchRecord(topic, at, truth) for topic in ("gps", "start", "nothing", "", "tracking")
    ]
    records += [BatchRecord("truth", instant, truth) for instant in (-(2**63), 0, 2**63 - 1)]
    for batch in packed(records):
        yield records_key(vehicle), batch
        yield records_key(vehicle), batch[:-1]
    yield records_key(vehicle), truth
    yield records_key("ghost"), truth
    yield records_key(vehicle), bytes(70_000)


def one_by_one(heard: Sequence[Put]) -> Iterator[Put]:
    """Give what was heard with each message by itself."""
    for where, data in heard:
        first, _, topic = where.rpartition("/")
        if topic == "records":
            with suppress(RefusedMessageError):  # one of ours
                yield from ((f"{first}/{one.topic}", one.data) for one in unpacked(data))
        else:
            yield where, data


def drawn(stranger: Stranger, heard: Sequence[Put]) -> Iterator[Put]:
    """Give what a stranger draws from what it heard."""
    honest = [put for put in one_by_one(heard) if RUN_SENDER not in put[0].split("/")]
    for _ in range(DRAWN if honest else 0):
        where, data = stranger.refusable(honest)
        # Zenoh itself refuses such a key, and of a flood drops what is honest, too.
        if not where.endswith("/") and len(data) < LARGEST:
            yield where, data


def attack(
    convoy: Process, bus: Bus, known: dict[str, dict[Topic, Message]], seconds: float
) -> int:
    """Disturb a run before and after its start; returns how many messages were put after it."""
    heard: list[Put] = []
    bus.subscribe("convoy/*/*", lambda *put: heard.append(put))
    mine = set(one_round(known))
    for put in mine:
        bus.publish(*put)
    convoy.await_start()
    time.sleep(0.7)
    stranger = Stranger(random.Random(1), VEHICLES, time.time_ns())
    pose = known["v1"][TOPICS["gps"]]
    assert isinstance(pose, GpsPose)
    count = 0
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        assert convoy.exit_code is None, convoy.err
        theirs = [put for put in heard[-300:] if put not in mine]
        for put in (*one_round(known), *absurd(pose), *repeated(theirs), *drawn(stranger, theirs)):
            bus.publish(*put)
            mine.add(put)
            count += 1
            if count % BURST == 0:
                time.sleep(BREATH_S)
        time.sleep(BREATH_S)
    return count


def repeated(heard: list[Put]) -> Iterator[Put]:
    """Give again what was heard of the vehicles, and the start as if it were the end."""
    start_key, end_key = (key(RUN_SENDER, TOPICS[name]) for name in ("start", "end"))
    for where, data in heard:
        yield (end_key if where == start_key else where), data


@pytest.mark.campaign(1, 30)
def test_a_stranger_on_the_bus_changes_nothing_but_counters(tmp_path: Path, campaign: int) -> None:
    """Disturbed for a second, or thirty."""
    duration_s = campaign + AROUND_S
    scenario = ("run", "lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={duration_s}")
    twin = run_to_the_end(*scenario, "--clock=virtual", "--out=virtual", folder=tmp_path)
    assert twin.exit_code == 0, twin.err
    virtual = Run(tmp_path / "virtual")
    with start(*scenario, "--out", tmp_path / "run", folder=tmp_path) as convoy:
        with open_bus(way_into(convoy)) as bus:
            sent = attack(convoy, bus, examples(virtual), campaign)
        assert convoy.wait() == 0, convoy.err
        assert "Traceback" not in convoy.err
    run = Run(tmp_path / "run")
    assert_sound(run.log)
    assert_summary_is_in_the_log(run)
    assert_equal_while_nothing_was_late(run, virtual, within_m=0.05)
    missing = 3 * duration_s * 50 - agreement(run, virtual).compared
    if not run.summary["holes"]:
        assert_nothing_missing(run, duration_s)
        assert missing == 0
    assert missing < LOST_RATIO * 3 * duration_s * 50
    assert_same_kinds_of_text(run, virtual)
    assert_counted(run, sent)


def assert_same_kinds_of_text(run: Run, virtual: Run) -> None:
    """Vehicles decided as always: nothing that came made one steer along something else."""
    for name in VEHICLES:
        modes = [
            [m.mode for m in one.messages if isinstance(m, Tracking) and m.vehicle == name]
            for one in (run, virtual)
        ]
        if not run.late_messages_at:
            assert modes[0] == modes[1]
    assert {m.vehicle for m in run.messages} == {"v1", "v2", "v3", RUN_SENDER}
    assert len([m for m in run.messages if isinstance(m, RunStart | RunEnd)]) == 2


def assert_counted(run: Run, sent: int) -> None:
    """Each is counted by the recorder, and those on poses' keys by whoever listens to them."""
    refused = run.summary["recorder_rejected_messages"]
    assert set(refused) == {
        *("garbage", "oversized", "unknown", "foreign", "reserved", "duplicate"),
        *("early", "future", "sequence", "absurd"),
    }
    # A busy machine puts less in the same time, and does not pass all of a flood on.
    assert sum(refused.values()) > 0.5 * sent
    assert run.vehicle("v1")["rejected_messages"] == 0
    for name in ("v2", "v3"):
        assert run.vehicle(name)["rejected_messages"] > 0.02 * sent  # one in 25 without load
        reasons = {text.rpartition(" ")[2] for text in run.texts(name) if "refused" in text}
        assert reasons >= {
            "garbage",
            "oversized",
            "foreign",
            "absurd",
            "early",
            "duplicate",
            "sequence",
        }
