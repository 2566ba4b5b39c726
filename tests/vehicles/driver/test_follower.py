import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

from tests.made.vehicles.exact_drives import (
    GNSS_HZ,
    LATENCY_NS,
    START,
    Source,
    Step,
    drive,
    on,
    received_from,
)
from tests.made.vehicles.followers import (
    BEND,
    SPACING,
    follower,
    lateral,
    lead_of,
    modes,
    predecessor_of,
)
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.sensors import GapMeasurement
from vehicles.driver.controller import GapLimits, LongitudinalSetup, SpacingPolicy
from vehicles.driver.decision import Decision
from vehicles.driver.modes import NOTHING_RECEIVED
from vehicles.driver.speed import GapKeeping
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

HEADINGS = [0.0, math.pi / 2, math.pi, -math.pi / 2]


# ---- Trajectory


@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi])
def test_a_follower_without_data_drives_straight(yaw: float) -> None:
    path = path_from_segments([Segment(200.0, 0.0)], yaw=yaw)
    steps = drive(follower(), on(path, 0.0, 10.0), 5.0)
    assert modes(steps) == [("straight", 0.0)]
    for step in steps:
        assert step.decision.reason == NOTHING_RECEIVED
        assert step.decision.actuation.steering == pytest.approx(0.0, abs=1e-12)
        assert step.decision.actuation.acceleration == pytest.approx(0.0, abs=1e-12)
        assert math.isnan(step.decision.estimated_gap)
    assert max(map(abs, lateral(path, steps))) < 1e-9


def test_both_sources_determine_a_composite_trajectory() -> None:
    steps = drive(
        follower(), on(BEND, 0.0, 10.0), 12.0, received_from(lead_of(BEND), predecessor_of(BEND))
    )
    assert [mode for mode, _ in modes(steps)] == ["straight", "composite"]
    assert modes(steps)[1][1] < 0.2
    assert steps[-1].decision.reason == ""
    assert max(map(abs, lateral(BEND, steps))) < 0.05
    late = steps[-1].decision
    assert late.errors.curvature == pytest.approx(1 / 100, rel=0.02)
    assert late.fit is not None
    assert {0, 1} == set(late.fit.source.tolist())
    needed = (CAR.wheelbase + CAR.steer_gradient * 10.0**2) / 100
    assert late.actuation.steering == pytest.approx(needed, rel=0.02)


@pytest.mark.parametrize(
    ("source", "mode", "missing"), [(lead_of, "lead", "v2"), (predecessor_of, "predecessor", "v1")]
)
def test_one_source_alone_is_followed_and_the_reason_names_the_other(
    source: Callable[[SampledPath], Source], mode: str, missing: str
) -> None:
    steps = drive(follower(), on(BEND, 0.0, 10.0), 10.0, received_from(source(BEND)))
    assert [mode for mode, _ in modes(steps)] == ["straight", mode]
    assert steps[-1].decision.reason == f"{missing} not received yet"
    assert max(map(abs, lateral(BEND, steps))) < 0.05


def test_a_silent_lead_leaves_the_predecessor() -> None:
    silent = ((0.0, 4.0),)
    steps = drive(
        follower(),
        on(BEND, 0.0, 10.0),
        12.0,
        received_from(lead_of(BEND, delivered=silent), predecessor_of(BEND)),
    )
    assert [mode for mode, _ in modes(steps)] == ["straight", "composite", "predecessor"]
    assert "v1 silent for 8.0 s" in steps[-1].decision.reason
    assert steps[-1].decision.situation.lead.age == pytest.approx(steps[-1].seconds - 3.95)
    assert max(map(abs, lateral(BEND, steps))) < 0.05


# ---- Conventions


@pytest.mark.spread(4)
@pytest.mark.parametrize("yaw", HEADINGS)
@pytest.mark.parametrize("offset", [0.8, -0.8])
def test_a_follower_left_of_the_lead_s_path_steers_right(yaw: float, offset: float) -> None:
    path = path_from_segments([Segment(400.0, 0.0)], -20.0, 30.0, yaw)
    steps = drive(
        follower(speed=15.0),
        on(path, 0.0, 15.0, offset),
        8.0,
        received_from(lead_of(path, 15.0), predecessor_of(path, 15.0)),
    )
    off = lateral(path, steps)
    assert off[0] == pytest.approx(offset)
    away = math.copysign(1, offset)
    first = next(step for step in steps if abs(step.decision.actuation.steering) > 1e-4)
    assert math.copysign(1, first.decision.actuation.steering) == -away
    assert abs(off[-1]) < 0.02
    assert min(away * value for value in off) > -0.1  # no overshoot
    assert max(away * value for value in off) < 0.81


@pytest.mark.spread(4)
@pytest.mark.parametrize("yaw", HEADINGS)
@pytest.mark.parametrize("sign", [1, -1])
def test_bends_to_both_sides_are_followed_in_all_headings(yaw: float, sign: int) -> None:
    path = path_from_segments([Segment(60.0, 0.0), Segment(300.0, sign / 80)], 5.0, 7.0, yaw)
    steps = drive(
        follower(), on(path, 0.0, 10.0), 9.0, received_from(lead_of(path), predecessor_of(path))
    )
    assert max(map(abs, lateral(path, steps))) < 0.06
    assert math.copysign(1, steps[-1].decision.actuation.steering) == sign
    assert steps[-1].decision.errors.curvature == pytest.approx(sign / 80, rel=0.03)


# ---- str


@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.9])
def test_a_blend_steers_by_the_weighted_mean_of_both_commands(alpha: float) -> None:
    """Of three followers with the same data, one blends the commands of the others."""
    path = path_from_segments([Segment(80.0, 0.0), Segment(200.0, 1 / 120)])
    other = path_from_segments([Segment(80.0, 0.0), Segment(200.0, 1 / 110)], 0.0, 0.4)
    sources = received_from(lead_of(path), predecessor_of(other))
    blended = follower(fusion="blend", alpha=alpha)
    by_lead = follower(fusion="composite", alpha=0.0)
    by_predecessor = follower(fusion="predecessor")
    compared = 0

    class Three:
        def step(
            self,
            now: int,
            fix: Fix | None,
            motion: Motion | Body | None,
            received: Sequence[ReceivedPose],
            gap: GapMeasurement | None = None,  # noqa: ARG002
        ) -> Decision:
            nonlocal compared
            decision, lead, predecessor = (
                driver.step(now, fix, motion, received)
                for driver in (blended, by_lead, by_predecessor)
            )
            if decision.mode == "composite":
                for part in ("steering", "feedforward", "feedback"):
                    mean = (1 - alpha) * getattr(lead.steering, part) + alpha * getattr(
                        predecessor.steering, part
                    )
                    assert getattr(decision.steering, part) == pytest.approx(mean, abs=1e-12)
                compared += abs(lead.steering.steering - predecessor.steering.steering) > 1e-3
            return decision

    steps = drive(Three(), on(path, 0.0, 10.0), 11.0, sources)
    assert compared > 100
    # It drives between sources that disagree.
    off = lateral(path, steps)[-1]
    assert 0.05 < off < lateral(path, [replace(steps[-1], body=on_other(other, steps[-1]))])[0]


def on_other(path: SampledPath, step: Step) -> Body:
    return on(path, path.project(step.body.east, step.body.north, step.body.distance).station, 10.0)


# ---- Gap and age


def test_gap_and_ages_refer_to_the_present_instant() -> None:
    steps = drive(
        follower(), on(BEND, 0.0, 10.0), 8.0, received_from(lead_of(BEND), predecessor_of(BEND))
    )
    period = SECOND // round(GNSS_HZ)
    for step in (step for step in steps if step.decision.fresh and step.seconds > 1.0):
        newest = START + (step.now - LATENCY_NS - START) // period * period
        age = (step.now - newest) / SECOND
        assert step.decision.situation.lead.age == pytest.approx(age)
        assert step.decision.situation.predecessor.age == pytest.approx(age)
        ahead = SPACING + 10.0 * step.seconds
        place = BEND.project(step.body.east, step.body.north, step.body.distance).station
        assert step.decision.estimated_gap + CAR.length == pytest.approx(ahead - place, abs=0.05)


def test_the_gap_converges_to_the_policy() -> None:
    law = GapKeeping(LongitudinalSetup(SpacingPolicy(6.0, 0.4), GapLimits()))
    steps = drive(
        follower(law=law),
        on(BEND, 0.0, 10.0),
        20.0,
        received_from(lead_of(BEND), predecessor_of(BEND)),
    )
    gap = 6.0 + 0.4 * 10.0 - CAR.length
    assert steps[-1].decision.estimated_gap == pytest.approx(gap, abs=0.1)
    assert steps[-1].body.speed == pytest.approx(10.0, abs=0.02)
    assert steps[-1].decision.target_speed == pytest.approx(10.0)
