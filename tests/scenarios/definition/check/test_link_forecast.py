"""Rules, laws and expected figures of each link."""

import pytest

from scenarios.definition.channel.presets import presets, read_preset
from scenarios.definition.check.link_forecast import (
    LinkForecast,
    laws_in_brief,
    link_forecast,
    link_forecasts,
)
from scenarios.definition.scenario import Scenario, library, load_scenario


def scenario(*settings: str) -> Scenario:
    return load_scenario("lane_change", settings)


def link(sender: str, receiver: str, *settings: str) -> LinkForecast:
    return link_forecast(scenario(*settings), (sender, receiver))


def words(forecast: LinkForecast) -> dict[str, str]:
    return {law.words: law.key for law in forecast.laws}


def test_without_entries_the_convoy_s_values_apply() -> None:
    forecast = link("v1", "v3", "links.loss_ratio=0.2")
    assert forecast.rules == ("links",)
    assert words(forecast) == {
        "independent loss 0.2": "links.loss_ratio = 0.2",
        "latency 20 ms": "links.latency_ms = 20",
    }
    assert (forecast.preset, forecast.preset_source) == (None, None)
    assert forecast.age_ms_mean == pytest.approx(20.0 + 50.0 * (1.0 / 0.8 - 0.5) - 5.0)


ENTRIES = (
    'link=[{sender="v1",receiver="v3",loss_ratio=0.1},{sender="lead",receiver="*",jitter_ms=8.0},'
    '{sender="predecessor",receiver="v4",preset="bursty"}]'
)


def test_the_most_specific_rule_is_named_first_and_each_law_s_own() -> None:
    forecast = link("v1", "v3", ENTRIES)
    assert forecast.rules == ("link[0] (v1 → v3)", "link[1] (lead → *)", "links")
    assert words(forecast) == {
        "independent loss 0.1": "link[0].loss_ratio = 0.1 (v1 → v3)",
        "latency 20 ms": "links.latency_ms = 20",
        "jitter up to 8 ms, uniform": "link[1].jitter_ms = 8 (lead → *)",
    }
    assert forecast.latency_ms_mean == pytest.approx(24.0)


def test_a_preset_of_one_link_takes_nothing_from_the_convoy() -> None:
    forecast = link("v3", "v4", ENTRIES, "links.jitter_ms=3.0")
    assert forecast.rules == ("link[2] (predecessor → v4)",)
    assert forecast.preset == "bursty"
    assert forecast.preset_source == read_preset("bursty").source
    assert words(forecast)["latency 20 ms"] == "link[2].preset = bursty (predecessor → v4)"
    assert forecast.burst_messages_mean == pytest.approx(8.0)
    assert forecast.latency_ms_deviation == 0.0


def test_a_vehicle_s_own_silence_is_a_key_of_the_vehicle() -> None:
    silent = "vehicle.v2.transmitter_off=[{from_s=1.0,to_s=2.0}]"
    forecast = link("v2", "v3", silent)
    assert words(forecast)["transmitter off from 1 to 2 s"] == "vehicle.v2.transmitter_off"
    assert (forecast.loss_ratio, forecast.age_ms_mean) == (None, None)
    assert link("v1", "v3", silent).loss_ratio == 0.0


def test_figures_of_a_radio_are_for_the_distance_at_the_start() -> None:
    preset = read_preset("ieee80211p_jam").links["radio"]
    forecast = link("v1", "v3", "links.preset=ieee80211p_jam", "convoy.gap_m=20.07")
    assert forecast.distance_m == 50.0
    ratio = dict(zip(preset["distance_m"], preset["delivery_ratio"], strict=True))[50.0]
    assert forecast.loss_ratio == pytest.approx(1.0 - ratio)


def test_more_vehicles_in_between_lose_more() -> None:
    settings = ("links.preset=nlosv_etsi", "convoy.vehicles=8", "convoy.gap_m=15")
    near, far = (link("v1", name, *settings).loss_ratio for name in ("v5", "v8"))
    assert near is not None
    assert far is not None
    assert near < 0.5 < far


def test_the_rate_of_a_link_ages_its_messages() -> None:
    forecast = link("v1", "v2", "links.rate_hz=5.0")
    assert forecast.rate_hz == 5.0
    assert words(forecast)["rate: 1 of 4 messages carried"] == "links.rate_hz = 5"
    assert forecast.age_ms_mean == pytest.approx(20.0 + 100.0 - 10.0)


def test_messages_that_are_sent_more_rarely_are_older() -> None:
    forecast = link("v1", "v2", 'sending={kind="fixed",rate_hz=5.0}')
    assert forecast.rate_hz == 5.0
    assert forecast.age_ms_mean == pytest.approx(20.0 + 100.0 - 10.0)
    late = link("v1", "v2", "gnss.latency_ms=30.0").age_ms_mean
    assert late == pytest.approx(20.0 + 25.0 - 5.0 + 30.0)
    uneven = link("v1", "v2", 'sending.kind="cam"')
    assert (uneven.rate_hz, uneven.age_ms_mean) == (5.0, None)


THREE = "convoy.vehicles=3"
"""Links without and with a car in between."""


@pytest.mark.spread(9)
@pytest.mark.parametrize("name", [*presets(), *library()])
def test_every_law_of_what_ships_has_words_and_a_key(name: str) -> None:
    shipped = load_scenario(name) if name in library() else scenario(THREE, f"links.preset={name}")
    for forecast in link_forecasts(shipped)[0]:
        assert forecast.rules
        assert forecast.laws
        for law in forecast.laws:
            assert law.words
            assert law.key.startswith(("links.", "link["))
            assert "\n" not in law.words


CONTENT = (
    "links.content={duplicate_ratio=0.1,bit_error_ratio=0.001,reorder_ratio=0.2,"
    'false=[{kind="offset",east_m=3.0,from_s=4.0}]}'
)


def test_in_brief_stands_what_acts_besides_the_plain_keys() -> None:
    assert laws_in_brief(scenario("links.jitter_ms=4", "links.loss_ratio=0.1"), ("v1", "v2")) == ""
    facts = laws_in_brief(scenario(CONTENT, "links.queue={bytes_per_s=5000.0}"), ("v1", "v2"))
    for part in (
        "20 % held back", "10 % duplicated", "bit error ratio 0.001",
        "false content: offset from 4", "queue of 10 messages",
    ):  # fmt: skip
        assert part in facts
    here = 'links.outages=[{kind="circle",latitude_deg=37.0,longitude_deg=-122.0,radius_m=50.0}]'
    origin = "origin={latitude_deg=37.0,longitude_deg=-122.0}"
    assert "nan" not in laws_in_brief(scenario(here, origin), ("v1", "v2"))
