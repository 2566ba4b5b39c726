"""Figures of a link: losses by number, delays, ages at commands, and deviations from requests."""

from dataclasses import replace
from math import nan
from random import Random

import pytest

from scenarios.results.link_account import accounts
from scenarios.results.links import (
    LinkSummary,
    channel_warnings,
    link_summaries,
)
from scenarios.results.log_summary import late_lines, transport_lines
from scenarios.results.vehicle_figures import vehicle_summaries
from tests.made.scenarios.messages import MS, at, start, tracking, verdict
from tests.made.scenarios.recorded_run import POSES, MadeRun, Recorded, convoy, tables_of
from vehicles.messages import Change, LinkVerdict

LINK = ("v1", "v2")


def fates(text: str, latency_ms: float = 20.0) -> list[LinkVerdict]:
    """Verdicts from a text: "." delivered, "x" lost, "-" held back by the rate."""
    words = {".": "", "x": "loss", "-": "rate"}
    return [
        verdict("v1", "v2", seq, dropped=words[one], latency_ms=latency_ms)
        for seq, one in enumerate(text)
    ]


def summary_of(*messages: Recorded, overrides: tuple[str, ...] = ()) -> LinkSummary:
    run = tables_of([(at(0.0), start()), *messages], convoy(*overrides))
    (row,) = [
        row for row in link_summaries(run, accounts(run)) if (row.sender, row.receiver) == LINK
    ]
    return row


def recorded(*verdicts: LinkVerdict) -> list[Recorded]:
    """Verdicts in this order of decisions."""
    return [(one.received_at_ns, replace(one, seq=seq)) for seq, one in enumerate(verdicts)]


@pytest.mark.parametrize("text", ["", "....", "xx.x-x..", "-x--xxxx.x", "xxxx"])
def test_losses_are_counted_by_number_in_any_order_of_verdicts(text: str) -> None:
    reported = fates(text)
    Random(4).shuffle(reported)
    found = summary_of(*recorded(*reported))
    carried = text.replace("-", "")
    assert found.judged == len(text) == found.delivered + sum(found.dropped.values())
    assert found.loss_ratio == carried.count("x") / max(len(carried), 1)
    runs = [len(run) for run in carried.split(".") if run]
    assert found.burst_messages_max == max(runs, default=0)
    if runs:
        assert found.burst_messages_mean == pytest.approx(sum(runs) / len(runs))


def test_overtaking_messages_and_copies_are_counted() -> None:
    one, two, three, four = fates("....")
    found = summary_of(*recorded(one, four, two, replace(three, copies=1)))
    assert (found.reordered, found.copies) == (2, 1)


def test_latency_is_that_until_a_message_can_be_used() -> None:
    """20 ms by the channel, but 566 ms for a late message; gaps between instants of delivery."""
    one, two, three = fates("...")
    late = verdict("v1", "v2", 3, received_after_ms=566.0)
    found = summary_of(*recorded(one, two, three, late))
    assert (found.late, found.latency_ms_max) == (1, 566.0)
    assert found.latency_ms_mean == pytest.approx((3 * 20 + 566) / 4)
    assert found.arrival_gap_ms_mean == pytest.approx((50 + 50 + 50 + 546) / 3)
    assert found.arrival_gap_ms_max == pytest.approx(596.0)


def ages(*values: float, statuses: str = "") -> list[Recorded]:
    """Decisions of v2 with ages (s) of the lead's data; statuses "l" lost, "f" fresh."""
    words = {"l": "lost", "f": "fresh", "u": "unheard"}
    return [
        (
            at(seq / 50),
            tracking("v2", seq, lead_age_s=age, lead_status=words[statuses[seq : seq + 1] or "f"]),
        )
        for seq, age in enumerate(values)
    ]


def test_ages_at_commands_and_the_share_of_them_that_is_safe() -> None:
    found = summary_of(*ages(nan, 0.05, 0.15, 0.1, 0.35))
    assert found.age_ms_mean == pytest.approx(162.5)
    assert found.age_ms_max == pytest.approx(350.0)
    assert found.safe_time_ratio["100"] == 2 / 5
    assert found.safe_time_ratio["300"] == 3 / 5
    assert found.safe_time_ratio["1000"] == 4 / 5  # before the first nothing is safe


def test_ages_of_other_sources_are_those_of_their_links() -> None:
    """v1 receives v2, which is neither its lead nor its predecessor: only a follower has ages."""
    other = {"other_sources": "v2 fresh", "other_age_s": (0.2,)}
    run = tables_of([(at(0.0), start()), (at(0.0), tracking("v3", 0, **other))])
    rows = {(row.sender, row.receiver): row for row in link_summaries(run, accounts(run))}
    assert rows["v2", "v1"].age_ms_mean is None
    assert rows["v1", "v3"].age_ms_mean == rows["v2", "v3"].age_ms_mean == pytest.approx(20.0)


def test_false_alarms_are_losses_of_a_source_that_still_sends() -> None:
    statuses = "ufllflf"
    messages = ages(*[0.1] * len(statuses), statuses=statuses)
    until = verdict("v2", "v1", 0, received_after_ms=60.0)
    alarms = summary_of(*messages, (until.received_at_ns, until)).false_alarms.counted
    assert alarms == 1  # the second one is at 0.10 s, after the last message of v1
    assert summary_of(*ages(0.1, statuses="u")).false_alarms.counted is None


def test_the_delay_of_the_real_transport_and_the_share_above_the_floor_are_figures() -> None:
    made = MadeRun()
    made.transit = {("v1", k): 566 * MS for k in range(100)}
    run = made.tables()
    rows = {(row.sender, row.receiver): row for row in link_summaries(run, accounts(run))}
    slow, quick = rows["v1", "v2"], rows["v2", "v3"]
    assert slow.transport_ms_mean == pytest.approx((566 + 3) / 2)
    assert (slow.transport_ms_max, slow.transport_above_floor_ratio) == (566.0, 0.5)
    assert (quick.transport_ms_p95, quick.transport_above_floor_ratio) == (3.0, 0.0)


def test_a_changed_link_is_not_compared_with_its_request() -> None:
    verdicts = fates("x" * 300 + "." * 300, latency_ms=90.0)
    table = '{"kind": "link", "at_s": 1.0, "sender": "v1", "receiver": "v2", "loss_ratio": 0.5}'
    change = Change(
        vehicle="v2", seq=0, effective_at_ns=at(1.0), kind="link", by_hand=False, table=table
    )
    messages = [*recorded(*verdicts), (at(1.0), change)]
    run = tables_of([(at(0.0), start()), *messages])
    (line,) = channel_warnings(run, accounts(run))
    assert line == "no requested values are shown for links changed during the run: v1 → v2"
    found = summary_of(*messages)
    assert found.requested_loss_ratio is found.requested_latency_ms_mean is None
    assert found.loss_ratio == 0.5


def test_a_slow_network_is_not_blamed_on_the_machine() -> None:
    made = MadeRun()
    made.transit = {("v1", k): 566 * MS for k in range(POSES)}
    run = tables_of(made.recorded())
    links, vehicles = link_summaries(run, accounts(run)), vehicle_summaries(run, {})
    (line,) = transport_lines(links, vehicles)
    assert line.startswith("the network was slow: 100 % of the poses of v1")
    assert list(late_lines(vehicles)) == []
    late = [replace(row, late_ticks=row.ticks) for row in vehicles]
    assert list(transport_lines(links, late)) == []
    (busy,) = late_lines(late)
    assert "the machine is too slow" in busy
    (mixed,) = late_lines([replace(row, late_ticks_by_network=row.ticks) for row in late])
    assert "machine" not in mixed
    assert "blocked by the network" in mixed
