"""Copied, corrupted and false messages in a receiver, for any behaviour of the bus."""

from collections import Counter
from collections.abc import Iterable
from math import sqrt
from random import Random
from typing import Any
from zlib import crc32

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scenarios.definition.schema.link_tables import LinkTable
from tests.made.examples import examples
from tests.made.scenarios.messages import MS, START, gps
from tests.made.transport.links import inbox as inbox_of
from tests.made.transport.links import taken
from transport.codec import encode
from transport.links.content_stage import ContentStage, Transmission
from transport.links.inbox import Inbox
from transport.links.laws.content import BitErrors
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import Link, Verdict
from transport.topics import TOPICS, key
from vehicles.geometry.geodesy import Origin
from vehicles.messages import GpsPose, LinkVerdict

ORIGIN = Origin(30.638, -96.481, 80.0)
TICK = 20 * MS
SIZE = len(encode(gps("v1", 100)))
FALSE: list[dict[str, Any]] = [
    {"kind": "frozen", "from_s": 1.0, "to_s": 2.0},
    {"kind": "replayed", "age_s": 0.7, "from_s": 2.5, "to_s": 3.5},
    {"kind": "drift", "left_mps": 1.0, "from_s": 3.0, "to_s": 4.5},
    {"kind": "offset", "east_m": 2.0, "from_s": 4.0},
    {"kind": "ghost", "ahead_m": -4.0, "from_s": 0.5, "to_s": 4.0},
]
EVERYTHING = {"duplicate_ratio": 0.3, "reorder_ratio": 0.2, "bit_error_ratio": 3e-4, "false": FALSE}


def requested(content: dict[str, Any], **plain: float) -> LinkTable:
    return LinkTable.model_validate({"latency_ms": 20.0, **plain, "content": content})


def sent(count: int) -> list[GpsPose]:
    """Poses of a car that drives north at 20 m/s, one per metre."""
    return [
        gps("v1", k, latitude_deg=30.638 + k * 9.02e-6, heading_deg=0.0, altitude_m=80.0)
        for k in range(count)
    ]


def make_inbox(
    content: dict[str, Any], seed: int = 1, start_at: int = START, **plain: float
) -> Inbox:
    return inbox_of(
        "v2", {"v1": requested(content, **plain)}, start_at=start_at, seed=seed, origin=ORIGIN
    )


def run(
    inbox: Inbox, arrivals: Iterable[tuple[int, GpsPose]], ticks: int = 500, start_at: int = START
) -> tuple[list[tuple[int, GpsPose]], list[LinkVerdict]]:
    """Feed an inbox with poses; returns deliveries with their instants, and the verdicts."""
    pending = sorted(arrivals, key=lambda row: row[0])
    received: list[tuple[int, GpsPose]] = []
    verdicts: list[LinkVerdict] = []
    for now in range(start_at, start_at + ticks * TICK, TICK):
        while pending and pending[0][0] <= now:
            message = pending.pop(0)[1]
            inbox.on_bytes(key(message.vehicle, TOPICS["gps"]), encode(message))
        received += [(now, pose) for pose in taken(inbox, now)]
        verdicts += inbox.verdicts()
    return received, verdicts


def at_once(poses: Iterable[GpsPose]) -> list[tuple[int, GpsPose]]:
    return [(pose.sent_at_ns, pose) for pose in poses]


# ---- Independence of the bus


@settings(max_examples=12)
@given(random=st.randoms(use_true_random=False), seed=st.integers(0, 1000))
@example(random=Random(1), seed=13)  # a bit error shifts the instant of sending
@example(random=Random(1), seed=186)
@example(random=Random(1), seed=207)
@pytest.mark.parametrize("frame_check", [True, False])
def test_another_order_and_time_of_arrival_changes_nothing(
    frame_check: bool, random: Random, seed: int
) -> None:
    content = {**EVERYTHING, "frame_check": frame_check, "filter_duplicates": False}
    poses = sent(100)
    first, second = (make_inbox(content, seed, jitter_ms=80.0, loss_ratio=0.1) for _ in range(2))
    plain = run(first, at_once(poses))
    random.shuffle(poses)
    delayed = run(second, [(p.sent_at_ns + random.randrange(20 * MS), p) for p in poses])
    assert delayed == plain
    assert first.rejected == second.rejected
    assert {"frozen+ghost", "replayed+drift+ghost", "drift+offset"} <= {
        verdict.content.removeprefix("corrupted+") for verdict in plain[1]
    }


# ---- Copies and messages held back


@pytest.mark.campaign(2000, 100_000)
def test_copies_are_counted_and_refused_by_their_number(campaign: int) -> None:
    inbox = make_inbox({"duplicate_ratio": 0.3, "duplicate_delay_ms": 30.0}, loss_ratio=0.2)
    poses = [gps("v1", k) for k in range(campaign)]
    received, verdicts = run(inbox, at_once(poses), 5 * campaign // 2 + 10)
    copies = sum(v.copies for v in verdicts)
    delivered = [v for v in verdicts if v.outcome == "delivered"]
    assert abs(copies - 0.3 * len(delivered)) < 4.0 * sqrt(0.21 * len(delivered))
    assert not any(v.copies for v in verdicts if v.outcome == "dropped")
    assert inbox.rejected == {"duplicate": copies}
    # Each message is delivered or dropped once, with or without copies.
    link = inbox.links["v1"]
    assert len(verdicts) == campaign == link.delivered + link.dropped.total()
    assert [p.seq for _, p in received] == [v.pose_seq for v in delivered]
    assert inbox.delivered == len(received)


# ---- Bit errors


def test_with_frame_check_no_corrupted_frame_is_received() -> None:
    poses = sent(2000)
    inbox = make_inbox({"bit_error_ratio": 3e-4})
    received, verdicts = run(inbox, at_once(poses), 5100)
    assert all(pose == poses[pose.seq] for _, pose in received)
    hit = 1.0 - (1.0 - 3e-4) ** (8 * SIZE)
    dropped = Counter((v.reason, v.content) for v in verdicts if v.outcome == "dropped")
    assert set(dropped) == {("corrupted", "")}
    assert abs(dropped["corrupted", ""] - 2000 * hit) < 4.0 * sqrt(2000 * hit * (1 - hit))
    assert len(received) + dropped.total() == 2000
    assert inbox.rejected == {}


def test_without_frame_check_the_gate_decides_and_its_reason_is_reported() -> None:
    poses = sent(2000)
    inbox = make_inbox({"bit_error_ratio": 1e-3, "frame_check": False})
    received, verdicts = run(inbox, at_once(poses), 5100)
    found = Counter((v.outcome, v.reason, v.content) for v in verdicts)
    assert found.total() == 2000
    refused = {content for outcome, _, content in found if outcome == "dropped"}
    assert {"garbage", "absurd", "foreign", "far", "future"} <= refused
    assert {reason for outcome, reason, _ in found if outcome == "dropped"} == {"corrupted"}
    taken = {v.pose_seq for v in verdicts if v.content == "corrupted"}
    assert len(taken) > 100
    results = dict(
        zip((v.pose_seq for v in verdicts if v.outcome == "delivered"), received, strict=True)
    )
    changed = {seq for seq, (_, pose) in results.items() if pose != poses[seq]}
    assert changed <= taken
    assert len(taken - changed) < 0.05 * len(taken)  # the sign of zero, which compares equal
    # With a frame check the same frames are refused.
    _, checked = run(make_inbox({"bit_error_ratio": 1e-3}), at_once(poses), 5100)
    assert {v.pose_seq for v in checked if v.outcome == "dropped"} == taken | {
        v.pose_seq for v in verdicts if v.outcome == "dropped"
    }


@examples(33, 300)
@given(
    drawn=st.lists(st.floats(0.0, 1.0, exclude_max=True), min_size=1, max_size=12),
    ratio=st.sampled_from([1e-3, 1e-2, 0.1]),
    false=st.lists(st.sampled_from(FALSE), max_size=3),
)
def test_no_flipped_bits_do_harm(
    drawn: list[float], ratio: float, false: list[dict[str, Any]]
) -> None:
    """With any flipped bits, a frame is refused with a reason or passes the gate."""

    def draw(purpose: str, seq: int) -> float:
        if purpose == "bits":
            return min(drawn[0], 0.5)  # so that it has errors
        return (
            drawn[crc32(f"{purpose} {seq}".encode()) % len(drawn)]
            if purpose.startswith("bit ")
            else 0.0
        )

    inbox = make_inbox({"false": false} if false else {"duplicate_ratio": 1.0})
    stage = inbox.links["v1"].content
    assert stage is not None
    link = Link(stage.link.effects, 1, "v1", "v2")
    object.__setattr__(link, "draw", draw)
    hit = ContentStage(
        link=link,
        gate=stage.gate,
        bit_errors=BitErrors(ratio, frame_check=False),
        false=stage.false,
    )
    message = sent(90)[-1]
    hit.history.add(message)
    judged = Verdict("delivered", "", message.sent_at_ns + 20 * MS)
    pose = stage.gate.check(message, message.sent_at_ns)
    arrival = Transmission(
        pose, TransmissionContext(message.seq, message.sent_at_ns, SIZE), judged, False, pose
    )
    further = hit.apply(arrival)
    if arrival.verdict.outcome == "delivered":
        stage.gate.check(arrival.pose.message, message.sent_at_ns)
        assert "corrupted" in arrival.content
    else:
        assert arrival.verdict == Verdict("dropped", "corrupted", judged.visible_at)
        assert arrival.content
        assert not further


# ---- False content
