"""Rules, laws and expected figures of each link."""

import pytest

from scenarios.definition.channel.presets import presets, read_preset
from scenarios.definition.check.link_forecast import LinkForecast, link_forecast, link_forecasts
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


THREE = "convoy.vehicles=3"
"""Links without and with a car in between."""


@pytest.mark.spread(9)
@pytest.mark.parametrize("name", [*presets(), *library()])
def test_every_law_of_what_ships_has_words_and_a_key(name: str) -> None:
    shipped = load_scenario(name) if name in library() else scenario(THREE, f"links.preset={name}")
    for forecast in link_forecasts(shipped):
        assert forecast.rules
        assert forecast.laws
        for law in forecast.laws:
            assert law.words
            assert law.key.startswith(("links.", "link["))
            assert "\n" not in law.words
