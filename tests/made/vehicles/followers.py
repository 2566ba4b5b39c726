"""Followers behind sources with exact poses."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from tests.made.vehicles.exact_drives import CONTROL_HZ, GNSS_HZ, PLANE, START, Step
from tests.made.vehicles.exact_drives import Source as Sender
from tests.made.vehicles.fusions import FUSION_OF, REACTION_OF
from transport.codec import RefusedMessageError
from transport.links.link import PoseGate
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.controller import GapLimits, LongitudinalSetup, SpacingPolicy
from vehicles.driver.follower import Follower
from vehicles.driver.pose_estimator import PoseEstimator
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.driver.speed import ProfileSpeed, SpeedLaw, SpeedProfile
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.driver.steering import SlipCompensated
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.messages import GpsPose
from vehicles.preview.curve_fit import FitSettings
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import Cadence

STRAIGHT = path_from_segments([Segment(600.0, 0.0)])
BEND = path_from_segments([Segment(60.0, 0.0), Segment(500.0, 1 / 100)])
SPACING = 15.0
EXTRAPOLATES = DegradationSettings(reaction="extrapolate")
SETUP = LongitudinalSetup(
    SpacingPolicy(SPACING), GapLimits(), CAR.length, parameters=CAR, initial_spacing=SPACING
)
Spans = Sequence[tuple[float, float]]
ALWAYS: Spans = ((0.0, math.inf),)


def follower(
    *,
    lead: str = "v1",
    predecessor: str = "v2",
    between: Sequence[str] = (),
    alpha: float = 0.5,
    fusion: str = "composite",
    speed: float = 10.0,
    law: SpeedLaw | None = None,
    degradation: DegradationSettings = EXTRAPOLATES,
) -> Follower:
    """A follower that extrapolates without data, or reacts as `degradation` configures.

    With the fusion "predecessor" it steers along the predecessor only. It also receives vehicles
    `between` lead and predecessor, from front to back.
    """
    names = tuple(dict.fromkeys((lead, *between, predecessor)))
    law = law or ProfileSpeed(SpeedProfile((0.0,), (speed,)), START, 1.0 / CONTROL_HZ)
    sources = [
        Source(name, 1.0 / GNSS_HZ, degradation, place=len(names) - place if place else 0)
        for place, name in enumerate(names)
    ]
    degrades = degradation.reaction == "degrade"
    return Follower(
        own_state=PoseEstimator(CAR),
        controller=SlipCompensated(CAR),
        speed_law=law,
        guard=SpeedGuard(law, degradation, SETUP) if degrades else None,
        control=Cadence(START, CONTROL_HZ),
        sources=Sources(
            sources,
            degradation,
            lead=lead,
            predecessor=predecessor,
            lateral=names[-1:] if fusion == "predecessor" else names,
            longitudinal=names,
        ),
        least_spacing=CAR.length,
        alpha=alpha,
        fusion=FUSION_OF.get(fusion, FUSION_OF["composite"]),
        settings=FitSettings(),
        degradation=degradation,
        reaction=REACTION_OF[degradation.reaction],
    )


def lead_of(path: SampledPath, speed: float = 10.0, delivered: Spans = ALWAYS) -> Sender:
    return Sender("v1", path, 2 * SPACING, speed, delivered)


def predecessor_of(path: SampledPath, speed: float = 10.0, delivered: Spans = ALWAYS) -> Sender:
    return Sender("v2", path, SPACING, speed, delivered)


def lateral(path: SampledPath, steps: Sequence[Step]) -> list[float]:
    """True lateral error (m) of the car at the distance driven."""
    return [path.project(s.body.east, s.body.north, s.body.distance).lateral for s in steps]


def modes(steps: Sequence[Step]) -> list[tuple[str, float]]:
    """Modes in order, with the time (s) at which each began."""
    changes: list[tuple[str, float]] = [(steps[0].decision.mode, 0.0)]
    for before, step in pairwise(steps):
        if step.decision.mode != before.decision.mode:
            changes.append((step.decision.mode, step.seconds))
    return changes


def admitted(poses: Iterable[GpsPose], now: int) -> list[ReceivedPose]:
    """Poses that pass the gates of the follower's inbox at `now` (ns)."""
    return [pose for message in poses if (pose := _admitted(message, now)) is not None]


def _admitted(message: GpsPose, now: int) -> ReceivedPose | None:
    gate = PoseGate(sender=message.vehicle, start_at=START, rate_hz=100.0, plane=PLANE)
    try:
        return gate.check(message, now)
    except RefusedMessageError:
        return None
