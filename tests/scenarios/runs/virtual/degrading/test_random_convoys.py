"""Short convoys over channels, faults and changes drawn at random: no command that no car can take.

`pytest --campaign` drives 500 of them.
"""

from itertools import pairwise
from math import isfinite
from random import Random
from typing import Any, get_args

import pytest
import tomli_w

from scenarios.definition.scenario import Scenario, scenario_from_text
from tests.made.channels.drawn_channels import drawn_channel
from tests.made.convoys.driven import driven
from vehicles.driver.settings import Reaction
from vehicles.messages import Command, Mode, Tracking, TruePose

Raw = dict[str, Any]
DURATION_S = 12.0
SHARE = 0.12
"""Chance of each law for all links."""
ALONE: set[Mode] = {"path", "straight"}
"""Modes that need no reason: nothing was lost."""
ROUNDING = 1e-9


def drawn_change(chance: Random, names: list[str]) -> Raw:
    """Something done to the convoy, at an instant drawn like itself."""
    ends = {"sender": chance.choice(["*", names[0]]), "receiver": chance.choice(["*", names[-1]])}
    some = {"for_s": round(chance.uniform(0.1, 6.0), 3)}
    follower = {"vehicle": chance.choice(names[1:])}
    receiver = {"vehicle": chance.choice(names), "fix": chance.choice(["float", "single", "none"])}
    kinds: dict[str, Raw] = {
        "link": ends | some | {"loss_ratio": chance.random(), "latency_ms": 80.0},
        "cut": ends | some,
        "heal": {},
        "gnss": some | receiver,
        "stall": follower | {"for_s": round(chance.uniform(0.02, 1.0), 3)},
        "crash": follower | {"for_s": round(chance.uniform(1.0, 4.0), 3)},
        "leave": follower,
        "speed": {"speed_mps": round(chance.uniform(3.0, 25.0), 2)},
    }
    kind = chance.choice(list(kinds))
    at_s = round(chance.uniform(0.5, DURATION_S - 1.0), 3)
    return {"kind": kind, "at_s": at_s} | kinds[kind]


def drawn_changes(chance: Random, names: list[str]) -> list[Raw]:
    """Some of them, and to each vehicle at most one of those that take it off the road."""
    changes, off = [], set()
    for one in (drawn_change(chance, names) for _ in range(chance.randint(0, 5))):
        if one["kind"] in {"stall", "crash", "leave"}:
            if one["vehicle"] in off:
                continue
            off.add(one["vehicle"])
        changes.append(one)
    return changes


def drawn_convoy(case: int) -> Scenario:
    """A convoy that drives the paper's double lane change, somehow."""
    chance = Random(case)
    names = [f"v{place}" for place in range(1, chance.randint(2, 4) + 1)]
    speed = round(chance.uniform(5.0, 30.0), 2)
    turn = {"length_m": speed, "radius_m": speed * speed / 1.8}
    text: Raw = {
        "extends": "lane_change",
        "name": "drawn",
        "seed": case,
        "duration_s": DURATION_S,
        "convoy": {"vehicles": len(names), "gap_m": round(chance.uniform(6.0, 35.0), 1)},
        "control": {
            "controller": chance.choice(["slip_compensated", "feedforward_feedback"]),
            "fusion": chance.choice(["composite", "blend"]),
            "alpha_ratio": chance.choice([0.0, 0.5, 1.0]),
            "degradation": {
                "reaction": chance.choice(["degrade", "degrade", *get_args(Reaction)]),
            },
        },
        "information_flow": {
            "lateral": chance.choice(["lead_and_predecessor", "predecessor", {"ahead": 3}]),
            "longitudinal": chance.choice(["lead_and_predecessor", "bidirectional", "all"]),
        },
        "speed": {
            "set_mps": speed,
            "followers": chance.choice(["same", "gap"]),
            "lead_waits": chance.random() < 0.3,
        },
        "path": {
            "kind": "segments",
            "segments": [
                {"length_m": 3.0 * speed},
                turn | {"turn": "right"},
                {"length_m": speed},
                turn | {"turn": "left"},
                {"length_m": 40.0 * speed + 1000.0},
            ],
        },
        "links": drawn_channel(chance, SHARE) | {"loss_ratio": chance.choice([0.0, 0.3, 0.8])},
        "change": drawn_changes(chance, names),
    }
    if text["links"].get("loss", {}).get("kind") == "log":  # it is repeated as it was
        text["change"] = [one for one in text["change"] if one["kind"] != "link"]
    return scenario_from_text(tomli_w.dumps(text), label=f"case {case}")


@pytest.mark.campaign(3, 500)
def test_no_convoy_gets_a_command_that_no_car_can_take(case: int) -> None:
    scenario = drawn_convoy(case)
    run = driven(scenario)
    assert run.summary.outcome != "failed", run.summary.reason
    period_s = 1.0 / scenario.control_rate_hz
    for name in scenario.vehicle_names:
        car = scenario.vehicle(name).parameters
        commands = run.of(name, Command)
        assert all(isfinite(one.steering_rad + one.acceleration_mps2) for one in commands)
        assert max(abs(one.steering_rad) for one in commands) <= car.steering_limit + ROUNDING
        most = car.steering_rate_limit * period_s + ROUNDING
        assert all(
            abs(b.steering_rad - a.steering_rad) <= most * (b.seq - a.seq)
            for a, b in pairwise(commands)
            if b.decided_at_ns - a.decided_at_ns < 1.5e9 * period_s
        )
        poses = run.of(name, TruePose)
        assert all(isfinite(one.east_m + one.north_m + one.speed_mps) for one in poses)
        assert max((one.friction_ratio for one in poses), default=0.0) <= 1.0 + ROUNDING
    for name in scenario.vehicle_names[1:]:
        tracking = run.of(name, Tracking)
        assert {one.mode for one in tracking} <= set(get_args(Mode))
        for before, one in pairwise(tracking):
            if one.mode != before.mode and one.mode not in ALONE:
                worse = one.mode in {"coast", "stop"} or before.mode == "composite"
                assert one.reason or not worse, f"{name} to {one.mode}"
