"""Another Zenoh client publishes invalid messages under a convoy's keys."""

import random
import time
from collections.abc import Iterator
from contextlib import suppress
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
from tests.system.processes import Process, invoke, start, until
from transport.bus.bus import Bus
from transport.bus.telemetry import BatchRecord, packed, records_key, unpacked
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.codec import RefusedMessageError, decode, encode
from transport.topics import RUN_SENDER, TOPICS, key
from vehicles.messages import LogText, Message, RunEnd, RunStart, Tracking

BURST_MESSAGES, PAUSE_S = 20, 0.01
"""Messages published at once, and the pause after them: a router whose queue is full drops valid
messages, too."""
LOST_RATIO = 0.05
"""Largest share of messages missing in the log of a busy machine; the summary lists them."""
MARGIN_S = 2.0
"""Difference of the duration of the run and the attack."""
LARGEST_BYTES = 20_000
"""Largest message in a flood."""
KEPT = 300
"""Received messages of which hostile ones are made."""
VEHICLES = ("v1", "v2", "v3")


def run_options(convoy: Process) -> ZenohOptions:
    """Options to join a run: endpoint of its router, and its name."""
    convoy.await_start()
    entry = next(run for run in open_runs() if Path(run.folder).parent == convoy.stdout_file.parent)
    return ZenohOptions(connect=(entry.endpoint,), run=entry.run)


def unbatched(where: str, data: bytes) -> Iterator[Put]:
    """Yield a received message, or the records of a batch."""
    first, _, topic = where.rpartition("/")
    if topic != "records":
        yield where, data
        return
    with suppress(RefusedMessageError):  # one of the attacks
        yield from ((f"{first}/{record.topic}", record.data) for record in unpacked(data))


def batches(vehicle: str, data: bytes) -> Iterator[Put]:
    """Yield damaged batches of a vehicle, and batches with damaged records."""
    at = time.time_ns()
    contents = (b"", b"\xff\x00\xfe" * 40, data[: len(data) // 2], data + b"\xff")
    records = [BatchRecord("truth", at, content) for content in contents]
    records += [BatchRecord(topic, at, data) for topic in ("gps", "start", "nothing", "")]
    records += [BatchRecord("truth", instant, data) for instant in (-(2**63), 0, 2**63 - 1)]
    for batch in packed(records):
        yield records_key(vehicle), batch
        yield records_key(vehicle), batch[:-1]
    yield records_key("ghost"), data
    yield records_key(vehicle), bytes(70_000)


def false_starts_and_ends() -> Iterator[Put]:
    """Yield messages that imitate the start or the end of a run, or the words of its recorder."""
    at = time.time_ns()
    impostors: list[Message] = [
        RunStart(vehicle="v1", seq=0, start_at_ns=0, run_id="x"),
        RunEnd(vehicle="ghost", seq=0, end_at_ns=at, reason="enough"),
        RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=at, reason=""),
        RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=at, reason="", run_id="guessed"),
        RunStart(vehicle=RUN_SENDER, seq=0, start_at_ns=at, run_id="guessed"),
        LogText(vehicle=RUN_SENDER, seq=0, logged_at_ns=at, level="fatal", text="stop"),
    ]
    for name in ("start", "end"):
        yield from ((key(RUN_SENDER, TOPICS[name]), encode(one)) for one in impostors)


def attack(convoy: Process, bus: Bus, seconds: float) -> int:
    """Attack a running convoy with variations of what it sends; return the number of messages."""
    received: list[Put] = []
    giant = key("v1", TOPICS["gps"]), bytes(1_000_000)
    own = {giant}

    def take(where: str, data: bytes) -> None:
        if (where, data) not in own:
            received.extend(unbatched(where, data))
            del received[:-KEPT]

    bus.subscribe("convoy/*/*", take)
    convoy.await_start()
    start_key = key(RUN_SENDER, TOPICS["start"])
    assert until(lambda: any(where == start_key for where, _ in received))
    start = decode(TOPICS["start"], next(data for where, data in received if where == start_key))
    assert isinstance(start, RunStart)
    stranger = Stranger(random.Random(1), VEHICLES, start.start_at_ns)
    time.sleep(0.7)
    count, until_s = 0, time.monotonic() + seconds
    while time.monotonic() < until_s:
        assert convoy.exit_code is None, convoy.err
        honest = [put for put in received if RUN_SENDER not in put[0].split("/")]
        hostile = [stranger.refusable(honest) for _ in range(BURST_MESSAGES)]
        _, data = random.Random(count).choice(honest)
        for put in (*hostile, *batches("v2", data), *false_starts_and_ends()):
            # Zenoh refuses such a key, and drops valid messages in a flood.
            if not put[0].endswith("/") and len(put[1]) < LARGEST_BYTES:
                own.add(put)
                bus.publish(*put)
                count += 1
        bus.publish(*giant)
        time.sleep(PAUSE_S)
    return count


@pytest.mark.campaign(1, 30)
def test_hostile_messages_change_only_counters(tmp_path: Path, campaign: int) -> None:
    duration_s = campaign + MARGIN_S
    scenario = ("run", "lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={duration_s}")
    done = invoke(*scenario, "--clock=virtual", "--quiet", "--out=virtual", folder=tmp_path)
    assert done.exit_code == 0, done.output
    virtual = Run(tmp_path / "virtual")
    with start(*scenario, "--out", tmp_path / "run", folder=tmp_path) as convoy:
        with open_bus(run_options(convoy)) as bus:
            sent = attack(convoy, bus, campaign)
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
    assert set(refused) >= {
        *("garbage", "oversized", "unknown", "foreign", "reserved", "duplicate", "early"),
    }
    # A busy machine sends less, and its router drops part of a flood.
    assert sum(refused.values()) > 0.5 * sent
    reasons = set[str]()
    for name in VEHICLES:
        assert run.vehicle(name)["rejected_messages"] > 0.01 * sent
        reasons |= {text.rpartition(" ")[2] for text in run.texts(name) if "refused" in text}
    assert reasons >= {"garbage", "foreign", "duplicate"}
