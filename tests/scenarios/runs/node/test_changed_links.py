"""Links that are changed one change at a time come to what they come to all at once."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.changes import LinkChange, course
from scenarios.definition.channel.build import link_effects
from scenarios.definition.schema.change_tables import (
    CutTable,
    HealTable,
    LinkChangeTable,
)
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.runs.node.outbox import DueChange
from scenarios.runs.node.phases import ChangedLinks, ChangingLink
from tests.made.examples import examples
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import Link
from vehicles.schedule import SECOND

START = 1_790_000_000 * SECOND
NAMES = ("v1", "v2", "v3")
ASKED = LinkTable(latency_ms=30.0, jitter_ms=20.0, loss_ratio=0.2)
PAIRS = (("v1", "v3"), ("v2", "v3"))

spans = st.none() | st.integers(1, 20).map(lambda k: k / 4)
changes = st.one_of(
    st.builds(
        LinkChangeTable, kind=st.just("link"), at_s=st.just(0.0), for_s=spans,
        sender=st.sampled_from(["*", "v1", "predecessor"]),
        loss_ratio=st.sampled_from([None, 0.0, 0.6]), latency_ms=st.sampled_from([None, 5.0]),
    ),
    st.builds(
        CutTable, kind=st.just("cut"), at_s=st.just(0.0), for_s=spans,
        sender=st.sampled_from(["*", "v2"]),
    ),
    st.builds(
        HealTable, kind=st.just("heal"), at_s=st.just(0.0), sender=st.sampled_from(["*", "v1"])
    ),
)  # fmt: skip
schedules = st.lists(st.tuples(st.integers(0, 24), changes), max_size=6)


def made(sender: str) -> ChangingLink:
    link = Link(link_effects(ASKED, 20.0), 1, sender, "v3")
    return ChangingLink(link, ASKED, lambda table, more: link_effects(table, 20.0, besides=more))


def dues(schedule: list[tuple[int, LinkChange]], *, by_hand: bool) -> list[DueChange]:
    return [
        DueChange(START + quarter * SECOND // 4, change, by_hand) for quarter, change in schedule
    ]


def reported(links: list[ChangingLink]) -> list[object]:
    contexts = [TransmissionContext(seq, START + seq * SECOND // 20) for seq in range(140)]
    return [one.link.judge(context) for one in links for context in contexts]


@given(schedules, schedules)
@examples(16, 100)
def test_adding_one_by_one_equals_all_at_once(
    before: list[tuple[int, LinkChange]], later: list[tuple[int, LinkChange]]
) -> None:
    """Changes by hand follow scheduled ones, also on links rebuilt after a crash."""
    scheduled = dues(before, by_hand=False)
    by_hand = sorted(dues(later, by_hand=True), key=lambda due: due.at)
    links = [made(sender) for sender, _ in PAIRS]
    changed = ChangedLinks(NAMES, scheduled)
    changed.adopt(links)
    for due in by_hand:
        changed.carry_out(due)
    at_once = [made(sender) for sender, _ in PAIRS]
    ChangedLinks(NAMES, [*scheduled, *by_hand]).adopt(at_once)
    assert reported(links) == reported(at_once)
    restarted = [made(sender) for sender, _ in PAIRS]
    changed.adopt(restarted)
    assert reported(restarted) == reported(links)
    assert list(changed.by_hand) == by_hand
    in_another_process = [made(sender) for sender, _ in PAIRS]
    ChangedLinks(NAMES, scheduled, changed.by_hand).adopt(in_another_process)
    assert reported(in_another_process) == reported(links)
    for one in at_once:
        whole = course(one.changes, one.requested, one.effects_of)
        assert [two.from_at for two in whole] == [two.from_at for two in one.link.changes]


@pytest.mark.parametrize("by_hand", [True, False])
def test_a_scheduled_change_is_known_beforehand_and_one_by_hand_when_it_is_due(
    *, by_hand: bool
) -> None:
    due = DueChange(START + SECOND, CutTable(kind="cut", at_s=1.0), by_hand)
    link = made("v1")
    changed = ChangedLinks(NAMES, [] if by_hand else [due])
    changed.adopt([link])
    early = TransmissionContext(0, START + SECOND)
    assert (link.link.judge(early).reason == "cut") is not by_hand
    changed.carry_out(due)
    assert link.link.judge(early).reason == "cut"
