"""The account of a link: every message's fate once, losses by number, ages at commands."""

from dataclasses import replace
from math import nan
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenarios.results.account import LinkAccount
from scenarios.results.link_summary import (
    LinkSummary,
    describe_link,
    link_summary,
    request_deviations,
)
from scenarios.results.link_tally import LinkTally

from scenarios.definition.schema.link_tables import LinkTable
from tests.made.scenarios.messages import verdict
from vehicles.messages import LinkVerdict

LINK = ("v1", "v2")


def tallied(*verdicts: LinkVerdict) -> LinkTally:
    tally = LinkTally()
    for one in verdicts:
        tally.add(one)
    return tally


def account(requested: LinkTable, tally: LinkTally, sent: int = 0) -> LinkSummary:
    """Summary of a link on which every message without a verdict is in flight."""
    delivered, dropped = tally.delivered, tally.dropped.total()
    in_flight = max(sent - delivered - dropped, 0)
    counts = LinkAccount(sent, delivered, dropped, in_flight=in_flight)
    return link_summary(LINK, requested, counts, tally)


def fates(text: str, latency_ms: float = 20.0) -> list[LinkVerdict]:
    """Verdicts from a text: "." delivered, "x" lost, "-" held back by the rate."""
    words = {".": "", "x": "loss", "-": "rate"}
    return [
        verdict("v1", "v2", seq, dropped=words[one], latency_ms=latency_ms)
        for seq, one in enumerate(text)
    ]


@given(st.text(".x-", max_size=80), st.randoms(use_true_random=False))
def test_losses_are_counted_by_number_in_any_order_of_verdicts(text: str, order: Random) -> None:
    reported = fates(text)
    order.shuffle(reported)
    found = account(LinkTable(), tallied(*reported), len(text))
    carried = text.replace("-", "")
    assert found.judged == len(text) == found.delivered + sum(found.dropped.values())
    if carried:
        assert found.loss_ratio == carried.count("x") / len(carried)
    runs = [len(run) for run in carried.split(".") if run]
    assert found.burst_messages_max == max(runs, default=0)
    if runs:
        assert found.burst_messages_mean == pytest.approx(sum(runs) / len(runs))


def test_overtaking_messages_and_copies_are_counted() -> None:
    reported = fates("....")
    reported[2] = replace(reported[2], copies=1)
    found = account(LinkTable(), tallied(reported[0], reported[3], reported[1], reported[2]))
    assert (found.reordered, found.copies) == (2, 1)


def test_ages_at_commands_and_the_share_of_them_that_is_safe() -> None:
    tally = LinkTally()
    for age in (nan, 0.05, 0.15, 0.1, 0.35):
        tally.add_age(age)
    found = account(LinkTable(), tally)
    assert found.age_ms_mean == pytest.approx(162.5)
    assert found.age_ms_max == pytest.approx(350.0)
    assert found.safe_time_ratio["100"] == 2 / 5
    assert found.safe_time_ratio["300"] == 3 / 5
    assert found.safe_time_ratio["1000"] == 4 / 5  # before the first nothing is safe


def test_a_link_that_kept_its_request_is_not_listed() -> None:
    random = Random(4)
    text = "".join("x" if random.random() < 0.3 else "." for _ in range(2000))
    assert list(request_deviations(LINK, LinkTable(loss_ratio=0.3), tallied(*fates(text)))) == []


@pytest.mark.parametrize(
    ("text", "requested", "word"),
    [
        ("." * 2000, LinkTable(loss_ratio=0.1), "lost 0.00 % of 2000 messages"),
        ("x." * 1000, LinkTable(), "lost 50.00 % of 2000 messages"),
        (("x" * 10 + "." * 23) * 60, LinkTable(loss_ratio=0.3), "bursts"),
        (
            "." * 200,
            LinkTable(latency_ms=20.5),
            "delayed by 20.000 ms on average, requested 20.500",
        ),
    ],
    ids=["none of the loss", "loss unasked", "bursts", "delay"],
)
def test_a_link_that_deviates_from_its_request_is_listed(
    text: str, requested: LinkTable, word: str
) -> None:
    reported = " | ".join(request_deviations(LINK, requested, tallied(*fates(text))))
    assert word in reported
    assert reported.startswith("v1 → v2: ")


def test_a_line_has_requested_and_achieved_figures() -> None:
    tally = tallied(*fates(("x" * 2 + "." * 8) * 20))
    tally.add_age(0.12)
    line = describe_link(account(LinkTable(loss_ratio=0.25), tally))
    assert line.startswith("v1 → v2: lost 20.0 % (")
    assert ") of its messages, requested 25 %; 2.00 in a row, 2 at most; delayed 20.0 ms" in line
    assert line.endswith("requested 20; 120 ms old at commands, 120 at most")


def test_a_changed_link_is_not_compared_with_its_request() -> None:
    tally = tallied(*fates("x" * 300 + "." * 300, latency_ms=90.0))
    assert len(list(request_deviations(LINK, LinkTable(), tally))) == 2
    tally.changed = True
    assert list(request_deviations(LINK, LinkTable(), tally)) == []
    found = account(LinkTable(), tally, 600)
    assert found.requested_loss_ratio is found.requested_latency_ms_mean is None
    assert found.loss_ratio == 0.5
    assert "requested -" in describe_link(found)
