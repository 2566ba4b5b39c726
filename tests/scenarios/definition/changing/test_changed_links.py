"""What a changed link does: by the changes about it and the instant of sending, nothing else."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.changes import LinkChange, course, links_of
from scenarios.definition.channel.build import link_effects, link_stages
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.definition.schema.change_tables import CutTable, HealTable, LinkChangeTable
from scenarios.definition.schema.link_tables import LinkTable
from tests.made.examples import examples
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import Link, Verdict
from vehicles.schedule import SECOND

NAMES = ("v1", "v2", "v3", "v4")
PERIOD = SECOND // 20
START = 1_790_000_000 * SECOND
PAIR = ("v1", "v3")
BURSTY = LinkTable.model_validate(
    {
        "latency_ms": 30.0,
        "jitter_ms": 40.0,
        "loss_ratio": 0.1,
        "loss": {"kind": "gilbert_elliott", "loss_ratio": 0.2, "burst_messages_mean": 3.0},
    }
)

spans = st.none() | st.integers(1, 40).map(lambda k: k / 8)
ends = st.sampled_from(["*", "v1", "v2", "v3", "lead", "predecessor", "follower"])
qualities = st.fixed_dictionaries(
    {},
    optional={
        "loss_ratio": st.sampled_from([0.0, 0.3, 1.0]),
        "latency_ms": st.sampled_from([0.0, 5.0, 200.0]),
        "jitter_ms": st.sampled_from([0.0, 80.0]),
    },
)


@st.composite
def changes(draw: st.DrawFn) -> LinkChange:
    at_s = draw(st.integers(0, 40)) / 8
    sender, receiver = draw(ends), draw(ends)
    match draw(st.sampled_from(["link", "cut", "heal"])):
        case "link":
            return LinkChangeTable(
                kind="link", at_s=at_s, sender=sender, receiver=receiver, for_s=draw(spans),
                **draw(qualities),
            )  # fmt: skip
        case "cut":
            return CutTable(
                kind="cut", at_s=at_s, sender=sender, receiver=receiver, for_s=draw(spans)
            )
        case _:
            return HealTable(kind="heal", at_s=at_s, sender=sender, receiver=receiver)


def link(done: Sequence[LinkChange], table: LinkTable = BURSTY, seed: int = 1) -> Link:
    """The link of PAIR, from a convoy to which all that was `done`."""
    about = [one for one in done if links_of(one, NAMES, [PAIR])]
    order = sorted(((START + round(one.at_s * SECOND), one) for one in about), key=lambda k: k[0])
    found = course(order, table, lambda table, besides: link_effects(table, 20.0, besides=besides))
    return Link(link_effects(table, 20.0), seed, *PAIR, link_stages(table), found)


def context(seq: int) -> TransmissionContext:
    return TransmissionContext(seq, START + seq * PERIOD, 124)


def now(done: Sequence[LinkChange], seconds: float) -> tuple[LinkTable, bool]:
    """Settings of the link at a time by definition: for each key the last change that holds."""
    about = [one for one in done if links_of(one, NAMES, [PAIR]) and one.at_s <= seconds]
    about.sort(key=lambda one: one.at_s)
    healed = [place for place, one in enumerate(about) if isinstance(one, HealTable)]
    about = about[healed[-1] + 1 :] if healed else about
    holding = [
        one
        for one in about
        if not isinstance(one, HealTable) and (one.for_s is None or seconds < one.at_s + one.for_s)
    ]
    table = BURSTY
    for key in ("loss_ratio", "latency_ms", "jitter_ms"):
        given_ = [getattr(one, key, None) for one in holding]
        if values := [value for value in given_ if value is not None]:
            table = table.model_copy(update={key: values[-1]})
    return table, any(isinstance(one, CutTable) for one in holding)


@given(st.lists(changes(), max_size=8))
@examples(16, 150)
def test_each_instant_has_the_link_of_the_latest_changes(done: list[LinkChange]) -> None:
    changed = link(done)
    for seq in range(0, 120, 3):
        table, is_cut = now(done, seq * PERIOD / SECOND)
        as_asked = Link(link_effects(table, 20.0), 1, *PAIR).judge(context(seq))
        expected = Verdict("dropped", "cut", as_asked.visible_at) if is_cut else as_asked
        assert changed.judge(context(seq)) == expected


@given(st.lists(changes(), max_size=6), st.permutations(range(60)))
@examples(8, 50)
def test_a_message_alone_is_judged_as_in_the_stream(
    done: list[LinkChange], order: list[int]
) -> None:
    stream, shuffled = link(done), link(done)
    in_order = [stream.judge(context(seq)) for seq in range(60)]
    out_of_order = {seq: shuffled.judge(context(seq)) for seq in order}
    assert [out_of_order[seq] for seq in range(60)] == in_order
    assert [link(done).judge(context(seq)) for seq in (0, 17, 59)] == [
        in_order[seq] for seq in (0, 17, 59)
    ]


def test_it_begins_and_ends_to_the_nanosecond() -> None:
    sure = LinkTable(latency_ms=10.0)
    cut = link([CutTable(kind="cut", at_s=1.000_000_001, for_s=0.5)], sure)
    begin = START + 1_000_000_001
    outcomes = [
        cut.judge(TransmissionContext(0, at)).reason
        for at in (begin - 1, begin, begin + SECOND // 2 - 1, begin + SECOND // 2)
    ]
    assert outcomes == ["", "cut", "cut", ""]


def test_a_link_to_a_lead_that_receives_can_be_changed() -> None:
    change = 'change=[{kind="cut", at_s=1.0, sender="v4"}]'
    with pytest.raises(ScenarioError, match="no such link"):
        load_scenario("lane_change", [change])
    assert load_scenario("lane_change", [change, "speed.lead_waits=true"]).tables.change
    assert load_scenario("church_lot", [change]).tables.change


def scenario(text: str) -> None:
    scenario_from_text(f'extends = "lane_change"\nname = "changed"\n{text}')


@pytest.mark.parametrize(
    ("entry", "line"),
    [
        ('kind = "cut"\nsender = "v9"', 'change[0].sender: given "v9", allowed "v1", "v2", "v3", '
         '"v4", "lead", "predecessor", "follower", "*"'),
        ('kind = "heal"\nsender = "v4"', "change[0]: from v4 to *: no such link, allowed "
         "v2 to v1, v3 to v1, v1 to v2, v1 to v3, v2 to v3, v1 to v4, v3 to v4"),
        ('kind = "link"', "change[0]: changes nothing, allowed at least one of loss_ratio, "
         "latency_ms, jitter_ms"),
        ('kind = "link"\nloss_ratio = 2.0', "change[0].loss_ratio: given 2.0, allowed 0 to 1, "
         "did you mean 0.02 (for 2 per cent)?"),
        ('kind = "link"\nloss_percent = 2.0', "change[0].loss_percent: unknown key, did you mean "
         "change[0].loss_ratio = 0.02?"),
        ('kind = "cut"\nfor_s = 0.0', "change[0].for_s: given 0.0, allowed more than 0, at most "
         "86400"),
        ('kind = "sever"', 'change[0].kind: given "sever", allowed "link", "cut", "heal", "gnss", '
         '"stall", "crash", "leave", "join" or "speed"'),
    ],
)  # fmt: skip
def test_an_impossible_change_gets_one_line(entry: str, line: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        scenario(f"[[change]]\nat_s = 1.0\n{entry}\n")
    assert str(refused.value) == f"scenario: {line}"
