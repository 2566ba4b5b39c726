"""Another Zenoh client publishes invalid messages under a convoy's keys."""

import random
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.runs.open_runs import open_runs
from tests.made.scenarios.hostile_messages import Put, Stranger
from tests.system.logs import (
    Run,
    agreement,
    assert_equal_while_nothing_was_late,
    assert_nothing_missing,
    assert_sound,
    assert_summary_is_in_the_log,
)
from tests.system.processes import Process, invoke, start
from transport.bus.bus import Bus
from transport.bus.telemetry import BatchRecord, packed, records_key, unpacked
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.codec import RefusedMessageError, decode, encode
from transport.topics import RUN_SENDER, TOPIC_OF, TOPICS, Topic, key, valid_at
from vehicles.messages import GpsPose, LogText, Message, RunEnd, RunStart, Tracking

BURST_MESSAGES, PAUSE_S = 20, 0.01
"""Messages published at once, and the pause after them: a router whose queue is full drops valid
messages, too."""
LOST_RATIO = 0.05
"""Largest share of messages missing in the log of a busy machine; the summary lists them."""
MARGIN_S = 2.0
"""Difference of the duration of the run and the attack."""
RANDOM_MESSAGES = 100
"""Random messages in each round, in addition to the listed attacks."""
LARGEST_BYTES = 20_000
"""Largest random message; larger ones are among the listed attacks."""
VEHICLES = ("v1", "v2", "v3")


def run_options(convoy: Process) -> ZenohOptions:
    """Options to join a run: endpoint of its router, and its name."""
    convoy.await_start()
    entry = next(run for run in open_runs() if Path(run.folder).parent == convoy.stdout_file.parent)
    return ZenohOptions(connect=(entry.endpoint,), run=entry.run)


def examples(run: Run) -> dict[str, dict[Topic, Message]]:
    """One message of each topic of each vehicle, from the middle of a run."""
    middle = run.start_at + 2_000_000_000
    examples_by_vehicle: dict[str, dict[Topic, Message]] = {}
    for message in run.messages:
        topic = TOPIC_OF[type(message)]
        of_vehicle = examples_by_vehicle.setdefault(message.vehicle, {})
        if topic not in of_vehicle or valid_at(message) <= middle:
            of_vehicle[topic] = message
    return examples_by_vehicle


def as_current(message: Message) -> Message:
    """The message with current instants and a future number."""
    instants = dict.fromkeys([TOPIC_OF[type(message)].instant], time.time_ns())
    if isinstance(message, GpsPose):
        instants["measured_at_ns"] = instants["sent_at_ns"]
    return replace(message, seq=message.seq + 100, **instants)  # type: ignore[arg-type]


def corrupted(data: bytes) -> Iterator[bytes]:
    """Yield random bytes and damaged copies of a message."""
    yield b""
    yield b"hello convoy"
    yield b"\xff\x00\xfe" * 40
    yield random.Random(len(data)).randbytes(150)
    yield data[: len(data) // 2]
    yield data[:-1]
    yield data + b"\xff"
    yield data * (20_000 // len(data))
    yield bytes(40_000)


def misplaced_messages(message: Message, others: dict[Topic, Message]) -> Iterator[Put]:
    """Yield valid messages of a wrong vehicle, time or topic."""
    topic, vehicle = TOPIC_OF[type(message)], message.vehicle
    here = key(vehicle, topic)
    yield here, encode(replace(as_current(message), vehicle="ghost"))
    yield here, encode(replace(as_current(message), vehicle="v1" if vehicle != "v1" else "v3"))
    yield here, encode(message)  # of an earlier run
    yield here, encode(replace(message, seq=message.seq + 150))
    for other in others.values():
        if type(other) is not type(message):
            yield here, encode(as_current(other))
    data = encode(as_current(message))
    yield key("ghost", topic), data
    yield key(vehicle, topic) + "/deeper", data
    yield f"convoy/{vehicle}/nothing", data
    yield "convoy", data


def impossible_poses(pose: GpsPose) -> Iterator[Put]:
    """Yield poses that no receiver can have measured."""
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
    yield here, encode(replace(as_current(pose), seq=2**40))


def false_starts_and_ends(others: dict[Topic, Message]) -> Iterator[Put]:
    """Yield messages that imitate the start or the end of a run."""
    at = time.time_ns()
    text = LogText(vehicle="v1", seq=0, logged_at_ns=at, level="fatal", text="stop")
    impostors: list[Message] = [
        RunStart(vehicle="v1", seq=0, start_at_ns=0, run_id="x"),
        RunEnd(vehicle="v1", seq=0, end_at_ns=at, reason="enough"),
        RunEnd(vehicle="ghost", seq=0, end_at_ns=at, reason="enough"),
        RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=at, reason=""),
        RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=at, reason="", run_id="guessed"),
        RunStart(vehicle=RUN_SENDER, seq=0, start_at_ns=at, run_id="guessed"),
        text,
        replace(text, vehicle=RUN_SENDER),
        *others.values(),
    ]
    for name in ("start", "end"):
        here = key(RUN_SENDER, TOPICS[name])
        for data in corrupted(encode(impostors[0])):
            yield here, data
        for impostor in impostors:
            yield here, encode(impostor)


def all_attacks(samples: dict[str, dict[Topic, Message]]) -> Iterator[Put]:
    """Yield each listed attack once."""
    for vehicle in VEHICLES:
        for topic, message in samples[vehicle].items():
            for data in corrupted(encode(message)):
                yield key(vehicle, topic), data
            yield from misplaced_messages(message, samples[vehicle])
        yield from corrupted_batches(samples[vehicle])
    yield from false_starts_and_ends(samples["v2"])
    yield key("v1", TOPICS["gps"]), bytes(1_000_000)


def corrupted_batches(samples: dict[Topic, Message]) -> Iterator[Put]:
    """Yield damaged batches, and batches with damaged records."""
    vehicle, at = samples[TOPICS["truth"]].vehicle, time.time_ns()
    truth = encode(samples[TOPICS["truth"]])
    foreign = encode(replace(as_current(samples[TOPICS["truth"]]), vehicle="ghost"))
    records = [BatchRecord("truth", at, data) for data in (*corrupted(truth), foreign)]
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


def unbatched(received: Sequence[Put]) -> Iterator[Put]:
    """Yield received messages, with batches split into their records."""
    for where, data in received:
        first, _, topic = where.rpartition("/")
        if topic == "records":
            with suppress(RefusedMessageError):  # one of the attacks
                yield from ((f"{first}/{record.topic}", record.data) for record in unpacked(data))
        else:
            yield where, data


def random_messages(stranger: Stranger, received: Sequence[Put]) -> Iterator[Put]:
    """Yield random variations of received messages."""
    honest = [put for put in unbatched(received) if RUN_SENDER not in put[0].split("/")]
    for _ in range(RANDOM_MESSAGES if honest else 0):
        where, data = stranger.refusable(honest)
        # Zenoh refuses such a key, and drops valid messages in a flood.
        if not where.endswith("/") and len(data) < LARGEST_BYTES:
            yield where, data


def attack(
    convoy: Process, bus: Bus, samples: dict[str, dict[Topic, Message]], seconds: float
) -> int:
    """Attack a run before and after its start; return the number of messages after it."""
    received: list[Put] = []
    bus.subscribe("convoy/*/*", lambda *put: received.append(put))
    attacks = set(all_attacks(samples))
    for put in attacks:
        bus.publish(*put)
    convoy.await_start()
    time.sleep(0.7)
    # Instants before the start are impossible; a busy machine reports the start seconds later.
    start_key = key(RUN_SENDER, TOPICS["start"])
    start = decode(
        TOPICS["start"],
        next(
            data for where, data in received if where == start_key and (where, data) not in attacks
        ),
    )
    assert isinstance(start, RunStart)
    stranger = Stranger(random.Random(1), VEHICLES, start.start_at_ns)
    pose = samples["v1"][TOPICS["gps"]]
    assert isinstance(pose, GpsPose)
    count = 0
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        assert convoy.exit_code is None, convoy.err
        honest = [put for put in received[-300:] if put not in attacks]
        for put in (
            *all_attacks(samples),
            *impossible_poses(pose),
            *replayed_messages(honest),
            *random_messages(stranger, honest),
        ):
            bus.publish(*put)
            attacks.add(put)
            count += 1
            if count % BURST_MESSAGES == 0:
                time.sleep(PAUSE_S)
        time.sleep(PAUSE_S)
    return count


def replayed_messages(received: list[Put]) -> Iterator[Put]:
    """Yield received messages again, and the start as the end."""
    start_key, end_key = (key(RUN_SENDER, TOPICS[name]) for name in ("start", "end"))
    for where, data in received:
        yield (end_key if where == start_key else where), data


@pytest.mark.campaign(1, 30)
def test_hostile_messages_change_only_counters(tmp_path: Path, campaign: int) -> None:
    duration_s = campaign + MARGIN_S
    scenario = ("run", "lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={duration_s}")
    done = invoke(*scenario, "--clock=virtual", "--quiet", "--out=virtual", folder=tmp_path)
    assert done.exit_code == 0, done.output
    virtual = Run(tmp_path / "virtual")
    with start(*scenario, "--out", tmp_path / "run", folder=tmp_path) as convoy:
        with open_bus(run_options(convoy)) as bus:
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
    assert_same_decisions(run, virtual)
    assert_refusals_counted(run, sent)


def assert_same_decisions(run: Run, virtual: Run) -> None:
    """Check that all vehicles decide as in virtual time."""
    for name in VEHICLES:
        modes = [
            [m.mode for m in source.messages if isinstance(m, Tracking) and m.vehicle == name]
            for source in (run, virtual)
        ]
        if not run.late_messages_at:
            assert modes[0] == modes[1]
    assert {m.vehicle for m in run.messages} == {"v1", "v2", "v3", RUN_SENDER}
    assert len([m for m in run.messages if isinstance(m, RunStart | RunEnd)]) == 2


def assert_refusals_counted(run: Run, sent: int) -> None:
    """Check that the recorder counts all attacks, and receivers those under the keys of poses."""
    refused = run.summary["recorder_rejected_messages"]
    assert set(refused) == {
        *("garbage", "oversized", "unknown", "foreign", "reserved", "duplicate"),
        *("early", "future", "sequence", "absurd"),
    }
    # A busy machine sends less, and its router drops part of a flood.
    assert sum(refused.values()) > 0.5 * sent
    for name in VEHICLES:
        assert run.vehicle(name)["rejected_messages"] > 0.02 * sent  # one in 25 without load
        reasons = {text.rpartition(" ")[2] for text in run.texts(name) if "refused" in text}
        poses = {"absurd", "sequence"} if name != "v1" else set()  # sent as poses of the lead
        assert reasons >= {"garbage", "oversized", "foreign", "early", "duplicate"} | poses
