"""Losses by number: sets of numbers, every n-th, recorded patterns, links of an earlier run."""

from itertools import groupby
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.channels.laws import long_run
from transport.links.laws.link_law import Effect, TransmissionContext
from transport.links.laws.recorded_losses import (
    AfterEnd,
    EarlierRun,
    EveryNth,
    NumberSet,
    RecordedPattern,
)

Some = st.sets(st.integers(0, 80))


def no_chance(purpose: str, seq: int) -> float:
    raise AssertionError(f"{purpose} of {seq} needs no chance")


def lost(law: Effect, count: int) -> list[int]:
    return [
        seq
        for seq in range(count)
        if law.judge(no_chance, TransmissionContext(seq, 0)) == "pattern"
    ]


def numbers(some: set[int]) -> NumberSet:
    return NumberSet.of((one, one) for one in some)


def pattern(some: NumberSet, length: int, after_end: AfterEnd) -> RecordedPattern:
    law = RecordedPattern(length_messages=length, lost_numbers=str(some), after_end=after_end)
    assert not list(law.problems())
    return law


@pytest.mark.parametrize("text", ["a", "3-", "-3", "5-3", "1.5", "1 2", "²", "1" * 19])
def test_other_texts_than_numbers_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="allowed"):
        NumberSet.read(text)


@given(st.integers(1, 20), st.integers(0, 30))
def test_every_nth_is_lost(period: int, first: int) -> None:
    law = EveryNth(every_messages=period, first_number=first)
    assert lost(law, 100) == list(range(first, 100, period))
    assert long_run(law)[0] == 1.0 / period
    assert long_run(law)[1] == (1.0 if period > 1 else inf)


@given(Some, st.integers(81, 120))
def test_a_pattern_repeats_or_ends(some: set[int], length: int) -> None:
    again, once = pattern(numbers(some), length, "repeat"), pattern(numbers(some), length, "pass")
    assert lost(once, 3 * length) == sorted(some)
    assert lost(again, 3 * length) == sorted(n + k * length for n in some for k in range(3))
    assert long_run(again)[0] == long_run(once)[0] == len(some) / length


@given(st.lists(st.booleans(), min_size=1, max_size=40))
def test_bursts_of_a_pattern_are_those_of_its_repetition(fates: list[bool]) -> None:
    some = numbers({number for number, is_lost in enumerate(fates) if is_lost})
    law = pattern(some, len(fates), "repeat")
    turned = fates[fates.index(False) :] + fates[: fates.index(False)] if not all(fates) else fates
    runs = [sum(1 for _ in run) for is_lost, run in groupby(turned) if is_lost]
    expected = inf if all(fates) else sum(runs) / len(runs) if runs else None
    assert long_run(law)[1] == expected


@given(
    st.lists(
        st.tuples(st.sampled_from([5, 7, 9]), st.sampled_from(["", "loss", "rate", "burst"])),
        min_size=1,
        max_size=60,
    ),
    st.sampled_from(["repeat", "pass"]),
)
def test_an_earlier_run_is_repeated_to_the_nanosecond(
    record: list[tuple[int, str]], after_end: str
) -> None:
    dropped = {
        word: numbers({n for n, (_, reason) in enumerate(record) if reason == word})
        for word in ("loss", "rate", "burst")
    }
    law = EarlierRun(
        dropped_numbers={word: str(some) for word, some in dropped.items()},
        delays_ns=", ".join(str(delay) for delay, _ in record),
        after_end="repeat" if after_end == "repeat" else "pass",
    )
    assert not list(law.problems())
    delay = law.recorded_delay(20)
    for seq in range(2 * len(record)):
        expected = record[seq % len(record)]
        if seq >= len(record) and after_end == "pass":
            expected = (20, "")
        context = TransmissionContext(seq, 0)
        assert delay.judge(no_chance, context) == expected[0]
        assert law.judge(no_chance, context) == (expected[1] or 0)
    counted = len(dropped["loss"]) + len(dropped["burst"])  # "rate" does not count as loss
    assert len(law.lost) == counted
