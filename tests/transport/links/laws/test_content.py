"""Copies, reordering and bit errors: requested ratios, keyed by the message alone."""

from collections import Counter
from math import comb, exp, log, sqrt
from zlib import crc32

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transport.links.laws.basic import Jitter
from transport.links.laws.content import (
    BitErrors,
    Duplication,
    Reordering,
    choose_bits,
    copy_draw,
    flip_bits,
)
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import combine, keyed_draw

DRAW = keyed_draw(1, "v1", "v2")
MS = 1_000_000
LIMIT = 4.0
"""Tolerance in standard errors."""


def off(count: int, n: int, share: float) -> float:
    """Difference of a count from a binomial mean, in standard errors."""
    return abs(count - n * share) / sqrt(n * share * (1.0 - share))


@pytest.mark.campaign(10_000, 100_000)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("ratio", [0.01, 0.3])
def test_copies_and_held_back_messages_have_the_requested_ratios(
    seed: int, ratio: float, campaign: int
) -> None:
    draw = keyed_draw(seed, "v1", "v2")
    copies, held = Duplication(ratio), Reordering(ratio, 70 * MS)
    numbers = range(campaign)
    twice = [copies.copies(draw, k) for k in numbers]
    later = [held.judge(draw, TransmissionContext(k, 0)) for k in numbers]
    assert set(twice) == {0, 1}
    assert set(later) == {0, 70 * MS}
    assert off(sum(twice), campaign, ratio) < LIMIT
    assert off(later.count(70 * MS), campaign, ratio) < LIMIT
    both = sum(bool(a and b) for a, b in zip(twice, later, strict=True))
    assert off(both, campaign, ratio**2) < LIMIT  # independent


@pytest.mark.campaign(10_000, 100_000)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("ratio", "size"), [(1e-5, 150), (3e-4, 150), (2e-3, 190), (0.1, 12)])
def test_frames_are_hit_as_often_as_the_closed_form_has_it(
    seed: int, ratio: float, size: int, campaign: int
) -> None:
    errors, draw, bits = BitErrors(ratio), keyed_draw(seed, "v1", "v2"), 8 * size
    flips = [errors.flips(draw, k, size) for k in range(campaign)]
    hit = 1.0 - (1.0 - ratio) ** bits
    assert errors.corrupted_share(size) == pytest.approx(hit, rel=1e-9)
    assert off(sum(map(bool, flips)), campaign, hit) < LIMIT
    # The total number of flips is that of independent bits.
    assert off(sum(flips), campaign * bits, ratio) < LIMIT
    seen = Counter(flips)
    for count in range(6):
        share = comb(bits, count) * ratio**count * (1.0 - ratio) ** (bits - count)
        if campaign * share > 20.0:
            assert off(seen[count], campaign, share) < LIMIT


@given(st.binary(min_size=1, max_size=200), st.integers(0, 1600), st.integers(0, 10_000))
def test_as_many_bits_differ_as_were_flipped_and_no_others(
    frame: bytes, count: int, seq: int
) -> None:
    bits = 8 * len(frame)
    places = choose_bits(DRAW, seq, count, bits)
    assert len(set(places)) == len(places) == min(count, bits)
    assert all(0 <= place < bits for place in places)
    came = flip_bits(frame, places)
    differ = int.from_bytes(frame, "little") ^ int.from_bytes(came, "little")
    assert differ == sum(1 << place for place in places)
    assert flip_bits(came, places) == frame


@given(st.binary(min_size=1, max_size=300), st.sets(st.integers(0, 2399), min_size=1, max_size=3))
def test_the_frame_check_sees_up_to_three_wrong_bits(frame: bytes, places: set[int]) -> None:
    """The Hamming distance of CRC-32 is at least 4 up to 91 607 bits (Koopman 2002)."""
    inside = {place % (8 * len(frame)) for place in places}
    came = flip_bits(frame, inside)
    assert BitErrors(0.1).is_detected(frame, came)
    assert not BitErrors(0.1, frame_check=False).is_detected(frame, came)
    assert not BitErrors(0.1).is_detected(frame, frame)


def test_undetected_bit_errors_pass_the_frame_check() -> None:
    # CRC-32 is affine: the generator polynomial as an error pattern does not change it.
    sent = bytes(range(40))
    polynomial = [32 - k for k in (32, 26, 23, 22, 16, 12, 11, 10, 8, 7, 5, 4, 2, 1, 0)]
    came = flip_bits(sent, polynomial)
    assert crc32(came) == crc32(sent)
    assert not BitErrors(0.1).is_detected(sent, came)
    assert BitErrors(0.1).is_detected(sent, flip_bits(sent, polynomial[1:]))


def test_a_copy_s_delay_is_drawn_apart_from_the_message_s() -> None:
    n, spread = 4000, 100 * MS
    own = [
        combine((Jitter(spread),), DRAW, TransmissionContext(k, 0)).visible_at / spread
        for k in range(n)
    ]
    copy = [
        combine((Jitter(spread),), copy_draw(DRAW), TransmissionContext(k, 0)).visible_at / spread
        for k in range(n)
    ]
    assert abs(sum(copy) / n - 0.5) < LIMIT / sqrt(12 * n)
    covariance = sum((a - 0.5) * (b - 0.5) for a, b in zip(own, copy, strict=True)) / n
    assert abs(covariance) < LIMIT / 12 / sqrt(n)


@given(st.floats(1e-6, 0.1), st.integers(1, 512), st.floats(1e-15, 1.0, exclude_max=True))
def test_any_draw_gives_a_number_of_bits_that_the_frame_has(
    ratio: float, size: int, drawn: float
) -> None:
    count = BitErrors(ratio).flips(lambda _purpose, _seq: drawn, 0, size)
    hit = 1.0 - exp(8 * size * log(1.0 - ratio))
    assert 0 <= count <= 8 * size
    if abs(drawn - hit) > 1e-9:  # closer values may be decided by rounding
        assert (count > 0) == (drawn < hit)
