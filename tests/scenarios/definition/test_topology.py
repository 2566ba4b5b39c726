"""The vehicles that each vehicle receives from, and the settings of each link."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.channel.build import link_effects
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.topology import directed_links, usual_links
from transport.links.laws.basic import Decimation, Jitter, Latency, Loss

RATE_HZ = 20.0


def test_an_entry_about_a_link_to_the_lead_counts_only_where_it_waits() -> None:
    entry = 'link=[{sender="v4", receiver="lead", loss_ratio=0.5}]'
    with pytest.raises(ScenarioError, match="no such link"):
        load_scenario("lane_change", [entry])
    links = load_scenario("lane_change", [entry, "speed.lead_waits=true"]).links
    assert links["v4", "v1"].loss_ratio == 0.5
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


def test_each_key_becomes_its_effect() -> None:
    table = LinkTable(latency_ms=12.5, jitter_ms=30.0, loss_ratio=0.25, rate_hz=5.0)
    rate, loss, latency, jitter = link_effects(table, RATE_HZ)
    assert isinstance(rate, Decimation)
    assert rate.kept == 1 / 4
    assert (loss, latency, jitter) == (Loss(0.25), Latency(12_500_000), Jitter(30_000_000))


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


FLOWS = {
    "predecessor": {("v1", "v2"), ("v2", "v3"), ("v3", "v4")},
    "lead": {("v1", "v2"), ("v1", "v3"), ("v1", "v4")},
    "lead_and_predecessor": {*usual_links(("v1", "v2", "v3", "v4"))},
    "bidirectional": {("v1", "v2"), ("v2", "v3"), ("v3", "v4"), ("v3", "v2"), ("v4", "v3")},
    "all_ahead": {*usual_links(("v1", "v2", "v3", "v4")), ("v2", "v4")},
    "{ahead=2}": {("v1", "v2"), ("v1", "v3"), ("v2", "v3"), ("v2", "v4"), ("v3", "v4")},
    "{behind=1,lead=true}": {
        *(("v1", "v2"), ("v1", "v3"), ("v1", "v4"), ("v3", "v2"), ("v4", "v3"))
    },
}  # fmt: skip
NO_GUARD = ("control.degradation.reaction=extrapolate", "information_flow.lateral=predecessor")


@pytest.mark.parametrize("flow", FLOWS)
def test_each_flow_has_its_links_beside_those_of_the_other_direction(flow: str) -> None:
    scenario = load_scenario("lane_change", (*NO_GUARD, f"information_flow.longitudinal={flow}"))
    assert set(scenario.links) == FLOWS[flow] | FLOWS["predecessor"]
    assert scenario_from_text(scenario.text).links == scenario.links


def test_a_list_of_vehicles_and_the_sources_of_one_vehicle() -> None:
    scenario = load_scenario(
        "lane_change",
        (
            "information_flow.longitudinal=predecessor",
            'vehicle.v4.information_flow={lateral=["v1","v2"]}',
        ),
    )
    flow = scenario.vehicle("v4").flow
    assert (flow.lateral, flow.longitudinal) == (("v1", "v2"), ("v3",))
    assert scenario.vehicle("v4").senders == ("v1", "v2", "v3")
    assert scenario.vehicle("v3").flow.lateral == ("v1", "v2")


near = st.fixed_dictionaries(
    {"ahead": st.integers(0, 4), "behind": st.integers(0, 4), "lead": st.booleans()}
)


@given(
    vehicles=st.integers(1, 6),
    flows=st.fixed_dictionaries({"lateral": near, "longitudinal": near}),
    own=st.dictionaries(st.sampled_from(["v2", "v3", "v5"]), near),
    lead_receives=st.booleans(),
)
def test_links_are_the_union_of_both_directions(
    vehicles: int,
    flows: dict[str, dict[str, int]],
    own: dict[str, dict[str, int]],
    lead_receives: bool,
) -> None:
    """Independently by distance in the convoy, with the sources of some vehicles replaced."""
    tables = ScenarioTables.model_validate(
        {
            "name": "any",
            "path": {"kind": "segments", "segments": [{"length_m": 1.0}]},
            "convoy": {"vehicles": vehicles},
            "speed": {"lead_waits": lead_receives},
            "information_flow": flows,
            "vehicle": {
                name: {"information_flow": {"longitudinal": one}} for name, one in own.items()
            },
        }
    )

    def uses(receiver: int, sender: int) -> bool:
        if receiver == 1:
            return lead_receives or sender < vehicles  # it repeats their announced stops
        rows = [flows["lateral"], own.get(f"v{receiver}", flows["longitudinal"])]
        return any(
            -row["behind"] <= receiver - sender <= row["ahead"] or (row["lead"] and sender == 1)
            for row in rows
        )

    places = range(1, vehicles + 1)
    expected = [
        (f"v{sender}", f"v{receiver}")
        for receiver in places
        for sender in places
        if sender != receiver and uses(receiver, sender)
    ]
    assert list(directed_links(tables)) == expected


GAP = ("speed.followers=gap", "control.degradation.reaction=extrapolate")


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        (("information_flow.lateral=all",), ('"all"', "v2", "behind")),
        (("information_flow.lateral=bidirectional",), ("bidirectional", "behind")),
        (("information_flow.lateral={ahead=1,behind=1}",), ("behind",)),
        (('vehicle.v3.information_flow.lateral=["v4"]',), ("vehicle.v3", '"v4"', "v3", "behind")),
        (('vehicle.v3.information_flow.lateral=["v9"]',), ("vehicle.v3", '"v9"', "v1, v2, v3, v4")),
        (('vehicle.v3.information_flow.lateral=["v3"]',), ("vehicle.v3", '"v3"', "itself")),
        (("information_flow.lateral={}",), ("lateral", "v2", "at least one")),
        (("information_flow.longitudinal=leed",), ('"leed"', "mean lead?", "{ ahead = 2 }")),
        (("information_flow.longitudinal=3",), ("3", "lead_and_predecessor")),
        (("information_flow.longitudinal={ahead=-1}",), ("longitudinal.ahead", "-1", "0 to 200")),
        (("information_flow.longitudinal={before=1}",), ("longitudinal.before", "unknown key")),
        (("vehicle.v1.information_flow.lateral=lead",), ("vehicle.v1", "lead")),
        (
            ("information_flow.lateral=lead", "information_flow.longitudinal=lead"),
            ("v3", "v2", "degrade", "extrapolate"),
        ),
        ((*GAP, "information_flow.longitudinal=lead"), ("v2", "v3", '"gap"', '"consensus"')),
        (
            (*GAP, "information_flow.longitudinal=lead", "control.longitudinal=ploeg"),
            ("v3", '"ploeg"'),
        ),
        (
            ("information_flow.lateral=predecessor", "information_flow.longitudinal=predecessor",
             "link=[{sender='v1', receiver='v3'}]"),
            ("link[0]", "from v1 to v3", "no such link", "v3 receives from v2"),
        ),
        (
            ("limits.modes=[{vehicle='v3', mode='intermediate', after_s=1, within_s=1}]",),
            ("intermediate", "v1, v2", '"composite"'),
        ),
    ],
)  # fmt: skip
def test_wrong_sources_get_one_line(overrides: tuple[str, ...], parts: tuple[str, ...]) -> None:
    with pytest.raises(ScenarioError) as refused:
        load_scenario("lane_change", overrides)
    (line,) = str(refused.value).splitlines()
    for part in parts:
        assert part in line
