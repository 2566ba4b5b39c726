import math
from itertools import pairwise

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.node.node import Node
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.phases import Driver, Driving
from scenarios.runs.node.sink import BusSink
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from transport.bus.bus import MemoryBus
from vehicles.car.gnss import Fix
from vehicles.car.imu import ExactSensor, InertialSensor
from vehicles.driver.follower import Follower
from vehicles.driver.leader import Leader
from vehicles.schedule import SECOND

START = 1_790_000_000 * SECOND


def scenario(*overrides: str, seed: int = 1) -> Scenario:
    return load_scenario("lane_change", ["duration_s=5", *overrides], seed)


def node(made: Scenario, name: str) -> Node:
    one = VehicleBuilder(made, name).node(START, BusSink(name, MemoryBus()), NoProbe())
    assert isinstance(one, Node)
    return one


def driver(one: Node) -> Driver:
    assert isinstance(one.phase, Driving)
    return one.phase.software.driver


def fixes(made: Scenario, name: str, count: int = 20) -> list[Fix]:
    """First measurements of a vehicle that stays where it starts."""
    one = node(made, name)
    measured = [one.car.gnss.measure(one.car.body, START + k * SECOND // 20) for k in range(count)]
    return [fix for fix in measured if fix is not None]


def test_vehicles_start_behind_each_other_at_the_lead_s_speed() -> None:
    made = scenario("convoy.gap_m=7")
    bodies = [node(made, name).car.body for name in made.vehicle_names]
    assert len(bodies) == 4
    for before, body in pairwise(bodies):
        assert math.hypot(before.east - body.east, before.north - body.north) == pytest.approx(
            11.93
        )
    assert {body.speed for body in bodies} == {30.0}
    assert {round(body.yaw, 9) for body in bodies} == {0.0}  # heading east
    assert {body.distance for body in bodies} == {0.0}


@pytest.mark.parametrize("heading_deg", [0, 90, 180, 270, 33])
def test_an_offset_to_the_left_is_to_the_left_in_every_heading(heading_deg: int) -> None:
    plain = scenario(f"path.heading_deg={heading_deg}")
    beside = scenario(
        f"path.heading_deg={heading_deg}",
        "vehicle.v2.lateral_offset_m=0.5",
        "vehicle.v2.heading_offset_deg=3",
    )
    on_path, body = node(plain, "v2").car.body, node(beside, "v2").car.body
    left = (-math.sin(on_path.yaw), math.cos(on_path.yaw))
    assert body.east - on_path.east == pytest.approx(0.5 * left[0])
    assert body.north - on_path.north == pytest.approx(0.5 * left[1])
    assert body.yaw - on_path.yaw == pytest.approx(math.radians(3))
    compass = math.radians(90 - heading_deg)
    assert math.remainder(on_path.yaw - compass, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_the_lead_follows_its_path_and_followers_their_sources() -> None:
    made = scenario()
    assert isinstance(driver(node(made, "v1")), Leader)
    received = {name: node(made, name).inbox.keys for name in made.vehicle_names}
    assert received["v1"] == ["convoy/v2/gps", "convoy/v3/gps"]  # it repeats their stops
    assert received["v2"] == ["convoy/v1/gps"]
    assert received["v4"] == ["convoy/v1/gps", "convoy/v3/gps"]
    for name in ("v2", "v3", "v4"):
        assert isinstance(driver(node(made, name)), Follower)


def test_a_vehicle_that_is_not_in_the_scenario_is_refused() -> None:
    with pytest.raises(ScenarioError, match="v9"):
        VehicleBuilder(scenario(), "v9")


def test_the_schedule_is_that_of_control_and_receiver() -> None:
    made = scenario("control.rate_hz=40", "vehicle.v2.gnss.rate_hz=10", "duration_s=3")
    lead = [tick.at - START for tick in VehicleBuilder(made, "v1").ticks(START)]
    assert len(lead) == 3 * 40  # 20 Hz nest in 40 Hz
    second = list(VehicleBuilder(scenario("duration_s=3"), "v2").ticks(START))
    assert len(second) == 3 * (50 + 20 - 10)  # ten instants of a second are in both
    assert sum(tick.span_s for tick in second) == pytest.approx(3.0)
    assert second[-1].at + round(second[-1].span_s * SECOND) == START + 3 * SECOND
    assert len(fixes(made, "v1")) == 20
    assert len(fixes(made, "v2")) == 10


def test_noise_depends_on_seed_and_place_alone() -> None:
    alone = fixes(scenario("convoy.vehicles=2"), "v2")
    east = [pytest.approx(fix.east, abs=1e-9) for fix in alone]
    for changed in ("convoy.vehicles=4", "vehicle.v1.gnss.position_noise_m=0.5"):
        assert [fix.east for fix in fixes(scenario(changed), "v2")] == east
    assert [fix.east for fix in fixes(scenario(seed=2), "v2")] != east
    lead = fixes(scenario(), "v1")
    here = node(scenario(), "v1").car.body
    there = node(scenario(), "v2").car.body
    for own, other in zip(lead, alone, strict=True):
        assert abs((own.east - here.east) - (other.east - there.east)) > 1e-6


def test_each_receiver_has_the_noise_that_it_should() -> None:
    made = scenario(
        "gnss.position_noise_m=0", "gnss.heading_noise_deg=0", "gnss.speed_noise_mps=0",
        "gnss.yaw_rate_noise_radps=0", "vehicle.v3.gnss.position_noise_m=0.5",
        "vehicle.v4.gnss.heading_noise_deg=2",
    )  # fmt: skip
    for name in made.vehicle_names:
        body = node(made, name).car.body
        measured = fixes(made, name, 400)
        aside = [math.hypot(fix.east - body.east, fix.north - body.north) for fix in measured]
        rms = math.sqrt(sum(value * value for value in aside) / len(aside) / 2)
        assert rms == pytest.approx(0.5 if name == "v3" else 0.0, rel=0.1)
        turned = [math.degrees(fix.yaw - body.yaw) for fix in measured]
        spread = math.sqrt(sum(value * value for value in turned) / len(turned))
        assert spread == pytest.approx(2.0 if name == "v4" else 0.0, rel=0.1)
        assert {fix.speed for fix in measured} == {body.speed}


def test_followers_keep_the_profile_or_a_gap() -> None:
    same = scenario("convoy.gap_m=25")
    gap = scenario(
        "convoy.gap_m=25", 'speed.followers="gap"', "speed.gap.standstill_m=3",
        "speed.gap.headway_s=0.5",
    )  # fmt: skip
    requested = {}
    for made in (same, gap):
        second, results = node(made, "v2"), MemoryBus()
        results.subscribe("convoy/v1/gps", second.inbox.on_bytes)
        lead = VehicleBuilder(made, "v1").node(START, BusSink("v1", results), NoProbe())
        for tick in VehicleBuilder(made, "v1").ticks(START):
            if tick.at > START + SECOND // 2:
                break
            lead.step(tick)
            second.step(tick)
        requested[made.tables.speed.followers] = second.car.body.speed
    assert requested["same"] == pytest.approx(30.0, abs=0.05)
    assert requested["gap"] > 30.3  # 25 m are more than 3 + 0.5 * 30


@pytest.mark.parametrize("vehicles", [2, 3, 7, 40])
def test_vehicles_take_turns_after_their_sources(vehicles: int) -> None:
    made = scenario(f"convoy.vehicles={vehicles}", "control.rate_hz=50", "convoy.gap_m=5")
    turns = {name: VehicleBuilder(made, name).stagger_ns for name in made.vehicle_names}
    assert turns["v1"] == 0
    assert max(turns.values()) < SECOND // 50
    for before, after in pairwise(turns.values()):
        share = 0.5 if vehicles > 2 else 1.0  # the lead of two repeats no stops
        assert after - before == pytest.approx(share * SECOND / 50 / vehicles, abs=1.0)
    alone = scenario(f"convoy.vehicles={vehicles}", "control.degradation.reaction='extrapolate'")
    for place, name in enumerate(alone.vehicle_names):
        turn = VehicleBuilder(alone, name).stagger_ns
        assert turn == pytest.approx(place * SECOND / 50 / vehicles, abs=1.0)


def first_steering(made: Scenario, name: str = "v1") -> float:
    """What a lead beside its path decides first."""
    one = node(made, name)
    fix = one.car.gnss.measure(one.car.body, START)
    motion = one.car.imu.measure(one.car.body, START)
    return driver(one).step(START, fix, motion, []).actuation.steering


def test_controller_and_gains_are_those_of_the_scenario() -> None:
    quiet = [
        "gnss.position_noise_m=0", "gnss.heading_noise_deg=0", "gnss.speed_noise_mps=0",
        "gnss.yaw_rate_noise_radps=0", "vehicle.v1.lateral_offset_m=0.5",
        "imu.speed_noise_mps=0", "imu.speed_bias_mps=0",
        "imu.yaw_rate_noise_radps=0", "imu.yaw_rate_bias_radps=0",
        "parameters.steering_rate_limit_radps=inf",
    ]  # fmt: skip
    plain = scenario(*quiet, "control.controller=feedforward_feedback")
    assert first_steering(plain) == pytest.approx(-0.06 * 0.5)
    gains = scenario(
        *quiet, "control.controller=feedforward_feedback", "control.gains.lateral_rad_per_m=0.1"
    )
    assert first_steering(gains) == pytest.approx(-0.1 * 0.5)
    own = scenario(
        *quiet, "control.controller=feedforward_feedback",
        "vehicle.v1.control.gains.lateral_rad_per_m=0.02",
    )  # fmt: skip
    assert first_steering(own) == pytest.approx(-0.02 * 0.5)
    stanley = first_steering(scenario(*quiet, "control.controller=stanley"))
    assert stanley == pytest.approx(-math.atan(2.5 * 0.5 / 31.0))
    pursuit = first_steering(scenario(*quiet, "control.controller=pure_pursuit"))
    # The goal lies 15 m from the rear axle, half a second at 30 m/s, and half a metre aside.
    assert pursuit == pytest.approx(-math.atan(2.0 * 2.85 * (0.5 / 15.0) / 15.0), rel=1e-3)


def test_with_exact_own_state_the_car_knows_where_it_is_and_broadcasts_what_is_measured() -> None:
    settings = ("gnss.position_noise_m=5", "gnss.heading_noise_deg=5")
    beside = "vehicle.v1.lateral_offset_m=0.5"
    exact = scenario(*settings, beside, "control.own_state=exact")
    one = node(exact, "v1")
    motion = one.car.imu.measure(one.car.body, START)
    decision = driver(one).step(START, one.car.gnss.measure(one.car.body, START), motion, [])
    assert decision.errors.lateral == pytest.approx(0.5, abs=1e-12)
    assert decision.errors.heading == pytest.approx(0.0, abs=1e-12)
    assert fixes(exact, "v1") == fixes(scenario(*settings, beside), "v1")
    noisy = scenario("imu.speed_bias_mps=1")
    assert fixes(noisy, "v1") == fixes(scenario(), "v1")
    some = scenario(*settings, "vehicle.v2.control.own_state=exact")
    assert isinstance(node(some, "v2").car.imu, ExactSensor)
    assert isinstance(node(some, "v3").car.imu, InertialSensor)
