"""Shipped channels: valid, with a source; one word in a scenario, overridden key by key."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from scenarios.cli.summary_tables import print_summary
from scenarios.definition.channel import presets as presets_module
from scenarios.definition.channel.presets import presets, read_preset
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, library, load_scenario, scenario_from_text
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.summary import from_json
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.scenarios.messages import STRAIGHT
from transport.links.laws.radio import LossPerVehicle, PathLossRadio

SHIPPED = {
    "clear", "lossy", "bursty", "tunnel", "lead_lost", "congested",
    "ieee80211p_light", "ieee80211p_dense", "ieee80211p_jam",
    "lte_v2x_light", "lte_v2x_dense", "lte_v2x_oneshot",
    "nlosv_etsi", "nlosv_3gpp_car", "nlosv_3gpp_truck",
}  # fmt: skip
NEEDED = {"bursty": "loss", "tunnel": "outages", "lead_lost": "outages", "congested": "delay"}
"""Laws that presets need, where a link may not know them yet."""
KNOWN = [
    pytest.param(
        name,
        marks=pytest.mark.skipif(
            NEEDED.get(name, "radio") not in LinkTable.model_fields, reason="its law is not there"
        ),
    )
    for name in sorted(SHIPPED)
]


def with_links(links: str, *overrides: str) -> Scenario:
    return scenario_from_text(f"{STRAIGHT}\n{links}", overrides=overrides)


def test_those_that_ship_are_the_promised_ones_and_no_scenarios() -> None:
    assert set(presets()) == SHIPPED
    assert not SHIPPED & set(library())


@pytest.mark.parametrize("name", sorted(SHIPPED))
def test_each_preset_has_a_description_and_a_source(name: str) -> None:
    preset = read_preset(name)
    assert 10 < len(preset.description) < 90
    assert len(preset.source) > 20
    assert preset.links or preset.entries or name == "clear"


@pytest.mark.parametrize("name", KNOWN)
def test_one_word_is_a_whole_channel(name: str) -> None:
    scenario = load_scenario("lossy_lane_change", [f"links.preset={name}"])
    links = scenario.tables.links
    assert (links.preset, links.preset_source) == (name, read_preset(name).source)
    assert links.jitter_ms == 0.0  # not the file's
    assert name in scenario.title
    expected = LinkTable.model_validate(read_preset(name).links)
    whole = links.model_dump(exclude={"preset", "preset_source"})
    assert whole == expected.model_dump(exclude={"preset", "preset_source"})
    if name == "lead_lost":  # as seen by links of the lead and by others
        lead, other = scenario.links["v1", "v3"], scenario.links["v2", "v3"]
        assert not lead.is_lossless
        assert other.is_lossless
    else:
        assert links.is_lossless == (name == "clear")


@pytest.mark.parametrize("name", KNOWN)
def test_a_log_repeats_a_run_though_no_preset_ships_any_more(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = load_scenario("lane_change", [f"links.preset={name}", "links.latency_ms=33.0"])
    monkeypatch.setattr(presets_module, "PRESETS", tmp_path)
    assert presets() == ()
    again = scenario_from_text(scenario.text)
    assert again.links == scenario.links
    assert again.text == scenario.text
    assert again.title == scenario.title


def test_what_stands_beside_a_preset_overrides_it_key_by_key() -> None:
    links = with_links(
        '[links]\npreset = "nlosv_etsi"\nlatency_ms = 50.0\n'
        "[links.radio]\npower_dbm = 10.0\n[links.radio.obstruction]\nloss_db = 3.0\n"
    ).tables.links
    assert isinstance(links.radio, PathLossRadio)
    assert isinstance(links.radio.obstruction, LossPerVehicle)
    assert (links.latency_ms, links.radio.power_dbm, links.radio.noise_figure_db) == (50, 10, 9)
    assert (links.radio.obstruction.loss_db, links.radio.obstruction.radius_m) == (3.0, 1.5)
    assert links.radio.shadowing is not None
    assert links.radio.shadowing.obstructed_deviation_db == 3.0


def test_an_entry_with_a_preset_takes_nothing_from_the_convoy() -> None:
    scenario = with_links(
        '[links]\npreset = "ieee80211p_jam"\nlatency_ms = 70.0\n'
        '[[link]]\nsender = "lead"\nreceiver = "*"\npreset = "lossy"\njitter_ms = 5.0\n'
        '[[link]]\nsender = "v1"\nreceiver = "v4"\nloss_ratio = 0.7\n'
    )
    assert scenario.links["v1", "v3"].model_dump(exclude={"preset_source"}) == LinkTable(
        preset="lossy", loss_ratio=0.2, jitter_ms=5.0
    ).model_dump(exclude={"preset_source"})
    assert scenario.links["v1", "v4"].loss_ratio == 0.7
    assert scenario.links["v1", "v4"].jitter_ms == 5.0
    assert scenario.links["v2", "v3"].preset == "ieee80211p_jam"
    assert scenario.links["v2", "v3"].latency_ms == 70.0
    assert (
        "ieee80211p_jam and lossy" in scenario.title or "lossy and ieee80211p_jam" in scenario.title
    )


@pytest.mark.parametrize(
    ("links", "key"),
    [
        ('[links]\npreset = "jam"\n', "links.preset"),
        ('[[link]]\nsender = "v1"\nreceiver = "*"\npreset = "jam"\n', r"link\[0\].preset"),
    ],
)
def test_an_unknown_preset_is_refused_with_the_names(links: str, key: str) -> None:
    with pytest.raises(ScenarioError, match=f"scenario: {key}: given .*, allowed bursty") as no:
        with_links(links)
    (line,) = no.value.lines
    assert all(name in line for name in SHIPPED)
    assert "preset_source" not in line


RUNS = ("nlosv_etsi", "nlosv_3gpp_truck", "lte_v2x_dense", "ieee80211p_jam")


@pytest.mark.spread(2)
@pytest.mark.parametrize("name", RUNS)
def test_a_run_with_a_preset_repeats_and_names_it(name: str, tmp_path: Path) -> None:
    overrides = [f"links.preset={name}", "duration_s=1.5", "convoy.vehicles=6"]
    scenario = load_scenario("lane_change", overrides)
    for run in ("first", "again"):
        run_virtual(scenario, tmp_path / run, Stop())
    logs = [(tmp_path / run / LOG_NAME).read_bytes() for run in ("first", "again")]
    assert logs[0] == logs[1]
    summary = from_json((tmp_path / "first" / SUMMARY_NAME).read_text(encoding="utf-8"))
    assert {link.requested.preset for link in summary.links} == {name}
    far = next(link for link in summary.links if (link.sender, link.receiver) == ("v1", "v6"))
    if name in {"nlosv_etsi", "ieee80211p_jam"}:
        assert far.dropped["range"] > 0
    assert set().union(*(link.dropped for link in summary.links)) <= {"range"}
    out = io.StringIO()
    print_summary(summary, None, Console(file=out, width=120))
    assert f"v1 → v2, {name}" in out.getvalue()
