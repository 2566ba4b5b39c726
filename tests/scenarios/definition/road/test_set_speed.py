"""Another set speed, and a car that sets off: within its acceleration, and slow in bends."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.road.lead_speed import approached
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.definition.schema.change_tables import SpeedChangeTable
from vehicles.driver.speed import SpeedProfile

BEND = """
name = "bend"
duration_s = 30.0
[speed]
set_mps = 10.0
lateral_acceleration_mps2_max = 3.0
[path]
kind = "segments"
segments = [{ length_m = 200.0 }, { length_m = 60.0, radius_m = 50.0, turn = "left" },
            { length_m = 2000.0 }]
"""
STEP = 0.01
speeds = st.floats(0.0, 40.0)


def scenario(*changes: str) -> Scenario:
    return scenario_from_text(BEND + "".join(f"[[change]]\n{one}\n" for one in changes))


@given(
    speeds,
    st.floats(0.1, 5.0),
    st.lists(st.tuples(st.floats(0.1, 10.0), speeds), min_size=1, max_size=4),
)
def test_a_car_comes_to_what_is_wanted_evenly_and_keeps_to_it(
    speed: float, acceleration: float, corners: list[tuple[float, float]]
) -> None:
    at, times = 0.0, []
    for span, _ in corners:
        times.append(at)
        at += span
    wanted = SpeedProfile(tuple(times), tuple(value for _, value in corners))
    found = approached(wanted, speed, acceleration)
    assert found.at(0.0)[0] == pytest.approx(speed, abs=1e-9)
    rises = wanted.at(0.0)[0] >= speed
    for k in range(round((at + 420.0) / 0.25)):
        time = 0.25 * k
        line = speed + (acceleration if rises else -acceleration) * time
        reached = wanted.at(time)[0]
        # Until it has met what is wanted it is on its own side of it.
        if found.at(time)[0] != pytest.approx(reached, abs=1e-6):
            assert found.at(time)[0] == pytest.approx(line, abs=1e-6)
            assert (reached > line) == rises
    assert found.speeds[-1] == pytest.approx(wanted.speeds[-1], abs=1e-9)


def test_a_change_of_the_set_speed_is_a_ramp() -> None:
    profile = scenario('kind = "speed"\nat_s = 4.0\nspeed_mps = 6.0\nacceleration_mps2 = 2.0')
    for at, speed in ((0.0, 10.0), (4.0, 10.0), (5.0, 8.0), (6.0, 6.0), (20.0, 6.0)):
        assert profile.route.profile.at(at)[0] == pytest.approx(speed, abs=1e-6)
    assert profile.route.plan.profile.at(20.0)[0] == 10.0  # what the vehicles start from


def test_a_higher_set_speed_is_lowered_in_the_bend_that_comes() -> None:
    changed = scenario('kind = "speed"\nat_s = 1.0\nspeed_mps = 25.0\nacceleration_mps2 = 3.0')
    profile, route = changed.route.profile, changed.route
    fastest = 0.0
    for k in range(2000):
        at = k * STEP
        speed, station = profile.at(at)[0], route.start + profile.distance(at)
        fastest = max(fastest, speed)
        bend = abs(route.path.at(station).curvature)
        assert speed * speed * bend <= 3.0 * 1.05
    assert fastest == pytest.approx(25.0, abs=0.1)
    assert math.sqrt(3.0 * 50.0) < 25.0  # so the bend counts


@given(st.floats(0.0, 20.0), st.floats(0.0, 150.0), st.floats(0.0, 10.0))
def test_a_car_that_sets_off_is_slow_enough_where_it_is(
    at: float, ahead: float, speed: float
) -> None:
    changed = scenario()
    plan = changed.route.plan.changed(0.0, SpeedChangeTable(kind="speed", at_s=0.0, speed_mps=20.0))
    station = plan.start + ahead
    profile = plan.setting_off(at, station, speed)
    assert profile.at(at)[0] == pytest.approx(speed, abs=0.2)
    before, way = profile.at(at)[0], station
    for k in range(1, round((plan.until - at) / STEP)):  # nobody drives any longer
        now = profile.at(at + k * STEP)[0]
        way += 0.5 * (before + now) * STEP
        assert now - before <= 1.5 * STEP + 1e-6
        assert now * now * abs(plan.path.at(way).curvature) <= 3.0 * 1.1
        before = now
