"""Vehicles in between: in the line of sight on a straight, outside it in bends."""

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from scenarios.definition.channel.build import ROAD_STEP, vehicles_between
from scenarios.definition.scenario import scenario_from_text
from transport.links.laws.link_law import Position, Road, TransmissionContext, VehiclesBetween
from transport.links.laws.radio import (
    MAX_LOSS,
    LossPerVehicle,
    Obstruction,
    ShadowField,
    SingleLoss,
)
from transport.links.link import keyed_draw
from vehicles.geometry.sampled_path import SampledPath

ALL = 10**6
DRAW = keyed_draw(1, "v1", "v9")


def circle(radius: float) -> Road:
    """A circular road around the origin, counter-clockwise from the east."""
    angles = np.arange(0.0, 2.0 * pi * radius, ROAD_STEP) / radius
    return Road(ROAD_STEP, (radius * np.cos(angles)).tolist(), (radius * np.sin(angles)).tolist())


def on_circle(radius: float, travelled: float) -> Position:
    return Position(radius * cos(travelled / radius), radius * sin(travelled / radius), travelled)


@given(
    st.floats(15.0, 500.0), st.integers(1, 12), st.floats(6.0, 40.0), st.floats(0.5, 3.0),
)  # fmt: skip
def test_around_a_bend_those_count_that_are_near_the_chord(
    radius: float, count: int, gap: float, reach: float
) -> None:
    """The distance from the chord is r (cos φ − cos φ_end), with the angle φ from its middle."""
    length = gap * (count + 1)
    assume(length < pi * radius)
    half = 0.5 * length / radius
    off = [
        radius * (cos(half * (2.0 * place / (count + 1) - 1.0)) - cos(half))
        for place in range(1, count + 1)
    ]
    sag = ROAD_STEP**2 / (8.0 * radius)  # deviation of the road's polyline from the bend
    assume(all(abs(one - reach) > 1.1 * sag for one in off))
    between = VehiclesBetween(count, circle(radius), 0.0, 0.0, reach)
    context = TransmissionContext(0, 0, 0, on_circle(radius, 5.0 + length), on_circle(radius, 5.0))
    assert between.count_obstructing(context, ALL) == sum(one < reach for one in off)


BEND = """
name = "bend"
[convoy]
vehicles = 9
[path]
kind = "segments"
segments = [
    { length_m = 400.0 }, { length_m = 31.4, radius_m = 20.0, turn = "left" }, { length_m = 400.0 },
]
"""


def test_on_the_road_of_a_scenario_all_are_in_the_way_until_the_lead_turns() -> None:
    """Positions and distances travelled as in a run; all vehicles drive exactly on the path."""
    route = scenario_from_text(BEND).route
    lead, last = 0, 8
    between = vehicles_between(route, lead, last)
    assert between.count == 7

    def context(travelled: float) -> TransmissionContext:
        ends = [route.path.at(route.start_station(place) + travelled) for place in (lead, last)]
        ahead, behind = (Position(end.east, end.north, travelled) for end in ends)
        return TransmissionContext(0, 0, 0, ahead, behind)

    found = [between.count_obstructing(context(travelled), ALL) for travelled in range(0, 700, 5)]
    assert found[0] == 7
    assert found[-1] == 7
    assert min(found) == 0  # each side of the bend has its own line of sight
    first = next(place for place, count in enumerate(found) if count < 7)
    assert 400 <= 5 * first <= 440
    for travelled, count in zip(range(0, 700, 5), found, strict=True):
        assert count == brute_force(route.path, context(travelled), between), travelled


def brute_force(path: SampledPath, context: TransmissionContext, between: VehiclesBetween) -> int:
    """Distance of each vehicle on the path from points of the line of sight."""
    here, there = context.receiver, context.sender
    shares = np.linspace(0.0, 1.0, 4001)
    easts = here.east + shares * (there.east - here.east)
    norths = here.north + shares * (there.north - here.north)
    start, end = between.receiver_start + here.travelled, between.sender_start + there.travelled
    count = 0
    for place in range(1, between.count + 1):
        point = path.at(start + (end - start) * place / (between.count + 1))
        off = np.hypot(point.east - easts, point.north - norths)
        count += int(off.min() < between.radius)
    return count


def straight(count: int) -> VehiclesBetween:
    return VehiclesBetween(count, Road(10.0, (0.0, 10.0), (0.0, 0.0)), 0.0, 0.0)


def apart(distance: float) -> TransmissionContext:
    return TransmissionContext(0, 0, 0, Position(distance, 0.0, distance), Position(0.0, 0.0, 0.0))


def test_each_costs_by_the_law_of_etsi_and_all_together_by_that_of_3gpp() -> None:
    def lost(law: Obstruction, distance: float, count: int = 4) -> float:
        field = ShadowField(25.0)
        lost, is_obstructed = law.loss(straight(count), field, DRAW, apart(distance), distance)
        assert is_obstructed
        return lost

    each, once = LossPerVehicle(loss_db=6.9), SingleLoss(mean_db=9.0, deviation_db=0.0)
    assert lost(each, 75.0) == pytest.approx(27.6)
    assert lost(each, 75.0, 10**5) == pytest.approx(MAX_LOSS, abs=6.9)
    assert lost(once, 75.0) == 9.0
    assert lost(once, 1000.0) == pytest.approx(9.0 + 4.0)
    assert lost(SingleLoss(mean_db=-9.0, deviation_db=0.0), 75.0) == 0.0


@pytest.mark.parametrize("offset", [1.4, 1.6])
def test_a_circle_cuts_the_line_up_to_its_radius(offset: float) -> None:
    road = Road(10.0, (0.0, 10.0), (offset, offset))
    between = VehiclesBetween(3, road, 0.0, 0.0)
    assert between.count_obstructing(apart(60.0), ALL) == (3 if offset < 1.5 else 0)
    with_nobody = VehiclesBetween(0, road, 0.0, 0.0)
    assert with_nobody.count_obstructing(apart(60.0), ALL) == 0
