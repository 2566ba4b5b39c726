"""The messages a vehicle sends: poses on the wire, and what it reports about itself to the log.

These dataclasses are a boundary, so every field carries its unit. Frames: "east/north" is the
local tangent plane at the scenario's origin (WGS84), yaw is counter-clockwise from east, left is
positive for lateral error, curvature and steering. `heading_deg` is a compass course (clockwise
from north). Instants are integer nanoseconds of Unix time, on the run's schedule. A field that was
added later has a default, for logs that lack it; the rule is in transport/convoy.proto.

Treat messages as immutable. They are not frozen because frozen dataclasses take three times as long
to construct, and a run makes a thousand a second for each vehicle.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

Mode = Literal["path", "composite", "lead", "predecessor", "coast", "stop", "straight"]
"""What a vehicle steers along: its own path (the lead), the composite of both sources, one source
only, what it still knows of the road without hearing anybody, or only of road behind it (slowing
down in "coast", braking to a standstill in "stop"), or straight ahead (nothing heard yet)."""

SourceStatus = Literal["unheard", "fresh", "late", "lost", "distrusted", "probation"]
"""What a follower makes of a source: never heard; heard as expected; some messages overdue; silent
for too long; heard, but not believed; heard again, and not relied on yet."""

FloatOrNan = Annotated[float, "NaN where there is nothing to measure"]
"""A number that may be missing; every other number of a message is finite."""
FixState = Literal["fixed", "float", "single"]
"""How a receiver knows its place: carrier phases fixed (RTK), not yet fixed, or by code alone.

Without a fix nothing is measured, and nothing sent."""
Outcome = Literal["delivered", "dropped"]
Level = Literal["debug", "info", "warning", "error", "alert", "fatal"]
"""Severity of a line in the log. "alert" puts the figures of the run in doubt, such as clocks that
disagree; "fatal" ends its vehicle."""


class Announcement(NamedTuple):
    """What a vehicle tells those behind beside its pose, as a CAM tells of lights and acceleration.

    `acceleration_mps2` is what it asked of its drive, `path_offset_m` how far the place it tells
    lies to the left of the lead's path, as it knows that path, `stops_at_ns` when it begins to
    stop.
    """

    mode: Mode = "path"
    hazard: bool = False
    acceleration_mps2: float = 0.0
    path_offset_m: float = float("nan")
    stops_at_ns: int = 0


NO_ANNOUNCEMENT = Announcement()


@dataclass(slots=True, kw_only=True)
class GpsPose:
    """One measurement of a GNSS receiver, as broadcast to the convoy.

    `seq` counts what was sent. `position_accuracy_m` is what the receiver says of the standard
    deviation of its position, per axis, which may be wrong. `mode`, `hazard` and
    `acceleration_mps2` tell those behind what the vehicle is about to do: what it steers along,
    whether it warns of itself, and the acceleration that it has asked of its drive. `path_offset_m`
    is how far the place that it tells lies to the left of the lead's path, as a follower knows that
    path: NaN from whoever has none to know, the lead itself among them. `stops_at_ns` is the
    instant from which on it brakes hard to stop, or will unless it hears more; 0 if it does not
    mean to. The true place of the antenna, and the metres driven since the start, are for the
    emulated channel alone, whose losses depend on them: no vehicle uses them.
    """

    vehicle: str
    seq: int
    measured_at_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    heading_deg: float
    speed_mps: float
    yaw_rate_radps: float
    sent_at_ns: int
    fix: FixState
    position_accuracy_m: float
    true_east_m: float
    true_north_m: float
    true_distance_m: float
    mode: Mode
    hazard: bool
    acceleration_mps2: float
    path_offset_m: FloatOrNan = float("nan")
    stops_at_ns: int = 0


@dataclass(slots=True, kw_only=True)
class TruePose:
    """The state of the simulated car, which only the log and the viewer may see.

    What its tyres do follows from the state and the acceleration asked for: slip angles of the
    axles, negative in a left turn, and the share of the friction that the busier axle uses, which
    only linear tyres carry beyond 1.
    """

    vehicle: str
    seq: int
    true_at_ns: int
    east_m: float
    north_m: float
    yaw_rad: float
    speed_mps: float
    lateral_speed_mps: float
    yaw_rate_radps: float
    steering_rad: float
    distance_m: float
    lateral_acceleration_mps2: float
    front_slip_rad: float
    rear_slip_rad: float
    friction_ratio: float


@dataclass(slots=True, kw_only=True)
class CompositeTrajectory:
    """The arc spline a vehicle steers along and the received samples it was fitted to.

    Piece i starts at (piece_east_m[i], piece_north_m[i]) with piece_yaw_rad[i] and bends with
    piece_curvature_per_m[i], which grows by piece_curvature_rate_per_m2[i] along it, over
    piece_length_m[i]. `sample_source[j]` names where sample j came from: 0 lead, 1 predecessor.
    """

    vehicle: str
    seq: int
    decided_at_ns: int
    mode: Mode
    piece_east_m: tuple[float, ...]
    piece_north_m: tuple[float, ...]
    piece_yaw_rad: tuple[float, ...]
    piece_curvature_per_m: tuple[float, ...]
    piece_length_m: tuple[float, ...]
    sample_east_m: tuple[float, ...]
    sample_north_m: tuple[float, ...]
    sample_source: tuple[int, ...]
    residual_m_rms: float
    residual_m_max: float
    piece_curvature_rate_per_m2: tuple[float, ...] = ()


@dataclass(slots=True, kw_only=True)
class Tracking:
    """What a vehicle knows at a command: its errors, and how fresh what it follows is.

    Errors are against the trajectory it steers along, as it estimates them. Of each source: the age
    of the newest sample, the period at which its messages are expected, the share of them that was
    received in the last second, how far ahead of the car its path is known (negative: it ends
    behind), and what is made of it. `known_m` is the path known of all of them; the braking
    distances are those from the present speed, comfortably and firmly; `blind_m` is how far the
    car would drive beyond the known path if it had to stop now as hard as it may.
    `predecessor_weight_ratio` is the weight of the predecessor in the trajectory. `hazard` says
    whether the vehicle warns those behind.
    """

    vehicle: str
    seq: int
    decided_at_ns: int
    mode: Mode
    reason: str
    lateral_error_m: float
    heading_error_rad: float
    yaw_rate_error_radps: float
    curvature_per_m: float
    gap_m: FloatOrNan
    lead_age_s: FloatOrNan
    predecessor_age_s: FloatOrNan
    lead_period_s: FloatOrNan
    predecessor_period_s: FloatOrNan
    lead_received_ratio: FloatOrNan
    predecessor_received_ratio: FloatOrNan
    lead_known_m: FloatOrNan
    predecessor_known_m: FloatOrNan
    lead_status: SourceStatus
    predecessor_status: SourceStatus
    known_m: FloatOrNan
    comfortable_stop_m: FloatOrNan
    firm_stop_m: FloatOrNan
    blind_m: FloatOrNan
    predecessor_weight_ratio: FloatOrNan
    hazard: bool


@dataclass(slots=True, kw_only=True)
class Command:
    """What a vehicle asks of its steering and drive."""

    vehicle: str
    seq: int
    decided_at_ns: int
    steering_rad: float
    feedforward_rad: float
    feedback_rad: float
    acceleration_mps2: float
    target_speed_mps: float


@dataclass(slots=True, kw_only=True)
class LinkVerdict:
    """What the directed link sender → vehicle did to message `pose_seq`, and why.

    `late` means that the message physically came after the tick that should have heard it,
    `copies` how many copies the channel made of it besides. `content` says what of it the channel
    made false (nothing: empty), kinds joined by "+", or of what was dropped as corrupted, by which
    reason the receiver's gate refused it (by its frame check: empty).
    """

    vehicle: str
    seq: int
    sender: str
    pose_seq: int
    measured_at_ns: int
    outcome: Outcome
    reason: str
    visible_at_ns: int
    received_at_ns: int
    late: bool
    sent_at_ns: int
    copies: int
    content: str


@dataclass(slots=True, kw_only=True)
class Health:
    """How a vehicle's process is doing; counters run from the start. The last one says `final`."""

    vehicle: str
    seq: int
    reported_at_ns: int
    ticks: int
    late_ticks: int
    lateness_ms_max: float
    received: int
    dropped: int
    late_messages: int
    rejected_messages: int
    published: int
    memory_bytes: int
    cpu_ratio: float
    final: bool


@dataclass(slots=True, kw_only=True)
class LogText:
    """One line of text for the log."""

    vehicle: str
    seq: int
    logged_at_ns: int
    level: Level
    text: str

    @property
    def ends_vehicle(self) -> bool:
        """Whether the vehicle cannot drive on and leaves the run."""
        return self.level == "fatal"

    @property
    def doubts_figures(self) -> bool:
        """Whether the line belongs to the warnings of the run's summary."""
        return self.level == "alert"


@dataclass(slots=True, kw_only=True)
class Change:
    """Something done to a running convoy at an instant: by its scenario, or by hand.

    `vehicle` is the one that carried it out: of a link the receiver. It takes effect at
    `effective_at_ns`: of a link on what is sent from then on, of a vehicle at its first tick from
    then on. `table` is the change as an entry of `[[change]]` in a scenario, in JSON.
    """

    vehicle: str
    seq: int
    effective_at_ns: int
    kind: str
    by_hand: bool
    table: str


@dataclass(slots=True, kw_only=True)
class RunStart:
    """The one instant at which every vehicle of a run starts its schedule."""

    vehicle: str
    seq: int
    start_at_ns: int
    run_id: str


@dataclass(slots=True, kw_only=True)
class RunEnd:
    """The run is over and its log is complete; an empty reason means as planned."""

    vehicle: str
    seq: int
    end_at_ns: int
    reason: str


Message = (
    GpsPose
    | TruePose
    | CompositeTrajectory
    | Tracking
    | Command
    | LinkVerdict
    | Health
    | LogText
    | Change
    | RunStart
    | RunEnd
)
