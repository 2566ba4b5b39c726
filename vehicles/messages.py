"""Messages of a vehicle: poses broadcast to the convoy, and reports for the log.

Every field carries its unit. Frames: "east/north" is the local tangent plane at the scenario's
origin (WGS84); yaw is counter-clockwise from east; left is positive for lateral error, curvature
and steering. `heading_deg` is a compass course (clockwise from north). Instants are integer
nanoseconds of Unix time, on the run's schedule. Fields added later have defaults, for logs that
lack them; the rule is in transport/convoy.proto.

Treat messages as immutable. They are not frozen because frozen dataclasses take three times as long
to construct.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, cast

Mode = Literal[
    "path",
    "composite",
    "lead",
    "predecessor",
    "intermediate",
    "coast",
    "stop",
    "straight",
]

MODES: dict[Mode, str] = {
    "path": "the lead: along its own path",
    "composite": "along a trajectory through the poses of several vehicles",
    "lead": "along the path from the poses of the lead only",
    "predecessor": "along the path from the poses of the predecessor only",
    "intermediate": "along the path from the poses of one vehicle between lead and predecessor",
    "coast": "along the last trajectory without a source, at full speed",
    "stop": "along the known path without a source; brakes to a standstill",
    "straight": "straight ahead until the first poses give a trajectory",
}

State = Literal["", "start", "follow", "alone", "return", "stop"]
"""State of a follower that reacts to missing messages (`vehicles.driver.modes`); empty for others.
"""

Override = Literal[
    "",
    "contact",
    "announced stop",
    "known path",
    "alone",
    "return",
    "catch-up",
    "unproven",
    "position",
]
OVERRIDES: dict[Override, str] = {
    "": "the longitudinal law acts",
    "contact": "brakes for the vehicle ahead, as received or measured",
    "announced stop": "brakes for a stop that the silent predecessor announced",
    "known path": "slows down or stops within the known path",
    "alone": "without the predecessor: drives as the lead does, or by the gap sensor",
    "return": "slowly back to its path, or not yet faster after a silence",
    "catch-up": "not faster than the lead's speed times speed.catch_up_ratio",
    "unproven": "brakes more mildly than the law, as nothing received or measured requires more",
    "position": "drives slower as its own position is uncertain",
}
"""Reasons why the acceleration of a follower is not that of its longitudinal law."""

SourceStatus = Literal["unheard", "fresh", "late", "lost", "distrusted", "probation", "unused"]
"""Status of a source at its follower: no message yet; messages as expected; messages overdue; none
for too long; poses rejected as implausible; poses accepted again, but not used yet; not received by
this follower, whose information flow is another."""

FloatOrNan = Annotated[float, "NaN where there is nothing to measure"]
"""A number that may be missing. All other numbers of messages are finite."""
FixState = Literal["fixed", "float", "single"]
"""Kind of a position fix: carrier-phase ambiguities fixed (RTK), not yet fixed, or code only."""
Outcome = Literal["delivered", "dropped"]
Level = Literal["debug", "info", "warning", "error", "alert", "fatal"]
"""Severity of a log line. "alert" casts doubt on the run's results, as when clocks disagree;
"fatal" ends its vehicle."""


class Announcement(NamedTuple):
    """Intentions that a vehicle broadcasts with its pose; see `GpsPose` for the fields."""

    mode: Mode = "path"
    hazard: bool = False
    acceleration_mps2: float = 0.0
    path_offset_m: float = float("nan")
    stops_at_ns: int = 0
    leaving: bool = False
    relayed_stops_at_ns: tuple[int, ...] = ()
    achieved_acceleration_mps2: float = 0.0


NO_ANNOUNCEMENT = Announcement()


def statuses_in(other_sources: str) -> dict[str, SourceStatus]:
    """Parse `Tracking.other_sources`, names with their statuses; a name without one is left out."""
    words = other_sources.replace(",", "").split()
    return dict(zip(words[::2], cast("list[SourceStatus]", words[1::2]), strict=False))


@dataclass(slots=True, kw_only=True)
class GpsPose:
    """One GNSS fix, as broadcast to the convoy.

    `seq` counts sent messages. `position_accuracy_m` is the receiver's reported standard deviation
    per axis, which may be wrong. `mode`, `hazard` and `acceleration_mps2` (commanded) announce what
    the vehicle is about to do; `achieved_acceleration_mps2` is what its drive has reached.
    `path_offset_m` is the offset of the reported position to the left
    of the lead's path, as estimated by a follower; NaN from the lead and without an estimate.
    `stops_at_ns` is the instant from which the vehicle brakes to a stop unless it receives more
    poses; 0 if no stop is planned. `leaving`: the vehicle leaves the convoy, a human drives it from
    now on. `relayed_stops_at_ns`, from the lead only, repeats the `stops_at_ns` that it received
    last from each follower, in their order; 0 for none. The true position of the antenna and the
    true distance driven are for the emulated channel only; vehicles do not use them.

    The history is the path just driven (SAE J2735, path history): positions whose chords lie within
    5 cm of the measured ones, newest first. Each is a difference from the previous position in the
    list, the first one from the pose: latitude and longitude in 1e-7 degrees, age in 10 ms. It
    restarts while the vehicle announces a hazard or the mode coast or stop.
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
    history_latitude_e7deg: tuple[int, ...] = ()
    history_longitude_e7deg: tuple[int, ...] = ()
    history_age_cs: tuple[int, ...] = ()
    leaving: bool = False
    relayed_stops_at_ns: tuple[int, ...] = ()
    achieved_acceleration_mps2: float = 0.0


@dataclass(slots=True, kw_only=True)
class TruePose:
    """True state of the simulated car, for the log and the viewer only.

    Slip angles of the axles are negative in a left turn. `friction_ratio` is the share of friction
    used by the more heavily used axle; it exceeds 1 only with linear tyres.
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
    """Arc spline that a vehicle steers along, and the received samples that it was fitted to.

    Piece i starts at (piece_east_m[i], piece_north_m[i]) in direction piece_yaw_rad[i]. Its
    curvature starts at piece_curvature_per_m[i] and grows by piece_curvature_rate_per_m2[i] over
    piece_length_m[i]. `sample_source[j]` is the source of sample j: 0 the lead, else k for the k-th
    vehicle ahead, of which 1 is the predecessor.
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
    """A vehicle's estimate of its errors and of the state of its sources, at a command.

    Errors are estimates, relative to the trajectory that the vehicle steers along. For each source:
    age of the newest sample, expected period of its messages, share of them received in the last 10
    seconds, length of its known path ahead of the car (negative if it ends behind), and status.
    `known_m` is the known path from all sources, `blind_m` the distance the car would drive beyond
    it in an emergency stop. `predecessor_weight_ratio` is the predecessor's weight in the
    trajectory. `hazard`: the vehicle warns its followers.
    `estimated_gap_m` is along the path from the predecessor's rear bumper to the own front bumper;
    the lengths of both cars are those of the scenario.
    `lateral_deviation_m` is the estimated standard deviation of the own position across the body of
    the car.
    `measured_gap_m` and `measured_gap_rate_mps` are those of the on-board gap sensor, predicted to
    the command; NaN without a sensor or a measurement.
    `other_sources` lists the sources that are neither lead nor predecessor, from front to back,
    each as "NAME STATUS", joined by commas. Their figures are in the same order.
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
    blind_m: FloatOrNan
    predecessor_weight_ratio: FloatOrNan
    hazard: bool
    estimated_gap_m: FloatOrNan = float("nan")
    lateral_deviation_m: FloatOrNan = float("nan")
    measured_gap_m: FloatOrNan = float("nan")
    measured_gap_rate_mps: FloatOrNan = float("nan")
    other_sources: str = ""
    other_age_s: tuple[FloatOrNan, ...] = ()
    other_received_ratio: tuple[FloatOrNan, ...] = ()
    other_known_m: tuple[FloatOrNan, ...] = ()
    other_weight_ratio: tuple[FloatOrNan, ...] = ()
    state: State = ""

    def statuses(self) -> dict[str, SourceStatus]:
        return statuses_in(self.other_sources)


@dataclass(slots=True, kw_only=True)
class Command:
    """Command to steering and drive.

    `law_acceleration_mps2` is that of the longitudinal law, NaN without one, and `override` the
    reason why `acceleration_mps2` differs from it, one of `OVERRIDES`.
    """

    vehicle: str
    seq: int
    decided_at_ns: int
    steering_rad: float
    feedforward_rad: float
    feedback_rad: float
    acceleration_mps2: float
    target_speed_mps: float
    law_acceleration_mps2: FloatOrNan = float("nan")
    override: Override = ""


@dataclass(slots=True, kw_only=True)
class LinkVerdict:
    """Outcome of message `pose_seq` on the link sender → vehicle, and its reason.

    `late`: the message arrived after the tick that should have used it. `copies` is the number of
    duplicates made by the channel. `content` lists how the channel altered a delivered message,
    kinds joined by "+"; empty if unaltered. For a message dropped as corrupted, it is the reason of
    the receiver's gate, or empty if the frame check failed. `arrived_at_ns` is when it reached the
    receiver's process, 0 in virtual time.
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
    arrived_at_ns: int = 0


@dataclass(slots=True, kw_only=True)
class Health:
    """State of a vehicle's process. Counters run from the start; the last message has `final`.

    `clock_offset_ms` is how far the process's clock was ahead of the recorder's, which is
    corrected up to `clock_uncertainty_ms`. Late ticks that are due neither to a late start nor to
    the network, where sending blocked, are due to the processor. `waiting` lists the messages that
    had arrived at the end and had no verdict yet, by their numbers: "SENDER FIRST LAST", joined by
    commas.
    """

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
    clock_offset_ms: float = 0.0
    clock_uncertainty_ms: float = 0.0
    late_ticks_at_start: int = 0
    late_ticks_by_network: int = 0
    waiting: str = ""


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
        return self.level == "fatal"


@dataclass(slots=True, kw_only=True)
class Change:
    """A change to a running convoy, from its scenario or by hand.

    `vehicle` carries it out; for a link that is the receiver. From `effective_at_ns` on, a change
    of a link applies to messages sent, and a change of a vehicle applies at its next tick. `table`
    is the change as an entry of `[[change]]` in a scenario, in JSON.
    """

    vehicle: str
    seq: int
    effective_at_ns: int
    kind: str
    by_hand: bool
    table: str


@dataclass(slots=True, kw_only=True)
class RunStart:
    """Common start of all vehicles' schedules."""

    vehicle: str
    seq: int
    start_at_ns: int
    run_id: str


@dataclass(slots=True, kw_only=True)
class RunEnd:
    """End of the run, sent when its log is complete; `reason` is empty after a planned end."""

    vehicle: str
    seq: int
    end_at_ns: int
    reason: str
    run_id: str = ""


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
