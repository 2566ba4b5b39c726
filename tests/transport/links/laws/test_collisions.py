"""Persistent collisions: whole reservations, of the lengths asked for, kept as often as asked."""

from itertools import groupby, pairwise
from math import sqrt

import numpy as np
import pytest

from transport.links.laws.collisions import Collisions
from transport.links.laws.effect import Passage
from transport.links.link import keyed_draw


def ends(law: Collisions, seed: int, count: int) -> list[tuple[int, int, bool]]:
    """Reservations of a stream: start, end, whether they collide, as the law remembers them."""
    draw, found = keyed_draw(seed, "a", "b"), list[tuple[int, int, bool]]()
    for seq in range(count):
        law.judge(draw, Passage(seq, 0))
        known = law._known[0][1:]
        if not found or found[-1] != known:
            found.append(known)
    return found


@pytest.mark.parametrize(("shortest", "longest"), [(5, 15), (1, 4), (7, 7), (25, 75)])
def test_reservations_follow_one_another_and_have_their_lengths(
    shortest: int, longest: int
) -> None:
    found = ends(Collisions(0.5, 0.0, shortest, longest), 1, 30_000)
    assert all(before[1] == after[0] for before, after in pairwise(found))
    lengths = np.array([end - start for start, end, _ in found[1:-1]])
    assert (lengths.min(), lengths.max()) == (shortest, longest)
    kinds = longest - shortest + 1
    counts = np.bincount(lengths - shortest, minlength=kinds)
    expected = len(lengths) / kinds
    chi_squared = float(((counts - expected) ** 2 / expected).sum())
    assert chi_squared < kinds - 1 + 5.0 * sqrt(2.0 * kinds)


@pytest.mark.parametrize("keep", [0.0, 0.4, 0.8])
def test_a_resource_is_kept_as_often_as_asked(keep: float) -> None:
    """Neighbours have the same fate if the resource is kept, or by chance."""
    loss = 0.5
    found = ends(Collisions(loss, keep), 2, 60_000)
    same = [a[2] == b[2] for a, b in pairwise(found)]
    expected = keep + (1.0 - keep) * (loss**2 + (1.0 - loss) ** 2)
    assert abs(np.mean(same) - expected) < 4.0 * sqrt(expected * (1 - expected) / len(same)) + 1e-9


def test_all_messages_of_a_reservation_share_its_fate() -> None:
    law, draw = Collisions(0.3), keyed_draw(3, "a", "b")
    fates = [law.judge(draw, Passage(seq, 0)) for seq in range(20_000)]
    assert set(fates) == {0, "collision"}
    runs = [sum(1 for _ in some) for _, some in groupby(fates)][1:-1]
    assert min(runs) >= 5


def test_the_phase_is_as_likely_one_as_another() -> None:
    """Over many links: reservations of one length would else all start with the first message."""
    law, n = Collisions(0.5, 0.0, 10, 10), 3000
    starts = [0] * 10
    for seed in range(n):
        law.judge(keyed_draw(seed, "a", "b"), Passage(0, 0))
        starts[-law._known[0][1]] += 1
    assert all(abs(count - n / 10) < 4.0 * sqrt(n * 0.09) for count in starts)


@pytest.mark.parametrize(("shortest", "longest"), [(5, 15), (1, 3)])
def test_the_first_message_finds_a_reservation_as_old_as_any_other_does(
    shortest: int, longest: int
) -> None:
    """Stationary renewals: the age is a at number 0 with the chance P(length > a) / mean."""
    law, n = Collisions(0.5, 0.0, shortest, longest), 3000
    ages = np.zeros(longest)
    for seed in range(n):
        law.judge(keyed_draw(seed, "a", "b"), Passage(0, 0))
        ages[-law._known[0][1]] += 1
    lengths = np.arange(shortest, longest + 1)
    chances = np.array([np.mean(lengths > age) for age in range(longest)]) / lengths.mean()
    assert chances.sum() == pytest.approx(1.0)
    assert np.all(np.abs(ages - n * chances) < 4.0 * np.sqrt(n * chances))


def test_no_loss_and_total_loss_are_exact() -> None:
    draw = keyed_draw(1, "a", "b")
    for loss, fate in ((0.0, 0), (1.0, "collision")):
        law = Collisions(loss, 0.5)
        assert {law.judge(draw, Passage(seq, 0)) for seq in range(500)} == {fate}
    assert Collisions(0.0).mean_burst_messages is None
    assert Collisions(1.0).mean_burst_messages == float("inf")
