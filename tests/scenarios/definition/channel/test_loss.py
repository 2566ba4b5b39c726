"""Laws of loss in a scenario: the law of each table, and invalid values."""

import pytest

from scenarios.definition.channel.build import link_effects
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import scenario_from_text
from tests.made.channels.laws import collisions, four_state, gilbert, gilbert_elliott, long_run
from tests.made.scenarios.messages import STRAIGHT
from transport.links.laws.basic import Decimation, Jitter, Latency, Loss
from transport.links.laws.burst_losses import GilbertElliott
from transport.links.laws.link_law import Effect, TransmissionContext
from transport.links.laws.recorded_losses import (
    EarlierRun,
    EveryNth,
    Listed,
    NumberSet,
    RecordedPattern,
)
from transport.links.laws.shared_channel import Collisions
from transport.links.link import Link, Verdict

ASKED: dict[str, tuple[str, Effect]] = {
    "chances": (
        "{kind='gilbert_elliott', good_to_bad_ratio=0.1, bad_to_good_ratio=0.3}",
        GilbertElliott(good_to_bad_ratio=0.1, bad_to_good_ratio=0.3),
    ),
    "all chances": (
        "{kind='gilbert_elliott', good_to_bad_ratio=0.1, bad_to_good_ratio=0.3, "
        "bad_delivered_ratio=0.2, good_delivered_ratio=0.9}",
        gilbert_elliott(0.1, 0.3, 0.2, 0.9),
    ),
    "mean values": (
        "{kind='gilbert_elliott', loss_ratio=0.2, burst_messages_mean=4}",
        gilbert(0.2, 4.0),
    ),
    "four states": (
        "{kind='four_state', gap_to_burst_ratio=0.1, burst_to_gap_ratio=0.2, "
        "lost_to_sent_ratio=0.3, sent_to_lost_ratio=0.4, isolated_loss_ratio=0.05}",
        four_state(0.1, 0.2, 0.3, 0.4, 0.05),
    ),
    "two of four": (
        "{kind='four_state', gap_to_burst_ratio=0.1, burst_to_gap_ratio=0.2}",
        four_state(0.1, 0.2, 0.0, 1.0, 0.0),
    ),
    "every nth": (
        "{kind='every_nth', every_messages=4, first_number=2}",
        EveryNth(every_messages=4, first_number=2),
    ),
    "listed": (
        "{kind='listed', lost_numbers='7, 3, 10-12'}",
        Listed(lost_numbers="7, 3, 10-12"),
    ),
    "pattern": (
        "{kind='pattern', length_messages=20, lost_numbers='1-2', after_end='pass'}",
        RecordedPattern(length_messages=20, lost_numbers="1-2", after_end="pass"),
    ),
}


def effects(*overrides: str) -> tuple[Effect, ...]:
    scenario = scenario_from_text(STRAIGHT, overrides=overrides)
    assert scenario_from_text(scenario.text).tables == scenario.tables
    return link_effects(scenario.links["v1", "v2"], 20.0)


@pytest.mark.parametrize(("settings", "law"), ASKED.values(), ids=ASKED)
def test_each_kind_is_its_law(settings: str, law: Effect) -> None:
    found, latency = effects(f"links.loss={settings}")
    assert found == law
    assert isinstance(latency, Latency)


def test_laws_act_besides_the_plain_keys() -> None:
    found = effects(
        "links={rate_hz=10.0, loss_ratio=0.1, jitter_ms=5.0, "
        "loss={kind='every_nth', every_messages=3}, collisions={loss_ratio=0.2, keep_ratio=0.4}}"
    )
    kinds = [Decimation, Loss, EveryNth, Collisions, Latency, Jitter]
    assert [type(one) for one in found] == kinds
    assert found[3] == collisions(0.2, 0.4, 5, 15)
    for one in found:
        assert long_run(one)[0] == {Loss: 0.1, EveryNth: 1 / 3, Collisions: 0.2}.get(type(one), 0.0)


def test_no_law_moves_the_draws_of_another() -> None:
    """What each loses alone it loses beside the others; delays stay as they were."""
    plain = "links={loss_ratio=0.2, jitter_ms=40.0"
    burst = ", loss={kind='gilbert_elliott', loss_ratio=0.2, burst_messages_mean=4.0}"
    collisions = ", collisions={loss_ratio=0.3, keep_ratio=0.4}"

    def judged(settings: str) -> list[Verdict]:
        link = Link(effects(settings + "}"), 1, "v1", "v2")
        return [link.judge(TransmissionContext(seq, 0)) for seq in range(500)]

    alone = [judged(plain + law) for law in ("", burst, collisions)]
    together = judged(plain + burst + collisions)
    for seq, verdict in enumerate(together):
        reasons = [one[seq].reason for one in alone]
        first = next((reason for reason in reasons if reason), "")
        assert verdict.reason == first
        assert {one[seq].visible_at for one in alone} == {verdict.visible_at}
    assert {verdict.reason for verdict in together} == {"", "loss", "burst", "collision"}


def test_an_earlier_run_takes_the_place_of_all_else() -> None:
    record = "{kind='log', delays_ns='5x2, 7', dropped_numbers={loss='1', wormhole='2'}}"
    law, delay = effects(f"links={{loss_ratio=0.5, jitter_ms=3.0, latency_ms=9.0, loss={record}}}")
    assert isinstance(law, EarlierRun)
    assert law.dropped == (("loss", NumberSet(((1, 1),))), ("pattern", NumberSet(((2, 2),))))
    assert (law.delays_in_order, law.length) == (((5, 2), (7, 1)), 3)
    assert delay == law.recorded_delay(9_000_000)


def test_entries_inherit_within_a_kind_and_replace_another() -> None:
    law = "{kind='gilbert_elliott', loss_ratio=0.2, burst_messages_mean=4.0}"
    entries = (
        "{sender='*', receiver='v2', loss={kind='gilbert_elliott', loss_ratio=0.1}}",
        "{sender='*', receiver='v3', loss={kind='every_nth', every_messages=9}}",
        "{sender='v3', receiver='v4', loss={kind='none'}, collisions={keep_ratio=0.8}}",
    )
    scenario = scenario_from_text(
        STRAIGHT,
        overrides=[
            f"links.loss={law}", "links.collisions.loss_ratio=0.05", f"link=[{','.join(entries)}]",
        ],
    )  # fmt: skip
    found = {pair: link_effects(table, 20.0)[:-1] for pair, table in scenario.links.items()}
    assert found["v1", "v2"] == (gilbert(0.1, 4.0), collisions(0.05))
    assert found["v1", "v3"] == found["v2", "v3"] == (EveryNth(every_messages=9), collisions(0.05))
    assert found["v1", "v4"] == (gilbert(0.2, 4.0), collisions(0.05))
    assert found["v3", "v4"] == (collisions(0.05, 0.8),)


GILBERT = "links.loss={kind='gilbert_elliott', "
FOUR = "links.loss={kind='four_state', gap_to_burst_ratio=0.3, burst_to_gap_ratio=0.6, "
LOG = "links.loss={kind='log', "
REFUSED = {
    "unknown kind": ("links.loss={kind='gilbert'}", "links.loss.kind", '"gilbert"', '"four_state"'),
    "no kind": ("links.loss.loss_ratio=0.1", "links.loss.kind", "missing", '"gilbert_elliott"'),
    "no table": ("links.loss=0.1", "links.loss", "given 0.1", "a table"),
    "key of another kind": (
        "links.loss={kind='every_nth', loss_ratio=0.1}",
        "links.loss.loss_ratio",
        "unknown key",
        '"gilbert_elliott"',
    ),
    "misspelt": (
        f"{GILBERT}good_to_bad=0.1}}",
        "links.loss.good_to_bad",
        "unknown key",
        "links.loss.good_to_bad_ratio?",
    ),
    "per cent": (f"{GILBERT}loss_ratio=20}}", "links.loss.loss_ratio", "given 20", "0 to 1"),
    "nothing more": (
        "links.loss.kind='gilbert_elliott'",
        "links.loss.good_to_bad_ratio",
        "missing",
        "",
    ),
    "loss alone": (
        f"{GILBERT}loss_ratio=0.2}}",
        "links.loss.burst_messages_mean",
        "missing",
        "",
    ),
    "both forms": (
        f"{GILBERT}loss_ratio=0.2, bad_to_good_ratio=0.3}}",
        "links.loss.bad_to_good_ratio",
        "together with loss_ratio",
        "mean values",
    ),
    "bursts too short": (
        f"{GILBERT}loss_ratio=0.8, burst_messages_mean=3.0}}",
        "links.loss.burst_messages_mean",
        "given 3 with a loss of 0.8",
        "at least 4",
    ),
    "all lost in bursts": (
        f"{GILBERT}loss_ratio=1.0, burst_messages_mean=3.0}}",
        "links.loss.burst_messages_mean",
        "a loss of 1",
        "below 1",
    ),
    "in turn": (
        f"{GILBERT}good_to_bad_ratio=1.0, bad_to_good_ratio=1.0}}",
        "links.loss.bad_to_good_ratio",
        "given 1, 1",
        "aperiodic",
    ),
    "for ever": (
        f"{GILBERT}good_to_bad_ratio=1e-6, bad_to_good_ratio=1e-6}}",
        "links.loss.bad_to_good_ratio",
        "given 1e-06, 1e-06",
        "10000 messages",
    ),
    "out of the gap": (
        f"{FOUR}isolated_loss_ratio=0.8}}",
        "links.loss.isolated_loss_ratio",
        "given 0.8",
        "at most 0.7, because gap_to_burst_ratio is 0.3",
    ),
    "out of the burst": (
        f"{FOUR}lost_to_sent_ratio=0.5}}",
        "links.loss.lost_to_sent_ratio",
        "given 0.5",
        "at most 0.4",
    ),
    "half of the four states": (
        "links.loss={kind='four_state', gap_to_burst_ratio=0.1}",
        "links.loss.burst_to_gap_ratio",
        "missing",
        "",
    ),
    "every none": (
        "links.loss={kind='every_nth', every_messages=0}",
        "links.loss.every_messages",
        "given 0",
        "1 to 1000000000",
    ),
    "list of nothing": ("links.loss={kind='listed'}", "links.loss.lost_numbers", "missing", ""),
    "list of words": (
        "links.loss={kind='listed', lost_numbers='1, two'}",
        "links.loss.lost_numbers",
        'given "two"',
        '"3, 7, 10-20"',
    ),
    "range that goes back": (
        "links.loss={kind='listed', lost_numbers='9-3'}",
        "links.loss.lost_numbers",
        'given "9-3"',
        "a range",
    ),
    "no pattern": (
        "links.loss={kind='pattern'}",
        "links.loss.length_messages",
        "missing",
        "without file",
    ),
    "beyond the pattern": (
        "links.loss={kind='pattern', length_messages=5, lost_numbers='3-5'}",
        "links.loss.lost_numbers",
        "given 5",
        "below length_messages, 5",
    ),
    "pattern twice": (
        "links.loss={kind='pattern', file='a.csv', length_messages=5}",
        "links.loss.file",
        "together with length_messages",
        "or its contents",
    ),
    "after the end": (
        "links.loss={kind='pattern', file='a.csv', after_end='stop'}",
        "links.loss.after_end",
        '"stop"',
        '"repeat" or "pass"',
    ),
    "pattern that is not there": (
        "links.loss={kind='pattern', file='missing.csv'}",
        "links.loss.file",
        "missing.csv",
        "no such file",
    ),
    "log that is not there": (
        f"{LOG}file='missing.mcap'}}",
        "links.loss.file",
        "missing.mcap",
        "no such file",
    ),
    "no log": (f"{LOG}sender='v1'}}", "links.loss.delays_ns", "missing", "without file"),
    "delays of words": (
        f"{LOG}delays_ns='5x2, soon'}}",
        "links.loss.delays_ns",
        'given " soon"',
        '"20000000x700, 23000000"',
    ),
    "dropped words": (
        f"{LOG}delays_ns='5x2', dropped_numbers={{loss='x'}}}}",
        "links.loss.dropped_numbers.loss",
        'given "x"',
        "numbers and ranges",
    ),
    "collisions of how many": (
        "links.collisions.keep_ratio=0.4",
        "links.collisions.loss_ratio",
        "missing",
        "",
    ),
    "kept for ever": (
        "links.collisions={loss_ratio=0.1, keep_ratio=1.0}",
        "links.collisions.keep_ratio",
        "given 1.0",
        "0 to 0.99",
    ),
    "reservations upside down": (
        "links.collisions={loss_ratio=0.1, reselection_messages_min=9, reselection_messages_max=4}",
        "links.collisions.reselection_messages_max",
        "given 4",
        "at least reselection_messages_min, 9",
    ),
    "in an entry": (
        "link=[{sender='v1', receiver='*', rate_hz=5.0}, "
        "{sender='*', receiver='v3', loss={kind='listed'}}]",
        "link[1].loss.lost_numbers",
        "missing",
        "",
    ),
}


@pytest.mark.parametrize(("change", "key", "given", "allowed"), REFUSED.values(), ids=REFUSED)
def test_an_invalid_value_gets_one_line(change: str, key: str, given: str, allowed: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(STRAIGHT, label="a.toml", overrides=[change])
    line = next(line for line in caught.value.lines if f" {key}: " in line)
    assert line.startswith((f"--set: {key}: ", f"a.toml: {key}: "))
    assert given in line
    assert allowed in line
    assert line.isprintable()
    assert line.count(f"{key}: ") == 1
    assert len(line) < 250
