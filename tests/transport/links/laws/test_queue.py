"""Queue and order against closed forms and an independent simulation."""

from itertools import accumulate
from math import sqrt
from random import Random
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.schema.link_tables import LinkTable
from tests.made.transport.links import link
from transport.links.inbox import judge_stream
from transport.links.laws.basic import Queue
from transport.links.laws.link_law import InOrder, StagedMessage, StageLaw, TransmissionContext
from vehicles.schedule import SECOND

MS = SECOND // 1000
NEVER = 2**62


def queue_of(bytes_per_s: float, depth: int, drop: Literal["newest", "oldest"] = "newest") -> Queue:
    return Queue(bytes_per_s=bytes_per_s, depth_messages=depth, drop=drop)


def through(
    law: StageLaw, sent: list[StagedMessage], until: int = NEVER
) -> dict[int, StagedMessage]:
    found = law.stage().carry(sent, until)
    return {staged.context.seq: staged for staged in found}


def messages(instants: list[int], sizes: list[int] | int = 100) -> list[StagedMessage]:
    if isinstance(sizes, int):
        sizes = [sizes] * len(instants)
    contexts = [
        TransmissionContext(seq, at, size)
        for seq, (at, size) in enumerate(zip(instants, sizes, strict=True))
    ]
    return [StagedMessage(context, context.sent_at) for context in contexts]


# ---- Closed forms


@pytest.mark.parametrize("drop", ["newest", "oldest"])
@pytest.mark.parametrize("depth", [1, 4, 20])
def test_above_its_rate_a_queue_fills_and_drops(depth: int, drop: str) -> None:
    # 40 ms each, one every 25 ms: 1 - 25/40 are lost, and sent messages have waited for a full
    # queue, `depth` times 40 ms.
    law, count = queue_of(2500.0, depth, drop), 20_000  # type: ignore[arg-type]  # of the two
    found = through(law, messages([25 * MS * k for k in range(count)]))
    lost = sum(staged.reason == "queue" for staged in found.values())
    assert abs(lost / count - 0.375) < (depth + 2) / count
    delays = [
        staged.visible_at - staged.context.sent_at
        for staged in list(found.values())[500:-100]
        if not staged.reason
    ]
    if drop == "newest":  # joins behind depth - 1 messages and the one being sent
        assert depth * 40 * MS <= min(delays)
        assert max(delays) <= (depth + 1) * 40 * MS
    else:  # older messages are dropped, so those sent are newer
        assert max(delays) <= (25 * depth + 40) * MS


@pytest.mark.parametrize("load", [0.3, 0.6, 0.8])
@pytest.mark.campaign(10_000, 100_000)
def test_random_arrivals_wait_as_pollaczek_and_khinchine_have_it(
    load: float, campaign: int
) -> None:
    """M/D/1: the mean wait is load / (2 (1 - load)) transmission times."""
    service = 10 * MS
    waits = []
    for seed in (1, 2, 3):
        random = Random(seed)
        gaps = [round(random.expovariate(load / service)) for _ in range(campaign)]
        found = through(queue_of(10_000.0, 10_000), messages(list(accumulate(gaps))))
        waits += [
            (found[seq].visible_at - found[seq].context.sent_at - service) / service
            for seq in range(len(found))
        ]
    parts = [waits[k : k + 1000] for k in range(0, len(waits), 1000)]
    means = [sum(part) / len(part) for part in parts]
    mean = sum(means) / len(means)
    deviation = sqrt(sum((value - mean) ** 2 for value in means) / (len(means) - 1))
    wanted = load / (2.0 * (1.0 - load))
    assert abs(mean - wanted) < 3.0 * deviation / sqrt(len(means))


# ---- Against an independent simulation


def brute_force(instants: list[int], sizes: list[int], law: Queue) -> dict[int, tuple[str, int]]:
    """Verdicts with instants, simulated in steps of one nanosecond."""
    queue: list[int] = []
    sending, done_at = None, -1
    fate: dict[int, tuple[str, int]] = {}
    now, k = 0, 0
    while len(fate) < len(instants):
        if sending is not None and now == done_at:
            fate[sending], sending = ("", now), None
        if sending is None and queue:
            sending = queue.pop(0)
            done_at = now + law.service(sizes[sending])
        while k < len(instants) and instants[k] == now:
            if sending is None:
                sending, done_at = k, now + law.service(sizes[k])
            elif len(queue) < law.depth_messages:
                queue.append(k)
            elif law.drop == "newest":
                fate[k] = "queue", now
            else:
                fate[queue.pop(0)] = "queue", now
                queue.append(k)
            k += 1
        now += 1
    return fate


@given(
    gaps=st.lists(st.integers(0, 12), min_size=1, max_size=40),
    data=st.data(),
    depth=st.integers(1, 4),
    drop=st.sampled_from(["newest", "oldest"]),
)
def test_it_is_the_queue_of_another_simulation(
    gaps: list[int], data: st.DataObject, depth: int, drop: str
) -> None:
    sizes = data.draw(st.lists(st.integers(1, 15), min_size=len(gaps), max_size=len(gaps)))
    instants = list(accumulate(gaps))
    law = queue_of(1e9, depth, drop)  # type: ignore[arg-type]  # a byte takes a nanosecond
    found = through(law, messages(instants, sizes))
    assert {
        seq: (staged.reason, staged.visible_at) for seq, staged in found.items()
    } == brute_force(instants, sizes, law)


# ---- Lost messages, order, and whole links


@given(st.lists(st.tuples(st.integers(0, 100), st.booleans()), min_size=1, max_size=30))
def test_in_order_is_the_largest_so_far_of_those_that_are_delivered(
    rows: list[tuple[int, bool]],
) -> None:
    sent = [
        StagedMessage(TransmissionContext(seq, seq), seq + delay, "loss" if lost else "")
        for seq, (delay, lost) in enumerate(rows)
    ]
    found = through(InOrder(), sent)
    for seq in range(len(rows)):
        before = [staged.visible_at for staged in sent[:seq] if not staged.reason]
        assert found[seq].visible_at == max([sent[seq].visible_at, *before])
        assert found[seq].reason == sent[seq].reason


def test_a_link_in_order_delays_and_one_that_is_free_lets_overtake() -> None:
    stream = [TransmissionContext(seq, seq * 20 * MS, 130) for seq in range(500)]
    law = {"kind": "uniform", "delay_ms_max": 100.0}
    free = LinkTable.model_validate({"delay": law})
    tied = LinkTable.model_validate({"delay": law | {"order": "in_order"}})
    overtaking = [verdict.visible_at for verdict in judge_stream(link(free), stream)]
    ordered = [verdict.visible_at for verdict in judge_stream(link(tied), stream)]
    assert overtaking != sorted(overtaking)
    assert ordered == list(accumulate(overtaking, max))


@given(
    gaps=st.lists(st.integers(0, 12), min_size=1, max_size=40),
    drop=st.sampled_from(["newest", "oldest"]),
    steps=st.lists(st.integers(1, 40), min_size=1, max_size=10),
)
def test_the_instants_of_deciding_change_nothing(
    gaps: list[int], drop: str, steps: list[int]
) -> None:
    instants = list(accumulate(gaps))
    law, sent = queue_of(1e9, 2, drop), messages(instants, 10)  # type: ignore[arg-type]
    order = InOrder()
    at_once = order.stage().carry(law.stage().carry(sent, NEVER), NEVER)
    queue, ordered, until, before = law.stage(), order.stage(), 0, -1
    found: list[StagedMessage] = []
    k = 0
    while len(found) < len(sent):
        until += steps[k % len(steps)]
        k += 1
        arrived = [staged for staged in sent if before < staged.context.sent_at <= until]
        decided = ordered.carry(queue.carry(arrived, until), until)
        # Messages visible by the previous instant were decided then.
        assert all(staged.visible_at > before for staged in decided)
        found += decided
        before = until
    assert found == at_once
