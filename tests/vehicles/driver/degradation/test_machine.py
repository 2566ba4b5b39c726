"""Modes of followers in a bend behind exact sources that fall silent, and their reasons."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import pytest

from tests.made.vehicles.exact_drives import PLANE, Source, Step, drive, on, received_from
from tests.made.vehicles.followers import (
    BEND,
    STRAIGHT,
    follower,
    lateral,
    lead_of,
    modes,
    predecessor_of,
)
from vehicles.car.path_history import PathHistory
from vehicles.driver.settings import DegradationSettings, Reaction
from vehicles.driver.situation import stopping_distance
from vehicles.messages import GpsPose

DEGRADE = DegradationSettings()
SILENT = ((0.0, 4.0), (12.0, math.inf))
LAST_RECEIVED = 3.98
"""Sent at 3.95 s, with a latency of 20 ms, processed at the next tick."""


@cache
def cut(reaction: Reaction = "degrade", speed: float = 10.0) -> list[Step]:
    """Neither lead nor predecessor is received from 4 to 12 s."""
    return drive(
        follower(speed=speed, degradation=DegradationSettings(reaction=reaction)),
        on(BEND, 0.0, speed),
        18.0,
        received_from(
            *(
                replace(source, history=PathHistory(PLANE, 300.0, 23))
                for source in (lead_of(BEND, speed, SILENT), predecessor_of(BEND, speed, SILENT))
            )
        ),
    )


def decided(steps: list[Step]) -> list[Step]:
    return [step for step in steps if step.decision.fresh]


def test_without_data_it_stops_within_the_known_path_and_resumes() -> None:
    steps = cut()
    began = modes(steps)
    assert [mode for mode, _ in began][:3] == ["straight", "composite", "stop"]
    assert began[-1][0] == "composite"
    given_up, back = began[2][1], began[3][1]
    assert LAST_RECEIVED + 0.5 <= given_up <= LAST_RECEIVED + 0.8
    assert back == pytest.approx(12.02 + 0.5, abs=0.1)
    standing = [one for one in decided(steps) if 11.0 < one.seconds < 12.0]
    assert max(one.body.speed for one in standing) < 0.01
    assert min(one.decision.situation.known for one in standing) >= 0.0
    off = lateral(BEND, steps)
    until = [value for step, value in zip(steps, off, strict=True) if step.seconds < 12.0]
    assert max(map(abs, until)) < 0.1
    assert max(map(abs, off)) < 0.3  # including the hole of 80 m
    assert steps[-1].body.speed > 5.0


def test_every_change_of_mode_has_a_reason_in_seconds_and_metres() -> None:
    for before, step in pairwise(decided(cut())):
        if step.decision.mode == before.decision.mode:
            continue
        why = step.decision.reason
        assert why
        if step.decision.mode == "stop":
            assert "v1 silent for" in why
            assert "v2 silent for" in why
            assert "m of known path" in why
        elif before.decision.mode == "stop":
            assert "received, newest pose" in why


@pytest.mark.parametrize("speed", [5.0, 10.0, 20.0])
def test_the_blind_distance_matches_the_closed_form(speed: float) -> None:
    steps = decided(cut(speed=speed))
    for before, step in pairwise(step for step in steps if step.seconds > 1.0):
        situation, body = step.decision.situation, step.body
        acceleration = before.decision.actuation.acceleration
        # The emergency stop accounts for held commands: half a tick of 20 ms.
        braked = max(acceleration - 0.01 * DEGRADE.emergency.jerk, -DEGRADE.emergency.deceleration)
        emergency = stopping_distance(body.speed, braked, DEGRADE.emergency)
        assert situation.blind == pytest.approx(max(emergency - situation.known, 0.0), abs=0.1)


@cache
def undisturbed() -> list[Step]:
    sources = received_from(lead_of(BEND), predecessor_of(BEND))
    return drive(follower(degradation=DEGRADE), on(BEND, 0.0, 10.0), 18.0, sources)


def largest_turn(steps: list[Step]) -> float:
    """Largest change of the steering command (rad) from one control instant to the next."""
    angles = [step.decision.actuation.steering for step in decided(steps)]
    return max(abs(after - before) for before, after in pairwise(angles))


def test_losing_a_source_makes_no_step_in_the_command() -> None:
    """Only the predecessor is lost and returns; both sources drive the same path."""
    steps = drive(
        follower(degradation=DEGRADE),
        on(BEND, 0.0, 10.0),
        18.0,
        received_from(lead_of(BEND), predecessor_of(BEND, delivered=SILENT)),
    )
    assert [mode for mode, _ in modes(steps)] == ["straight", "composite", "lead", "composite"]
    weights = [step.decision.situation.predecessor_weight for step in decided(steps)]
    assert max(abs(after - one) for one, after in pairwise(weights)) < 0.05
    assert min(weights) == 0.0
    assert weights[-1] == 0.5
    assert largest_turn(steps) < 1.5 * largest_turn(undisturbed())
    assert max(map(abs, lateral(BEND, steps))) < 0.05


# ---- Baselines


def test_hold_keeps_steering_and_speed() -> None:
    silent = [step for step in decided(cut("hold")) if step.decision.mode == "coast"]
    assert silent
    assert len({step.decision.actuation.steering for step in silent}) == 1
    assert min(step.body.speed for step in silent) > 9.5


def test_straight_turns_the_wheels_straight_at_full_speed() -> None:
    silent = [step for step in decided(cut("straight")) if step.decision.mode == "coast"]
    assert silent
    assert {step.decision.actuation.steering for step in silent} == {0.0}
    assert min(step.body.speed for step in silent) > 9.5


def test_extrapolate_continues_along_the_bend() -> None:
    steps = cut("extrapolate")
    assert "coast" in {step.decision.mode for step in steps}
    assert max(map(abs, lateral(BEND, steps))) < 0.4
    assert min(step.body.speed for step in steps) > 9.5


@dataclass
class RareSource(Source):
    """A source that sends at 2 Hz, until 5 s after the start."""

    def messages_by(self, now: int) -> Iterator[GpsPose]:
        for message in super().messages_by(now):
            if message.seq % 10 == 0 and message.seq <= 100:
                yield replace(message, seq=message.seq // 10)


def test_it_stops_within_the_known_path_before_a_rare_source_is_lost() -> None:
    """At 2 Hz a source is lost after 5 s; the known path ends sooner."""
    lead = RareSource("v1", STRAIGHT, 30.0, 6.0)
    driver = follower(lead="v1", predecessor="v1", speed=6.0, degradation=DEGRADE)
    steps = decided(drive(driver, on(STRAIGHT, 0.0, 6.0), 12.0, received_from(lead)))
    assert "stop" in {one.decision.mode for one in steps}
    assert min(one.decision.situation.known for one in steps if one.seconds > 1.0) > 0.0
    assert steps[-1].body.speed < 0.1
