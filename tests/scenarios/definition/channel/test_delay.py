"""From the keys of a scenario to delays, queue and order; recorded delays are read once."""

from math import inf
from pathlib import Path

import pytest
from scipy.stats import gamma, truncnorm

from scenarios.definition.channel.build import link_effects, link_stages
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.link_tables import LinkTable
from tests.made.scenarios.messages import STRAIGHT
from tests.made.transport.links import link
from transport.links.laws.basic import Queue
from transport.links.laws.delays import (
    ConstantDelay,
    EmpiricalDelay,
    GammaDelay,
    LognormalDelay,
    NormalDelay,
    RandomDelay,
    UniformDelay,
)
from transport.links.laws.link_law import Effect, InOrder, TransmissionContext

MS = 1_000_000
TWO = {"mean_ms": 20.0, "deviation_ms": 10.0}


def last_effect(delay: dict[str, object]) -> Effect:
    return link_effects(LinkTable.model_validate({"delay": delay}), 20.0)[-1]


@pytest.mark.parametrize(
    ("given", "law", "median_ms"),
    [
        ({"kind": "uniform", "delay_ms_max": 30.0}, UniformDelay, 15.0),
        ({"kind": "normal", **TWO}, NormalDelay, truncnorm(-2.0, inf, 20.0, 10.0).median()),
        (
            {"kind": "normal", **TWO, "delay_ms_max": 45.0},
            NormalDelay,
            truncnorm(-2.0, 2.5, 20.0, 10.0).median(),
        ),
        ({"kind": "lognormal", **TWO}, LognormalDelay, 20.0 / 1.25**0.5),
        ({"kind": "gamma", **TWO}, GammaDelay, gamma(4.0, scale=5.0).median()),
        ({"kind": "empirical", "recorded_ms": [3.0, 1.0]}, EmpiricalDelay, 3.0),
    ],
)
def test_each_kind_is_its_law(
    given: dict[str, object], law: type[RandomDelay], median_ms: float
) -> None:
    effect = last_effect(given | {"correlation_ratio": 0.25})
    assert isinstance(effect, law)
    assert effect.correlation_ratio == 0.25
    assert effect.at(0.0) == pytest.approx(median_ms * MS, rel=1e-4)
    constant = last_effect({"kind": "constant", "delay_ms": 1.5})
    assert constant == ConstantDelay(delay_ms=1.5)
    assert constant.judge(lambda *_: 0.5, TransmissionContext(0, 0)) == 1_500_000


def test_the_floor_stays_below_the_law_and_the_other_delays_add_up() -> None:
    law = {"kind": "gamma", "mean_ms": 5.0, "deviation_ms": 5.0}
    plain = link(LinkTable(latency_ms=20.0, jitter_ms=10.0))
    more = link(LinkTable.model_validate({"latency_ms": 20.0, "jitter_ms": 10.0, "delay": law}))
    extra = [
        more.judge(TransmissionContext(k, 0)).visible_at
        - plain.judge(TransmissionContext(k, 0)).visible_at
        for k in range(400)
    ]
    assert min(extra) >= 0
    assert sum(extra) / len(extra) == pytest.approx(5.0 * MS, rel=0.2)


def test_queue_and_order_stand_behind_the_effects() -> None:
    delay = {"kind": "constant", "delay_ms": 0.0, "order": "in_order"}
    queue = {"bytes_per_s": 4000.0, "depth_messages": 3, "drop": "oldest"}
    link = LinkTable.model_validate({"delay": delay, "queue": queue})
    assert link_stages(link) == (Queue.model_validate(queue), InOrder())
    assert link_stages(LinkTable.model_validate({"queue": {"bytes_per_s": 4000.0}})) == (
        Queue(bytes_per_s=4000.0, depth_messages=10, drop="newest"),
    )
    assert link_stages(LinkTable()) == ()


def test_an_entry_changes_one_key_of_a_law_and_replaces_one_of_another_kind() -> None:
    scenario = scenario_from_text(
        STRAIGHT
        + '[links.delay]\nkind = "gamma"\nmean_ms = 20.0\ndeviation_ms = 10.0\norder = "in_order"\n'
        + '[[link]]\nsender = "v1"\nreceiver = "v2"\n'
        + 'delay = { kind = "gamma", mean_ms = 8.0, deviation_ms = 4.0 }\n'
        + '[[link]]\nsender = "v1"\nreceiver = "v3"\n'
        + 'delay = { kind = "constant", delay_ms = 2.0 }\n'
    )
    same, other = scenario.links["v1", "v2"].delay, scenario.links["v1", "v3"].delay
    assert same is not None
    assert same.model_dump() == {
        "kind": "gamma", "mean_ms": 8.0, "deviation_ms": 4.0, "order": "in_order",
        "correlation_ratio": 0.0,
    }  # fmt: skip
    assert other is not None
    assert other.model_dump() == {"kind": "constant", "delay_ms": 2.0, "order": "free"}


def with_files(folder: Path) -> Scenario:
    (folder / "here.csv").write_text("t_s,delay_ms\n0,5.5\n1,3.0\n\n2, 20\n", encoding="utf-8")
    (folder / "there.csv").write_text("delay_ms\n7\n", encoding="utf-8")
    return scenario_from_text(
        STRAIGHT
        + '[links.delay]\nkind = "empirical"\nfile = "here.csv"\n'
        + '[[link]]\nsender = "v1"\nreceiver = "v3"\n'
        + 'delay = { kind = "empirical", file = "there.csv" }\n',
        folder=folder,
    )


def test_recorded_delays_are_in_the_scenario_that_depends_on_no_file_any_more(
    tmp_path: Path,
) -> None:
    scenario = with_files(tmp_path)
    for name in ("here.csv", "there.csv"):
        (tmp_path / name).unlink()
    again = scenario_from_text(scenario.text)
    for one in (scenario, again):
        found = {pair: link.delay and link.delay.model_dump() for pair, link in one.links.items()}
        assert found["v1", "v2"] == {
            "kind": "empirical", "source": "here.csv", "recorded_ms": (3.0, 5.5, 20.0),
            "file": None, "order": "free", "correlation_ratio": 0.0,
        }  # fmt: skip
        assert (found["v1", "v3"] or {})["recorded_ms"] == (7.0,)
    assert again.text == scenario.text
