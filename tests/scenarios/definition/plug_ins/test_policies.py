"""Degradation policies of the user: modes that they choose, and what the car does in them."""

from collections.abc import Callable

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.virtual import run_unlogged
from vehicles.messages import Message, Tracking
from vehicles.schedule import SECOND

CODE = """
from vehicles.driver.reactions import Extrapolate

class StopWhenSilent(Extrapolate):
    def __init__(self, silence_s=0.3):
        self.silence = silence_s
    def mode(self, situation, usual, speed):
        return "stop" if situation.predecessor.silence > self.silence else usual
    def acceleration(self, situation, mode, speed, wanted):
        assert situation.ahead.own.step < 0.1
        return -4.0 if mode == "stop" and speed > 0.0 else wanted
"""
Module = Callable[[str], str]


class TrackingTape:
    kinds: frozenset[type[Message]] = frozenset({Tracking})

    def __init__(self) -> None:
        self.rows: list[Tracking] = []

    def listen(self, _at: int, message: Message) -> None:
        if isinstance(message, Tracking) and message.vehicle == "v3":
            self.rows.append(message)


def scenario_of(reaction: str, *more: str) -> Scenario:
    sets = ["convoy.vehicles=3", "duration_s=1.5", "control.own_state=exact", *more]
    return load_scenario("lane_change", [f"control.degradation.reaction={reaction}", *sets])


def tracking(reaction: str, *more: str) -> list[Tracking]:
    tape = TrackingTape()
    run_unlogged(scenario_of(reaction, *more), [tape])
    return tape.rows


def test_a_policy_of_ones_own_stops_a_car_and_warns(module: Module) -> None:
    """v3 is cut off for 0.7 s: it brakes from 0.3 s of silence until it receives again."""
    cut = "change=[{kind='cut',at_s=0.4,for_s=0.7,sender='*',receiver='v3'}]"
    rows = tracking(f"{module(CODE)}.StopWhenSilent", cut)
    stopping = [row for row in rows if row.mode == "stop"]
    start = rows[0].decided_at_ns
    seconds = [(row.decided_at_ns - start) / SECOND for row in stopping]
    assert seconds[0] == pytest.approx(0.4 + 0.3, abs=0.1)
    assert seconds[-1] == pytest.approx(1.1, abs=0.1)
    assert {row.mode for row in rows if row not in stopping} <= {"composite", "straight", "coast"}
    assert all(row.hazard for row in stopping)
    assert all(row.reason.startswith("chosen by the policy") for row in stopping[:1])
