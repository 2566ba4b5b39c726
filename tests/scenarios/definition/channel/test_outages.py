"""From the keys of a scenario to outages: stations, places on earth, and a vehicle's own radio."""

import pytest

from scenarios.definition.channel.build import link_effects
from scenarios.definition.scenario import Scenario, load_scenario
from tests.made.channels.laws import circle, random_outage, stretch, window
from transport.links.laws.basic import Latency
from transport.links.laws.link_law import Effect, LinkLaw
from transport.links.laws.outages import CircleOutage, ReceiverOff, TransmitterOff
from vehicles.geometry.geodesy import LocalPlane
from vehicles.schedule import SECOND

START = 5 * SECOND


def effects(scenario: Scenario, sender: str, receiver: str) -> list[Effect]:
    setting = scenario.link_setting(sender, receiver, START)
    found = link_effects(scenario.links[sender, receiver], 20.0, setting)
    return [one for one in found if not isinstance(one, Latency)]


def test_each_kind_is_its_outage_in_the_order_given() -> None:
    scenario = load_scenario(
        "lane_change",
        [
            "links.outages=[{kind='window', from_s=1, to_s=2.5, every_s=10},"
            " {kind='random', mean_on_s=4, mean_off_s=0.5},"
            " {kind='stretch', from_m=100, to_m=160, vehicle='both'},"
            " {kind='circle', east_m=30, north_m=-4, radius_m=9}]"
        ],
    )
    found = effects(scenario, "v1", "v3")
    assert found == [
        window(SECOND, 5 * SECOND // 2, START, 10 * SECOND),
        random_outage(4 * SECOND, SECOND // 2, START, 1),
        stretch((100.0, 160.0), "both", 0.0, -29.86),
        circle(30.0, -4.0, 9.0, "either"),
    ]
    settings = [one.setting for one in found if isinstance(one, LinkLaw)]
    assert {one.start_at for one in settings} == {START}
    assert [one.place for one in settings] == [0, 1, 2, 3]
    # Starts 14.93 m apart; the path's first segment begins where the lead starts.
    assert settings[2].sender_station == 0.0
    assert settings[2].receiver_station == pytest.approx(-29.86)


def test_the_first_recorded_point_is_where_stations_begin() -> None:
    scenario = load_scenario("highway")
    lead = scenario.vehicle_names[0]
    setting = scenario.link_setting(lead, scenario.vehicle_names[1], START)
    route = scenario.route
    assert route.smoothed is not None
    assert setting.sender_station == route.start - route.smoothed.start <= 0.0
    first = route.path.at(route.first_point)
    given = scenario.tables.path.model_dump()
    assert (first.east, first.north) == pytest.approx(
        (given["east_m"][0], given["north_m"][0]), abs=2.0
    )


def test_a_place_on_earth_is_the_one_in_the_plane() -> None:
    at = LocalPlane(load_scenario("lane_change").origin).to_geodetic(120.0, -35.0)
    scenario = load_scenario(
        "lane_change",
        [
            f"links.outages=[{{kind='circle', latitude_deg={at[0]!r}, longitude_deg={at[1]!r},"
            " radius_m=20}]"
        ],
    )
    (found,) = effects(scenario, "v1", "v2")
    assert isinstance(found, CircleOutage)
    assert found.centre == pytest.approx((120.0, -35.0), abs=1e-3)


def test_a_radio_that_is_off_is_off_on_all_its_links() -> None:
    scenario = load_scenario(
        "lane_change",
        [
            "vehicle.v2.transmitter_off=[{from_s=1, to_s=2}]",
            "vehicle.v3.receiver_off=[{from_s=3, to_s=4, every_s=10}]",
            "links.outages=[{kind='window', from_s=0, to_s=1}]",
        ],
    )
    sending = window(SECOND, 2 * SECOND, START, kind=TransmitterOff)
    hearing = window(3 * SECOND, 4 * SECOND, START, 10 * SECOND, ReceiverOff)
    from_start = window(0, SECOND, START)
    assert effects(scenario, "v1", "v2") == [from_start]
    assert effects(scenario, "v2", "v3") == [sending, hearing, from_start]
    assert effects(scenario, "v1", "v3") == [hearing, from_start]
    assert effects(scenario, "v3", "v4") == [from_start]
