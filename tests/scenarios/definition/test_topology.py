"""The vehicles that each vehicle receives from, and the settings of each link."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.channel.build import link_effects
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.topology import directed_links, senders_to
from transport.links.laws.basic import Decimation, Jitter, Latency, Loss

RATE_HZ = 20.0


@given(st.lists(st.text("abcdef", min_size=1), min_size=1, max_size=8, unique=True))
def test_followers_listen_to_the_lead_and_to_the_vehicle_ahead(names: list[str]) -> None:
    found = directed_links(names)
    assert len(set(found)) == len(found)
    expected = {(names[0], follower) for follower in names[1:]} | set(itertools.pairwise(names))
    assert set(found) == expected
    assert senders_to(names, names[0]) == ()
    assert all(senders_to(names, name)[-1] == ahead for ahead, name in itertools.pairwise(names))


@given(st.lists(st.text("abcdef", min_size=1), min_size=2, max_size=8, unique=True))
def test_a_lead_that_waits_listens_to_all_others(names: list[str]) -> None:
    found, usual = directed_links(names, lead_receives=True), directed_links(names)
    assert set(found) == {*usual, *((follower, names[0]) for follower in names[1:])}
    assert len(found) == len(usual) + len(names) - 1
    assert senders_to(names, names[-1], lead_receives=True) == senders_to(names, names[-1])


def test_an_entry_about_a_link_to_the_lead_counts_only_where_it_waits() -> None:
    entry = 'link=[{sender="v3", receiver="lead", loss_ratio=0.5}]'
    with pytest.raises(ScenarioError, match="no such link"):
        load_scenario("lane_change", [entry])
    links = load_scenario("lane_change", [entry, "speed.lead_waits=true"]).links
    assert links["v3", "v1"].loss_ratio == 0.5
    assert links["v2", "v1"].loss_ratio == 0.0


QUARTER = "{length_m=20}, {length_m=15.708, radius_m=10, turn='left'}"


@pytest.mark.parametrize(
    ("name", "overrides", "receives"),
    [
        ("church_lot", (), True),
        ("church_lot", ("path.laps=1",), True),
        ("church_lot", ("speed.lead_keeps_gap=false",), False),
        ("church_lot", ("path.closed=false", "path.laps=1"), False),
        ("lane_change", (), False),
        ("lane_change", ("speed.lead_keeps_gap=true",), True),
        ("paper_field", (), False),
        ("lane_change", (f"path={{kind='segments', laps=4, segments=[{QUARTER}]}}",), True),
        ("lane_change", (f"path={{kind='segments', laps=3, segments=[{QUARTER}]}}",), False),
    ],
)
def test_the_lead_of_a_closed_path_receives_its_followers(
    name: str, overrides: tuple[str, ...], receives: bool
) -> None:
    if "path=" in "".join(overrides):
        overrides = (*overrides, "duration_s=5", "speed.set_mps=5")
    scenario = load_scenario(name, overrides)
    lead, follower = scenario.vehicle_names[0], scenario.vehicle_names[-1]
    assert ((follower, lead) in scenario.links) == receives
    assert scenario_from_text(scenario.text).tables == scenario.tables


def test_the_lead_of_an_earlier_log_received_nobody() -> None:
    scenario = load_scenario("church_lot")
    text = scenario.text.replace("lead_keeps_gap = true\n", "")
    assert text != scenario.text
    earlier = scenario_from_text(text, recorded=True)
    assert (
        senders_to(earlier.vehicle_names, "v1", lead_receives=earlier.tables.speed.lead_receives)
        == ()
    )


ENTRIES = (
    'link=[{sender="*", receiver="v3", loss_ratio=0.1, jitter_ms=5.0},'
    '{sender="v1", receiver="*", latency_ms=70.0},{sender="v1", receiver="v3", loss_ratio=0.5}]'
)


def test_the_more_specific_entry_wins_key_by_key() -> None:
    links = load_scenario("lane_change", ["convoy.vehicles=3", "links.rate_hz=7.0", ENTRIES]).links
    assert links == {
        ("v1", "v2"): LinkTable(latency_ms=70.0, rate_hz=7.0),
        ("v1", "v3"): LinkTable(latency_ms=70.0, jitter_ms=5.0, loss_ratio=0.5, rate_hz=7.0),
        ("v2", "v3"): LinkTable(jitter_ms=5.0, loss_ratio=0.1, rate_hz=7.0),
    }


def test_each_key_becomes_its_effect() -> None:
    table = LinkTable(latency_ms=12.5, jitter_ms=30.0, loss_ratio=0.25, rate_hz=5.0)
    rate, loss, latency, jitter = link_effects(table, RATE_HZ)
    assert isinstance(rate, Decimation)
    assert rate.kept == 1 / 4
    assert (loss, latency, jitter) == (Loss(0.25), Latency(12_500_000), Jitter(30_000_000))


def test_a_link_has_no_effects_that_are_not_configured() -> None:
    assert len(link_effects(LinkTable(), RATE_HZ)) == 1
    assert len(link_effects(LinkTable(jitter_ms=1, loss_ratio=0.1, rate_hz=5), RATE_HZ)) == 4


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("latency_ms", -1.0),
        ("latency_ms", float("nan")),
        ("latency_ms", float("inf")),
        ("jitter_ms", -0.1),
        ("loss_ratio", 1.1),
        ("loss_ratio", -0.1),
        ("loss_ratio", float("nan")),
        ("rate_hz", 0.0),
        ("latency_ms", 60_001.0),
        ("rate_hz", float("inf")),
    ],
)
def test_impossible_rules_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        LinkTable.model_validate({name: value})
