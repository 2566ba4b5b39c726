"""Messages that affect each other: the same verdicts while their bytes arrive in time."""

from collections.abc import Iterable
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
from transport.links.inbox import Inbox, judge_stream
from transport.links.laws.link_law import TransmissionContext
from transport.topics import TOPICS, key
from vehicles.messages import GpsPose, LinkVerdict
from vehicles.schedule import SECOND, instant

START = 1_790_000_000 * SECOND
MS = 1_000_000
RATE_HZ = 20.0
FLOOR = 20 * MS

LAW = {"kind": "gamma", "mean_ms": 40.0, "deviation_ms": 60.0, "order": "in_order"}
QUEUE = {"bytes_per_s": 1500.0, "depth_messages": 2}
RULES = {
    "in order": {"delay": LAW | {"correlation_ratio": 0.5}, "loss_ratio": 0.2},
    "newest": {"queue": QUEUE, "jitter_ms": 30.0},
    "oldest": {"queue": QUEUE | {"drop": "oldest"}, "jitter_ms": 30.0},
    "both": {"queue": QUEUE | {"drop": "oldest"}, "delay": LAW, "loss_ratio": 0.1},
}


def pose(seq: int, vehicle: str = "lead") -> GpsPose:
    place = {"latitude_deg": 37.72 + seq * 1e-6, "longitude_deg": -122.47, "altitude_m": 30.0}
    motion = {"heading_deg": 90.0, "speed_mps": 30.0, "yaw_rate_radps": 0.01}
    return made_pose(vehicle, seq, instant(START, seq, RATE_HZ), **place, **motion)


def make_inbox(rule: str, seed: int = 1) -> Inbox:
    requested = {"lead": LinkTable.model_validate(RULES[rule])}
    return inbox_of("follower_1", requested, seed=seed, start_at=START, rate_hz=RATE_HZ)


def send(inbox: Inbox, message: GpsPose) -> None:
    inbox.on_bytes(key("lead", TOPICS["gps"]), encode(message))


def run(
    rule: str, seed: int, arrivals: Iterable[tuple[int, GpsPose]]
) -> tuple[list[GpsPose], list[LinkVerdict], Inbox]:
    """Run an inbox for five seconds; a pose arrives before the first tick from its instant."""
    inbox, pending = make_inbox(rule, seed), sorted(arrivals, key=lambda row: row[0])
    received, verdicts = list[GpsPose](), list[LinkVerdict]()
    for tick in ticks(START, START + 5 * SECOND, 50.0, RATE_HZ):
        while pending and pending[0][0] <= tick.at:
            send(inbox, pending.pop(0)[1])
        received += taken(inbox, tick.at)
        verdicts += inbox.verdicts()
    assert not inbox.rejected
    return received, verdicts, inbox


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=10)
@given(random=st.randoms(use_true_random=False), seed=st.integers(0, 1000))
def test_the_time_of_arrival_changes_nothing_while_it_is_in_time(
    rule: str, random: Random, seed: int
) -> None:
    poses = [pose(k) for k in range(80)]
    received, verdicts, inbox = run(rule, seed, [(m.sent_at_ns, m) for m in poses])
    random.shuffle(poses)
    delayed = [(m.sent_at_ns + random.randrange(FLOOR), m) for m in poses]
    assert run(rule, seed, delayed)[:2] == (received, verdicts)
    assert inbox.late == 0
    assert {v.outcome for v in verdicts} == {"delivered", "dropped"}


@pytest.mark.parametrize("rule", RULES)
def test_verdicts_are_those_of_the_stream_of_what_was_sent(rule: str) -> None:
    poses = [pose(k) for k in range(80)]
    received, verdicts, _ = run(rule, 5, [(m.sent_at_ns, m) for m in poses])
    link = link_of(LinkTable.model_validate(RULES[rule]), seed=5, rate_hz=RATE_HZ)
    stream = [TransmissionContext(m.seq, m.sent_at_ns, len(encode(m))) for m in poses]
    judged = judge_stream(link, stream)
    for v in verdicts:
        wanted = judged[v.pose_seq]
        assert (v.outcome, v.reason, v.visible_at_ns) == (
            wanted.outcome, wanted.reason, wanted.visible_at,
        )  # fmt: skip
        # Published at the first tick from its instant, even if decided later.
        assert v.visible_at_ns <= v.received_at_ns < v.visible_at_ns + 20 * MS
    assert len(verdicts) > 50
    if "delay" in RULES[rule]:
        assert [message.seq for message in received] == sorted(message.seq for message in received)
