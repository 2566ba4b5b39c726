"""Verdicts of a link: keyed by the message alone, with the requested losses and delays."""

import itertools
from dataclasses import dataclass
from fractions import Fraction
from math import sqrt
from random import Random
from statistics import fmean

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.schema.link_tables import LinkTable
from tests.made.transport.links import link
from transport.links.laws.basic import Decimation, Latency
from transport.links.laws.link_law import Draw, Effect, TransmissionContext
from transport.links.link import ChangedEffects, Link, Verdict, combine, keyed_draw
from transport.topics import DropReason

MS = 1_000_000
PERIOD = 50 * MS
RATE_HZ = 20.0


def judge(
    requested: LinkTable,
    seq: int,
    *,
    seed: int = 1,
    sender: str = "lead",
    receiver: str = "follower_1",
    source_rate_hz: float = RATE_HZ,
) -> Verdict:
    tested = link(requested, sender, receiver, seed=seed, rate_hz=source_rate_hz)
    return tested.judge(TransmissionContext(seq, seq * PERIOD))


def keyed_uniform(seed: int, sender: str, receiver: str, seq: int, purpose: str) -> float:
    return keyed_draw(seed, sender, receiver)(purpose, seq)


def test_keyed_uniform_keeps_its_values() -> None:
    # Recorded runs can be repeated only while these stay; from the definition in
    # test_keyed_uniform_follows_its_definition.
    assert keyed_uniform(1, "lead", "follower_1", 0, "loss") == 0.5557106400040882
    assert keyed_uniform(1, "lead", "follower_1", 1, "loss") == 0.7327022042726689
    assert keyed_uniform(7, "follower_1", "follower_2", 123_456, "jitter") == 0.9093441215500883


def test_keyed_uniform_is_uniform() -> None:
    n, bins = 20_000, 20
    counts = [0] * bins
    for seq in range(n):
        drawn = keyed_uniform(3, "lead", "f1", seq, "loss")
        assert 0.0 < drawn < 1.0
        counts[int(drawn * bins)] += 1
    chi_squared = sum((count - n / bins) ** 2 / (n / bins) for count in counts)
    assert 5.0 < chi_squared < 45.3  # 19 degrees of freedom, 0.1 % on either side


@pytest.mark.parametrize(("ratio", "outcome"), [(0.0, "delivered"), (1.0, "dropped")])
def test_no_loss_and_total_loss_are_exact(ratio: float, outcome: str) -> None:
    rule = LinkTable(loss_ratio=ratio)
    assert {judge(rule, seq).outcome for seq in range(2000)} == {outcome}


def test_a_higher_loss_drops_the_same_messages_and_more() -> None:
    few = {k for k in range(2000) if judge(LinkTable(loss_ratio=0.1), k).reason}
    many = {k for k in range(2000) if judge(LinkTable(loss_ratio=0.2), k).reason}
    assert few < many


@given(
    seed=st.integers(0, 2**31),
    order=st.randoms(use_true_random=False),
    kept=st.sets(st.integers(0, 60), min_size=1),
)
def test_verdict_depends_on_neither_order_nor_gaps_nor_other_links(
    seed: int, order: Random, kept: set[int]
) -> None:
    rule = LinkTable(loss_ratio=0.4, jitter_ms=30.0, rate_hz=15.0)
    alone = {seq: judge(rule, seq, seed=seed) for seq in range(61)}
    shuffled = sorted(kept)
    order.shuffle(shuffled)
    for seq in shuffled:
        judge(LinkTable(loss_ratio=0.9), seq, seed=seed, receiver="another")
        assert judge(rule, seq, seed=seed) == alone[seq]


def test_latency_is_added_to_the_instant_of_measurement() -> None:
    assert judge(LinkTable(latency_ms=12.5), 3) == Verdict("delivered", "", 3 * PERIOD + 12_500_000)
    assert judge(LinkTable(latency_ms=0.0), 3).visible_at == 3 * PERIOD


def test_jitter_is_uniform_above_the_latency() -> None:
    rule = LinkTable(latency_ms=20.0, jitter_ms=40.0)
    n = 4000
    delays = [(judge(rule, seq).visible_at - seq * PERIOD) / MS for seq in range(n)]
    assert 20.0 <= min(delays) < 20.5
    assert 59.5 < max(delays) <= 60.0
    assert abs(fmean(delays) - 40.0) < 4.0 * 40.0 / sqrt(12 * n)


def test_losses_do_not_pick_by_jitter() -> None:
    rule = LinkTable(latency_ms=0.0, jitter_ms=100.0, loss_ratio=0.5)
    judged = [judge(rule, seq) for seq in range(4000)]
    delays = [(v.visible_at - seq * PERIOD) / MS for seq, v in enumerate(judged) if not v.reason]
    assert abs(fmean(delays) - 50.0) < 4.0 * 100.0 / sqrt(12 * len(delays))


@pytest.mark.parametrize(
    ("rate_hz", "through"),
    [
        (20.0, [0, 1, 2, 3, 4, 5, 6, 7, 8]),
        (50.0, [0, 1, 2, 3, 4, 5, 6, 7, 8]),
        (15.0, [0, 2, 3, 4, 6, 7, 8]),
        (10.0, [0, 2, 4, 6, 8]),
        (5.0, [0, 4, 8]),
        (40.0 / 3.0, [0, 2, 3, 5, 6, 8]),
        (3.0, [0, 7]),
    ],
)
def test_rate_lets_evenly_spread_messages_through(rate_hz: float, through: list[int]) -> None:
    judged = [judge(LinkTable(rate_hz=rate_hz), seq) for seq in range(9)]
    assert [seq for seq, verdict in enumerate(judged) if verdict.outcome == "delivered"] == through
    assert {verdict.reason for verdict in judged if verdict.outcome == "dropped"} <= {"rate"}


@dataclass(frozen=True)
class Fixed(Effect):
    answer: int | DropReason

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:  # noqa: ARG002
        return self.answer


def no_chance(purpose: str, seq: int) -> float:
    raise AssertionError(f"{purpose} of {seq} needs no chance")


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([], Verdict("delivered", "", 100)),
        ([5, 7], Verdict("delivered", "", 112)),
        ([5, "loss", 7], Verdict("dropped", "loss", 112)),
        (["rate", "loss"], Verdict("dropped", "rate", 100)),
    ],
)
def test_delays_add_up_and_any_drop_wins(
    answers: list[int | DropReason], expected: Verdict
) -> None:
    chain: list[Effect] = [Fixed(answer) for answer in answers]
    assert combine(chain, no_chance, TransmissionContext(0, 100)) == expected


@given(
    st.lists(st.tuples(st.integers(0, 40), st.integers(0, 15)), max_size=4),
    st.integers(0, 15),
    st.integers(0, 80),
)
def test_the_last_visible_sending_follows_changes_of_the_minimum_latency(
    later: list[tuple[int, int]], floor: int, now: int
) -> None:
    starts = sorted({at for at, _ in later})
    course = [ChangedEffects(at, (Latency(dict(later)[at]),)) for at in starts]
    tested = Link((Latency(floor),), 1, "lead", "follower_1", changes=course)

    def least(sent_at: int) -> int:
        floors = [change.floor for change in course if change.from_at <= sent_at]
        return floors[-1] if floors else floor

    visible = [at for at in range(-100, 100) if at + least(at) <= now]
    assert tested.latest_sent_at(now) == max(visible)
    for sent_at in range(-5, 60):
        assert tested.judge(TransmissionContext(0, sent_at)).visible_at == sent_at + least(sent_at)


def test_losses_in_a_row_are_as_frequent_as_independence_has_it() -> None:
    n, ratio = 5000, 0.3
    lost = [judge(LinkTable(loss_ratio=ratio), seq).outcome == "dropped" for seq in range(n)]
    pairs = sum(a and b for a, b in itertools.pairwise(lost))
    assert abs(pairs - n * ratio**2) < 5.0 * sqrt(n * ratio**2)


def test_jitter_does_not_move_losses() -> None:
    plain = [judge(LinkTable(loss_ratio=0.3), k).outcome for k in range(500)]
    jittery = [judge(LinkTable(loss_ratio=0.3, jitter_ms=50.0), k).outcome for k in range(500)]
    assert plain == jittery


@given(top=st.integers(1, 100), bottom=st.integers(1, 100), n=st.integers(1, 3000))
def test_rate_is_kept_to_within_one_message(top: int, bottom: int, n: int) -> None:
    decimation = Decimation(min(Fraction(top, bottom), Fraction(1)))
    carried = sum(decimation.judge(no_chance, TransmissionContext(seq, 0)) == 0 for seq in range(n))
    assert 0 <= carried - (n - 1) * decimation.kept <= 1
