"""Faults and settings that break the limits of the shipped drills, each limit at least once."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Any

from vehicles.driver.controller import predicted_motion
from vehicles.driver.follower import Follower
from vehicles.driver.own_state import Pose
from vehicles.driver.plausibility import PoseJudge
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.received_pose import ReceivedPose


@dataclass(frozen=True)
class Fault:
    place: str
    by: Callable[..., Any] | float


_steer = Follower._steer


def _has_data(follower: Follower) -> bool:
    return any(source.state.status == "fresh" for source in follower.sources.used.values())


def _wheels_straight(
    follower: Follower, now: int, pose: Pose
) -> tuple[TrackingErrors, SteeringCommand]:
    errors, wanted = _steer(follower, now, pose)
    if _has_data(follower):
        return errors, wanted
    return errors, replace(wanted, steering=0.0, feedforward=0.0, feedback=0.0)


def _trust(_gate: PoseJudge, _pose: ReceivedPose) -> str:
    return ""


def _wheels_askew(
    follower: Follower, now: int, pose: Pose
) -> tuple[TrackingErrors, SteeringCommand]:
    errors, wanted = _steer(follower, now, pose)
    if _has_data(follower):
        return errors, wanted
    return errors, replace(wanted, steering=wanted.steering + 0.035)


WHEELS_STRAIGHT = Fault("vehicles.driver.follower.Follower._steer", _wheels_straight)
"""A follower without data steers straight."""
WHEELS_ASKEW = Fault("vehicles.driver.follower.Follower._steer", _wheels_askew)
"""A follower without data steers two degrees to the left of its command."""
TRUSTS_ALL = Fault("vehicles.driver.plausibility.PoseJudge.judge", _trust)
NO_LASTING_ERRORS = Fault(
    "vehicles.driver.joint_covariance.JointCovariance._active",
    lambda _joint, axis, _state: [axis],
)
"""The own-state filter ignores the errors of fixes that last."""
TRUSTS_FIXES = Fault(
    "vehicles.driver.joint_covariance.JointCovariance.white_variance",
    lambda _joint, _fix: 0.02**2,
)
"""Each fix counts as if it were accurate to 2 cm."""
NEEDS_MANY = Fault(
    "vehicles.driver.source.reaches_ahead",
    lambda window: len(window.station) >= 60,
)
"""A trajectory needs three seconds of messages."""

NO_STOP_ANNOUNCED = Fault("vehicles.driver.sources.Sources.stops_at", lambda *_: 0)
"""No follower announces when it will stop without data."""
IGNORES_CONVOY = Fault("vehicles.driver.convoy.ConvoyAhead.acceleration", lambda *_: inf)
"""The lead ignores its followers."""
CONSTANT_SPEED = Fault(
    "vehicles.driver.situation.SourceState.predicted",
    lambda source: predicted_motion(source.speed, 0.0, 0.0, source.age, source.lag),
)
"""Received accelerations are not used."""

NO_HOLES = Fault("vehicles.driver.sources.Sources._find_hole", lambda *_: None)
"""A curve over a hole in the received positions counts as a known path."""

LOST_SOON = Fault("vehicles.driver.settings.LOST_PERIODS", 1.0)
"""A source is lost after one period without a message."""

EXTRAPOLATE = "control.degradation.reaction=extrapolate"
NO_HISTORY = "sending.path_history_m=0"
LATE = "control.degradation.lost_s=1.0"
WEAKER = ("control.gains={lateral_rad_per_m=4e-5, heading_rad_per_rad=0.002, yaw_rate_s=0.0}",)
HASTY = tuple(f"control.degradation.{key}" for key in ("lost_s=0.2", "lost_s_max=0.2"))
SOFT = "speed.gap.braking_mps2_max=2.0", EXTRAPOLATE
SLOW = "control.degradation.probation_s=4.0"


@dataclass(frozen=True)
class Plant:
    """Settings or a fault for a drill, and the limits that they must break."""

    drill: str
    breaks: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    fault: Fault | None = None

    def __str__(self) -> str:
        planted = self.overrides or (self.fault.place.rpartition(".")[2] if self.fault else "",)
        return f"{self.drill}: {', '.join(self.breaks)} by {' '.join(planted)}"


ERROR, GAP = "cross_track_error_m_max", "true_gap_m_min"
SELF_ESTIMATE = "self_estimate_error_m_max"


def _alone(vehicle: str) -> str:
    """Extrapolation for one vehicle, while the others degrade."""
    return f"vehicle.{vehicle}.control.degradation.reaction=extrapolate"


PLANTS = (
    Plant("lead_lost", (ERROR,), fault=WHEELS_STRAIGHT),
    Plant("lead_lost", (GAP,), (_alone("v3"),)),
    Plant("lead_lost", ("modes[0]", "modes[1]"), (EXTRAPOLATE,)),
    Plant("lead_lost", ("modes[0]", "modes[1]"), (LATE,)),
    Plant("lead_lost", ("recovery[0]",), (SLOW,)),
    Plant("predecessor_lost", (ERROR,), WEAKER),
    Plant("predecessor_lost", ("modes[0]",), (LATE,)),
    Plant("predecessor_lost", ("recovery[0]",), (SLOW,)),
    Plant("both_lost", (ERROR,), fault=WHEELS_STRAIGHT),
    Plant("both_lost", ("modes[0]",), (EXTRAPOLATE,)),
    Plant("both_lost", ("recovery[0]",), (SLOW,)),
    Plant("burst_worst", (ERROR,), fault=WHEELS_ASKEW),
    Plant("burst_worst", ("recovery[0]",), ("control.degradation.probation_s=5.0",)),
    Plant("tunnel", (ERROR,), fault=WHEELS_ASKEW),
    Plant("tunnel", (GAP,), (_alone("v3"),)),
    Plant("tunnel", ("recovery[0]",), (SLOW,)),
    Plant("frozen_transmitter", (ERROR,), WEAKER),
    Plant("frozen_transmitter", ("sources[0]",), fault=TRUSTS_ALL),
    Plant("frozen_transmitter", ("sources[0]",), (EXTRAPOLATE,)),
    Plant("frozen_transmitter", ("recovery[0]",), (SLOW,)),
    Plant("ghost_vehicle", (ERROR,), WEAKER),
    Plant("ghost_vehicle", ("distrusts_max",), ("control.degradation.gate_deviations=1.0",)),
    Plant("overconfident_gnss", (ERROR,), WEAKER),
    Plant("overconfident_gnss", ("recovery[0]",), (SLOW,)),
    Plant("rtk_lost", (ERROR, SELF_ESTIMATE), fault=TRUSTS_FIXES),
    Plant("drifting_receiver", (ERROR, SELF_ESTIMATE), fault=NO_LASTING_ERRORS),
    Plant("clock_off", (ERROR,), WEAKER),
    Plant("clock_off", ("distrusts_max",), ("control.degradation.gate_deviations=1.0",)),
    Plant("clock_off", (GAP,), ("speed.gap.headway_s=0.3",)),
    Plant("restarted_follower", ("collisions_max", GAP), (EXTRAPOLATE,)),
    Plant("restarted_follower", (ERROR, "recovery[0]"), ("change.0.for_s=2.5",)),
    Plant("late_joiner", (ERROR, "modes[0]"), fault=NEEDS_MANY),
    Plant("congested_channel", ("stops_max",), HASTY, LOST_SOON),
    Plant("congested_channel", ("distrusts_max",), ("control.degradation.gate_deviations=1.0",)),
    Plant("congested_channel", (GAP, ERROR), ("convoy.gap_m=6.0",)),
    Plant("persistent_collisions", (ERROR,), fault=WHEELS_ASKEW),
    Plant("persistent_collisions", (GAP,), ("convoy.gap_m=11.0",)),
    Plant("router_restarted", (ERROR,), fault=WHEELS_STRAIGHT),
    Plant("router_restarted", ("modes[0]",), (EXTRAPOLATE,)),
    Plant("router_restarted", ("recovery[0]",), (SLOW,)),
    Plant("emergency_braking", ("collisions_max", GAP), SOFT),
    Plant("hard_braking", ("collisions_max", GAP), SOFT),
    Plant("hard_braking", (GAP,), fault=CONSTANT_SPEED),
    Plant("lapped_convoy", ("collisions_max",), ("speed.lead_keeps_gap=false",)),
    Plant("lapped_convoy", ("collisions_max",), fault=IGNORES_CONVOY),
    Plant("host_cut", ("collisions_max", GAP), fault=NO_STOP_ANNOUNCED),
    Plant("guessed_road", (ERROR, "lane_departures_max", "recovery[0]"), (NO_HISTORY,), NO_HOLES),
    Plant("flapping_links", (ERROR,), fault=WHEELS_STRAIGHT),
    Plant("flapping_links", ("recovery[0]", "recovery[1]"), (SLOW,)),
)
