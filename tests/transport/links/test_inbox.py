"""Messages received by a vehicle: by its links, for any behaviour of the bus."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.definition.schema.link_tables import LinkTable
from tests.made.message import pose as made_pose
from tests.made.transport.links import inbox as inbox_of
from tests.made.transport.links import link as link_of
from tests.made.transport.links import taken
from transport.clock import ticks
from transport.codec import encode
from transport.links.inbox import QUEUE, Inbox
from transport.links.laws.link_law import UNKNOWN_POSITION, TransmissionContext
from transport.links.link import LONGEST_POSE_BYTES
from transport.topics import TOPICS, key
from vehicles.messages import GpsPose, LinkVerdict, LogText
from vehicles.schedule import SECOND, instant

START = 1_790_000_000 * SECOND
MS = 1_000_000
RATE_HZ = 20.0
GPS = TOPICS["gps"]


def pose(seq: int, vehicle: str = "lead") -> GpsPose:
    place = {"latitude_deg": 37.72 + seq * 1e-6, "longitude_deg": -122.47, "altitude_m": 30.0}
    motion = {"heading_deg": 90.0, "speed_mps": 30.0, "yaw_rate_radps": 0.01}
    return made_pose(vehicle, seq, instant(START, seq, RATE_HZ), **place, **motion)


def sent(message: GpsPose, at: int) -> GpsPose:
    return replace(message, measured_at_ns=at, sent_at_ns=at)


def make_inbox(links: Mapping[str, LinkTable] | None = None, seed: int = 1) -> Inbox:
    if links is None:
        links = {"lead": LinkTable(latency_ms=20.0)}
    return inbox_of("follower_2", links, seed=seed, start_at=START, rate_hz=RATE_HZ)


def send(inbox: Inbox, *poses: GpsPose) -> None:
    for message in poses:
        inbox.on_bytes(key(message.vehicle, GPS), encode(message))


def test_a_message_is_received_at_the_first_tick_from_its_visible_instant() -> None:
    inbox = make_inbox()
    send(inbox, pose(0))
    assert taken(inbox, START) == []
    assert taken(inbox, START + 19_999_999) == []
    assert taken(inbox, START + 20_000_000) == [pose(0)]
    assert taken(inbox, START + 40 * MS) == []
    assert (inbox.delivered, inbox.dropped, inbox.late) == (1, 0, 0)


def test_an_early_arrival_waits_and_a_late_one_is_received_at_once() -> None:
    inbox = make_inbox()
    send(inbox, pose(1))
    assert taken(inbox, START + 60 * MS) == []
    send(inbox, pose(0))
    assert taken(inbox, START + 62 * MS) == [pose(0)]
    assert taken(inbox, START + 80 * MS) == [pose(1)]
    assert inbox.late == 1
    assert [(v.pose_seq, v.late, v.received_at_ns) for v in inbox.verdicts()] == [
        (0, True, START + 62 * MS),
        (1, False, START + 80 * MS),
    ]


def test_messages_come_in_the_order_of_visibility_then_sender_then_number() -> None:
    same = LinkTable(latency_ms=20.0)
    inbox = make_inbox({"lead": same, "follower_1": same})
    send(inbox, pose(1), pose(1, "follower_1"), pose(0), pose(0, "follower_1"))
    assert taken(inbox, START + 100 * MS) == [
        pose(0, "follower_1"),
        pose(0),
        pose(1, "follower_1"),
        pose(1),
    ]


def test_each_message_has_a_verdict() -> None:
    rule = LinkTable(latency_ms=20.0, loss_ratio=0.5)
    inbox = make_inbox({"lead": rule})
    received, verdicts = [], []
    for tick in ticks(START, START + SECOND, 50.0, RATE_HZ):
        send(inbox, *(pose(k) for k in range(20) if pose(k).measured_at_ns == tick.at))
        received += taken(inbox, tick.at)
        verdicts += inbox.verdicts()
    assert [v.seq for v in verdicts] == list(range(20))
    assert [v.pose_seq for v in verdicts if v.outcome == "delivered"] == [p.seq for p in received]
    assert 0 < len(received) < 20
    link = link_of(rule, "lead", "follower_2", rate_hz=RATE_HZ)
    for v in verdicts:
        judged = link.judge(TransmissionContext(v.pose_seq, v.sent_at_ns))
        assert (v.outcome, v.reason, v.visible_at_ns) == (
            judged.outcome,
            judged.reason,
            judged.visible_at,
        )
        assert (v.vehicle, v.sender, v.late) == ("follower_2", "lead", False)
        # The verdict is published at the tick that delivers the message, or would have.
        assert v.visible_at_ns <= v.received_at_ns < v.visible_at_ns + 20 * MS
    assert inbox.links["lead"].delivered == len(received)
    assert inbox.links["lead"].dropped == {"loss": 20 - len(received)}


RULES = {
    "lead": LinkTable(latency_ms=30.0, jitter_ms=60.0, loss_ratio=0.3),
    "follower_1": LinkTable(latency_ms=20.0, rate_hz=10.0),
}


def run(
    arrivals: Iterable[tuple[int, GpsPose]], seed: int
) -> tuple[list[GpsPose], list[LinkVerdict]]:
    """Run an inbox for two seconds; a pose arrives before the first tick from its instant."""
    inbox = make_inbox(RULES, seed)
    pending = sorted(arrivals, key=lambda row: row[0])
    received: list[GpsPose] = []
    verdicts: list[LinkVerdict] = []
    for tick in ticks(START, START + 2 * SECOND, 50.0, RATE_HZ):
        while pending and pending[0][0] <= tick.at:
            send(inbox, pending.pop(0)[1])
        received += taken(inbox, tick.at)
        verdicts += inbox.verdicts()
    assert not inbox.rejected
    return received, verdicts


@settings(max_examples=20)
@given(random=st.randoms(use_true_random=False), seed=st.integers(0, 1000))
def test_the_time_of_arrival_changes_nothing_while_it_is_in_time(random: Random, seed: int) -> None:
    # Immediate delivery, as on the memory bus, equals any order and any delay below the minimum
    # latency, as on a network.
    poses = [pose(k, sender) for sender in RULES for k in range(39)]
    at_once = run([(m.measured_at_ns, m) for m in poses], seed)
    random.shuffle(poses)
    delayed = run([(m.measured_at_ns + random.randrange(20 * MS), m) for m in poses], seed)
    assert delayed == at_once
    assert {v.outcome for v in at_once[1]} == {"delivered", "dropped"}


@given(order=st.permutations(range(12)))
def test_deliveries_do_not_depend_on_the_order_of_arrival(order: list[int]) -> None:
    inbox = make_inbox({"lead": LinkTable(loss_ratio=0.3)})
    send(inbox, *(pose(k) for k in order))
    assert [p.seq for p in taken(inbox, START + SECOND)] == [1, 3, 4, 6, 7, 11]


def test_a_repeated_message_is_received_once() -> None:
    inbox = make_inbox()
    send(inbox, pose(0), pose(0))
    assert taken(inbox, START + 100 * MS) == [pose(0)]
    send(inbox, pose(0))
    assert taken(inbox, START + 200 * MS) == []
    assert inbox.rejected == {"duplicate": 2}


def spoilt(**changes: object) -> bytes:
    return encode(replace(pose(2), **changes))  # type: ignore[arg-type]  # wrong on purpose


NAN, INFINITE = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "garbage"),
        (b"\xff\xfe\x00rubbish", "garbage"),
        (encode(pose(2))[:20], "garbage"),
        (encode(pose(2))[:-9], "garbage"),
        (b"x" * 1_000_000, "oversized"),
        (encode(pose(2)) + b"\x00", "garbage"),
        (
            encode(LogText(vehicle="lead", seq=1, logged_at_ns=START, level="info", text="hello")),
            "garbage",
        ),
        (spoilt(vehicle="follower_1"), "foreign"),
        (spoilt(vehicle=""), "garbage"),
        (spoilt(latitude_deg=NAN), "absurd"),
        (spoilt(latitude_deg=90.5), "absurd"),
        (spoilt(longitude_deg=-181.0), "absurd"),
        (spoilt(longitude_deg=INFINITE), "absurd"),
        (spoilt(altitude_m=-INFINITE), "absurd"),
        (spoilt(altitude_m=1e9), "absurd"),
        (spoilt(heading_deg=NAN), "absurd"),
        (spoilt(heading_deg=361.0), "absurd"),
        (spoilt(speed_mps=1e4), "absurd"),
        (spoilt(yaw_rate_radps=INFINITE), "absurd"),
        (spoilt(longitude_deg=180.5), "absurd"),
        (spoilt(heading_deg=-1.0), "absurd"),
        (spoilt(speed_mps=-0.5), "absurd"),
        (spoilt(speed_mps=151.0), "absurd"),
        (spoilt(yaw_rate_radps=-11.0), "absurd"),
        (spoilt(latitude_deg=-37.72), "far"),
        (spoilt(longitude_deg=122.47), "far"),
        (spoilt(measured_at_ns=START - 1), "early"),
        (spoilt(measured_at_ns=0), "early"),
        (spoilt(measured_at_ns=-(2**63)), "early"),
        (spoilt(measured_at_ns=2**63 - 1), "future"),
        (spoilt(seq=3), "sequence"),
        (encode(sent(pose(2), pose(2).measured_at_ns - MS)), "sequence"),
        (spoilt(seq=2**63 - 1), "sequence"),
        (spoilt(seq=2**64 - 1), "absurd"),
    ],
)
def test_impossible_messages_are_counted_and_refused(data: bytes, reason: str) -> None:
    inbox = make_inbox()
    send(inbox, pose(0))
    inbox.on_bytes("convoy/lead/gps", data)
    send(inbox, pose(1))
    assert taken(inbox, START + 100 * MS) == [pose(0), pose(1)]
    assert sum(inbox.rejected.values()) == 1
    assert set(inbox.rejected) == {reason}
    assert len(inbox.verdicts()) == 2


@given(st.binary(max_size=2 * LONGEST_POSE_BYTES))
def test_no_bytes_do_harm(data: bytes) -> None:
    inbox = make_inbox()
    inbox.on_bytes("convoy/lead/gps", data)
    send(inbox, pose(0))
    assert taken(inbox, START + 100 * MS) == [pose(0)]
    assert sum(inbox.rejected.values()) == 1


def test_a_vehicle_that_was_held_up_loses_nothing() -> None:
    # Stopped at the start; ten seconds later all messages are received at once.
    inbox = make_inbox()
    everything = [pose(k) for k in range(200)]
    send(inbox, *everything)
    received = []
    for tick in ticks(START, START + 11 * SECOND, 50.0):
        received += taken(inbox, tick.at)
    assert received == everything
    assert inbox.late == 0


def test_too_many_at_once_push_the_oldest_out() -> None:
    inbox = make_inbox()
    more = QUEUE + 3
    for _ in range(3):
        inbox.on_bytes("convoy/lead/gps", b"flood")
    send(inbox, *(pose(k) for k in range(QUEUE)))
    received = taken(inbox, START + 60 * SECOND - 1)
    assert inbox.rejected["overflow"] == more - QUEUE
    assert inbox.rejected["garbage"] == 0
    assert ("overflow", 3) in inbox.rejections()
    assert received[0] == pose(0)


# ---- Interruptions of receiving


def feed(box: Inbox, *poses: GpsPose) -> None:
    for message in poses:
        box.on_bytes(key(message.vehicle, GPS), encode(message))


def test_messages_sent_while_not_receiving_are_discarded() -> None:
    box = make_inbox()
    feed(box, pose(0), pose(1))
    assert [message.seq for message in taken(box, START + 100 * MS)] == [0, 1]
    feed(box, pose(2), pose(3))
    box.discard(START + 150 * MS, UNKNOWN_POSITION)  # the fourth was sent at this instant
    feed(box, pose(4), pose(6))  # this tick is late: one message was sent after it
    box.discard(START + 200 * MS, UNKNOWN_POSITION)
    links = inbox_of("follower_2", {"lead": LinkTable(latency_ms=20.0)}, start_at=START).links
    box.restart(links.values(), START + 260 * MS)
    feed(box, pose(5), pose(7))  # the first was sent before
    assert [message.seq for message in taken(box, START + 400 * MS)] == [6, 7]
    assert box.delivered == 4
    assert [message.seq for message in box.verdicts()] == [0, 1, 2, 3]
    assert not box.rejected
    assert box.late == 0
