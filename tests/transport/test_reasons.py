"""The table of reasons: complete, and how reasons are counted."""

from typing import get_args

import pytest

from transport.topics import REASONS, DropReason, RefusalReason, counts_as_late, counts_as_loss


def test_every_word_has_its_row() -> None:
    assert list(REASONS) == [*get_args(DropReason), *get_args(RefusalReason)]
    assert {word for word, row in REASONS.items() if row.is_drop} == set(get_args(DropReason))


@pytest.mark.parametrize("word", REASONS)
def test_a_reason_is_one_word_with_a_meaning(word: str) -> None:
    assert word.replace("_", "").isalpha()
    assert word == word.lower()
    assert len(REASONS[word].meaning) > 10


def test_a_word_of_a_later_version_counts_as_lost() -> None:
    assert counts_as_loss("tunnel")
    assert not counts_as_late("tunnel")
