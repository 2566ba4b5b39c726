"""The tables of a scenario file: keys with units, defaults and limits.

Keys of numbers end in a unit. Types are not converted; unknown keys, NaN and infinity are errors.
Headings are compass courses. Curvature and lateral offsets are positive to the left.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AwareDatetime, BeforeValidator, Field, StringConstraints, model_validator

from scenarios.definition.schema.change_tables import Changes
from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.definition.schema.link_tables import InformationFlowTable, LinkEntry, LinkTable
from scenarios.definition.schema.path_tables import Bound, PathTable, PointsPath, VehicleName
from scenarios.definition.schema.plug_ins.points import (
    EVENT,
    FIGURE,
    FUSION,
    LATERAL,
    LONGITUDINAL,
    REACTION,
    RECEIVER_ERROR,
    SENDING,
)
from scenarios.definition.schema.plug_ins.table import PlugInTable, default_of, plug_in
from scenarios.definition.schema.settings_table import (
    Name,
    NotNegative,
    Ratio,
    SettingsTable,
    Speed,
    Table,
    keys_with,
    one_of,
    table_with,
)
from transport.links.laws.outages import ReceiverOff, TransmitterOff
from vehicles.car.gnss_error_terms import ErrorTerm
from vehicles.car.gnss_settings import ERRORS, PRESET_OF_STATE, PRESETS, GnssSettings, StateErrors
from vehicles.car.imu import ImuSettings
from vehicles.car.parameters import NOMINAL_GAINS, Loading
from vehicles.car.sending_rules import RULES, EveryFix, SendingRule
from vehicles.car.sensors import GapSensorSettings
from vehicles.driver.controller import GapLimits
from vehicles.driver.settings import DegradationSettings
from vehicles.preview.curve_fit import FitSettings

# ---- The table of vehicles that repeat a recorded run


class ReplayTable(Table):
    """Vehicles that send their messages of a recorded run again; the others are simulated.

    A replayed vehicle sends its recorded poses at their times, and its true poses for the log. It
    receives and decides nothing. Links and their losses act as usual in the receivers. `convoy
    replay` writes this table.

    log         log of the recorded run
    vehicles    names of the replayed vehicles
    partial     whether a damaged or incomplete log is used; its poses are numbered again
    digest      checksum of the log, written by the program; do not set
    recorded_s  first and last recorded time, written by the program; do not set
    """

    log: Annotated[str, StringConstraints(min_length=1)]
    vehicles: Annotated[tuple[Name, ...], Field(strict=False, min_length=1)]
    partial: bool = False
    digest: str = ""
    recorded_s: Annotated[tuple[float, float], Field(strict=False)] | None = None


# ---- The table of the log


LoggedRate = Annotated[float, Field(ge=0, le=1000)]


class LogTable(Table):
    """Largest rates of messages in the log, per vehicle. Omitted: no limit. 0: nothing is logged.

    The summary counts all messages in any case. Trajectories and commands that are not logged are
    not sent, so the live viewer does not show them.

    truth_rate_hz       true poses
    trajectory_rate_hz  fitted trajectories
    tracking_rate_hz    tracking errors
    command_rate_hz     commands
    verdicts            whether the verdict of each link on each message is logged
    """

    truth_rate_hz: LoggedRate | None = None
    trajectory_rate_hz: LoggedRate | None = None
    tracking_rate_hz: LoggedRate | None = None
    command_rate_hz: LoggedRate | None = None
    verdicts: bool = True

    @property
    def rates_hz(self) -> dict[str, float]:
        """Largest rate by topic, for topics that are not logged completely."""
        rates = {
            "truth": self.truth_rate_hz,
            "trajectory": self.trajectory_rate_hz,
            "tracking": self.tracking_rate_hz,
            "command": self.command_rate_hz,
            "verdict": None if self.verdicts else 0.0,
        }
        return {topic: rate for topic, rate in rates.items() if rate is not None}


# ---- The table of a GNSS receiver, completed by its preset


if TYPE_CHECKING:
    ErrorPlugIn = SettingsTable[ErrorTerm]
else:
    ErrorPlugIn = plug_in(RECEIVER_ERROR, one_of(ERRORS))


class GnssTable(SettingsTable[GnssSettings]):
    """The emulated GNSS receiver. Its keys replace the values of a `preset`."""

    errors: Annotated[tuple[ErrorPlugIn, ...], Field(strict=False)] = ()

    @model_validator(mode="before")
    @classmethod
    def _lay_presets_under(cls, given: Any) -> Any:
        """Fill in the preset's values of keys that are not given."""
        if not isinstance(given, dict):
            return given
        under = [figures for preset, figures in PRESETS.items() if preset == given.get("preset")]
        whole = _laid_over(keys_with(GnssSettings, under[0]) if under else {}, given)
        for state, usual in PRESET_OF_STATE.items():
            key = f"while_{state}"
            if isinstance(whole.get(key), dict):
                figures = {one: value for one, value in PRESETS[usual].items() if one != "fix"}
                whole[key] = _laid_over(keys_with(StateErrors, figures), whole[key])
        return whole


def _laid_over(under: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Merge two tables and the tables inside them; `given` keys win."""
    whole = {**under, **given}
    for key, value in under.items():
        if isinstance(value, dict) and isinstance(given.get(key), dict):
            whole[key] = {**value, **given[key]}
    return whole


# ---- Scenario tables


FIT = FitSettings()
GAP_LIMITS = GapLimits()
EPOCH, LATEST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
"""Range in which instants fit into the unsigned 64 bits of nanoseconds of a log."""


if TYPE_CHECKING:
    SendingTable = SettingsTable[SendingRule]
    LateralPlugIn = PlugInTable
    LongitudinalPlugIn = PlugInTable
    FusionPlugIn = PlugInTable
    ReactionPlugIn = PlugInTable
    EventPlugIn = PlugInTable
    FigurePlugIn = PlugInTable
else:
    SendingTable = plug_in(SENDING, one_of(RULES))
    LateralPlugIn, LongitudinalPlugIn = plug_in(LATERAL), plug_in(LONGITUDINAL)
    FusionPlugIn, ReactionPlugIn = plug_in(FUSION), plug_in(REACTION)
    EventPlugIn, FigurePlugIn = plug_in(EVENT), plug_in(FIGURE)


class OriginTable(Table):
    """Origin of the east-north plane (WGS84).

    Default: the first point of a geodetic trace; otherwise the values below.

    latitude_deg   latitude; at the poles there is no east
    longitude_deg  longitude
    altitude_m     height above the ellipsoid
    """

    latitude_deg: float = Field(default=30.6380, ge=-89, le=89)
    longitude_deg: float = Field(default=-96.4810, ge=-180, le=180)
    altitude_m: float = Field(default=80.0, ge=-500, le=10_000)


class ConvoyTable(Table):
    """The vehicles, the lead first.

    A gap is measured from bumper to bumper. A configured or estimated gap is along the path; a true
    gap is the shortest distance between the bodies.

    vehicles                  number of vehicles
    names                     names, the lead first; default v1, v2, …
    gap_m                     initial gaps; default 10 m, or the gap that followers keep
    on_vehicle_failure        "end" the run, or "continue" without the failed vehicle
    clock_uncertainty_ms_max  how exactly clocks are known when a wall-clock run starts; default
                              half the smallest links.latency_ms, at least 5 ms
    """

    vehicles: int = Field(default=4, ge=1, le=200)
    names: Annotated[tuple[Name, ...], Field(strict=False)] = ()
    gap_m: float | None = Field(default=None, gt=0, le=1000)
    on_vehicle_failure: Literal["end", "continue"] = "end"
    clock_uncertainty_ms_max: float | None = Field(default=None, gt=0, le=60_000)

    @property
    def vehicle_names(self) -> tuple[str, ...]:
        return self.names or tuple(f"v{place}" for place in range(1, self.vehicles + 1))


class GainsTable(Table):
    """Feedback gains of the steering law (paper, Section III-E).

    lateral_rad_per_m    steering per lateral error
    heading_rad_per_rad  steering per heading error
    yaw_rate_s           steering per yaw rate error
    """

    lateral_rad_per_m: float = Field(default=NOMINAL_GAINS.lateral, ge=0, le=10)
    heading_rad_per_rad: float = Field(default=NOMINAL_GAINS.heading, ge=0, le=100)
    yaw_rate_s: float = Field(default=NOMINAL_GAINS.yaw_rate, ge=0, le=10)


class DegradationTable(SettingsTable[DegradationSettings]):
    """Reaction to missing data: thresholds of degradation, and levels of braking.

    The shortest silence of a lost source follows openpilot, the gate follows PX4's EKF2.
    Comfortable braking is the upper end of what passengers accept (Hoberock, 1977), emergency
    braking is hard braking on a dry road, as in [speed.gap].
    """

    reaction: ReactionPlugIn = default_of(REACTION)

    @property
    def reaction_word(self) -> str:
        """Shipped reaction; a policy of the user degrades as `Degrade` if it inherits it."""
        if not self.reaction.is_own:
            return self.reaction.use
        degrades = getattr(self.reaction.plugged, "degrades", False)
        return "degrade" if degrades else "extrapolate"

    def values(self) -> dict[str, Any]:
        return super().values() | {"reaction": self.reaction_word}


class SteeringTable(Table):
    """Trajectory and steering of a vehicle.

    controller     lateral controller: "slip_compensated": the paper's law, with steady-state slip
                   in curves compensated; "feedforward_feedback": the paper's law; "stanley";
                   "pure_pursuit"; or your own class, "module.Class" (convoy reference plug-ins). A
                   table with parameters has the name as its key `use`
    longitudinal   longitudinal controller of a follower with speed.followers = "gap": "gap": the
                   law of PATH with a time gap; "acc": no radio data but the gap; "cacc": PATH;
                   "ploeg"; "flatbed"; "consensus"; or your own class, likewise
    fusion         "composite": one trajectory from all lateral sources of [information_flow];
                   "blend": one steering command from each; or your own class
    trajectory     "fitted": curve fitted to the samples. Baselines that are inaccurate for radii
                   below 300 m or noisy poses: "paper": a line within tolerance_m, else one circle
                   (Section III-B); "paper_prefix": the longest line first, then a circle (Section
                   III-A)
    alpha_ratio    weight of the predecessor; the other sources share the rest equally
    preview_s      length of the preview, as a time at the current speed
    tolerance_m    largest distance of samples from a trajectory
    knows_loading  whether controller and estimator know the load of the car
    estimate_slip  whether to estimate slip online, to compensate an unknown load
    own_state      "estimated" from receiver and inertial sensor, or "exact"; broadcast poses are
                   measured in any case
    gains          feedback gains
    degradation    behaviour without data
    """

    controller: LateralPlugIn = default_of(LATERAL)
    longitudinal: LongitudinalPlugIn = default_of(LONGITUDINAL)
    fusion: FusionPlugIn = default_of(FUSION)
    trajectory: Literal["fitted", "paper", "paper_prefix"] = "fitted"
    alpha_ratio: Ratio = 0.5
    preview_s: float = Field(default=FIT.preview_time, ge=0.1, le=10)
    tolerance_m: float = Field(default=FIT.tolerance, gt=0, le=10)
    knows_loading: bool = False
    estimate_slip: bool = True
    own_state: Literal["estimated", "exact"] = "estimated"
    gains: GainsTable = GainsTable()
    degradation: DegradationTable = DegradationTable()


class ControlTable(SteeringTable):
    """Steering of all vehicles.

    rate_hz  rate of control
    """

    rate_hz: float = Field(default=50.0, ge=5, le=500)


class ProfilePoint(Table):
    """A point of a speed profile, which is linear between points.

    at_s       time after the start of the run
    speed_mps  speed
    """

    at_s: NotNegative
    speed_mps: Speed


class OscillationTable(Table):
    """Sinusoidal speed of the lead around speed.set_mps, with speed.lead = "oscillating".

    amplitude_mps  amplitude
    frequency_hz   frequency
    from_s         beginning, after the start of the run
    """

    amplitude_mps: NotNegative = 1.0
    frequency_hz: float = Field(default=0.2, ge=0.001, le=5)
    from_s: NotNegative = 0.0


class GapTable(Table):
    """Gap keeping: standstill_m + headway_s * speed, bumper to bumper.

    standstill_m           gap at standstill
    headway_s              time headway; 0 keeps a constant gap
    acceleration_mps2_max  largest acceleration of followers
    braking_mps2_max       largest braking of followers; more than the lead's, since poses are late
    """

    standstill_m: float = Field(default=3.0, gt=0, le=1000)
    headway_s: float = Field(default=0.5, ge=0, le=10)
    acceleration_mps2_max: float = Field(default=GAP_LIMITS.acceleration, ge=0.1, le=10)
    braking_mps2_max: float = Field(default=GAP_LIMITS.deceleration, ge=0.1, le=12)


class SpeedTable(Table):
    """Speed of the convoy.

    lead                           "set" speed, "profile", "oscillating", or "recorded" in the trace
    lead_waits                     whether the lead slows down while it receives nothing from a
                                   follower, or a follower falls behind
    lead_keeps_gap                 whether the lead keeps the gap of [speed.gap] to the last member
                                   of its convoy ahead of it on a lap of a closed path. It stands
                                   behind a silent member until that is received further on.
                                   Default: on a closed path
    set_mps                        set speed
    profile                        points of the profile
    profile_delay_s_max            the profile begins later by a time that the seed draws, up to
                                   this: with the period of the messages, braking begins anywhere
                                   between two of them
    oscillation                    sinusoidal speed around set_mps
    followers                      "same" speed as the lead at the same time, or keep a "gap"
    lateral_acceleration_mps2_max  set speeds and profiles are lowered in curves to keep it
    acceleration_mps2_max          acceleration of the lead after curves
    braking_mps2_max               braking of the lead before curves
    friction_ratio_max             largest share of the friction that followers use in curves of the
                                   path that they have received, or inf; with followers = "same"
                                   they fall behind
    catch_up_ratio                 largest speed of a follower that catches up, over the lead's, or
                                   the predecessor's without the lead; with the reaction "degrade"
    gap                            gap keeping
    """

    lead: Literal["set", "profile", "oscillating", "recorded"] = "set"
    lead_waits: bool = False
    lead_keeps_gap: bool | None = None
    set_mps: float = Field(default=20.0, ge=0.1, le=100)
    profile: Annotated[tuple[ProfilePoint, ...], Field(strict=False)] = ()
    profile_delay_s_max: float = Field(default=0.0, ge=0, le=60)
    oscillation: OscillationTable = OscillationTable()
    followers: Literal["same", "gap"] = "same"
    lateral_acceleration_mps2_max: float = Field(default=3.0, ge=0.1, le=20)
    acceleration_mps2_max: float = Field(default=1.5, ge=0.1, le=10)
    braking_mps2_max: float = Field(default=2.5, ge=0.1, le=12)
    friction_ratio_max: float = Field(default=0.8, ge=0.1, allow_inf_nan=True)
    catch_up_ratio: float = Field(default=1.1, ge=1, le=10)
    gap: GapTable = GapTable()

    @property
    def lead_receives(self) -> bool:
        """Whether the lead receives the poses of its followers."""
        return self.lead_waits or bool(self.lead_keeps_gap)


class ParametersTable(Table):
    """The car without passengers; by default a Lincoln MKZ (paper, Table I).

    mass_kg                              mass with the driver; [loading] adds to it; default 1896
    yaw_inertia_kgm2                     yaw inertia; default 3803
    front_cornering_stiffness_n_per_rad  default 400000
    rear_cornering_stiffness_n_per_rad   default 381900
    front_axle_distance_m                distance from the centre of mass; default 1.2682
    rear_axle_distance_m                 distance from the centre of mass; default 1.5818
    steering_frequency_radps             natural frequency of the steering; default 21.4813
    steering_damping_ratio               its damping; default 0.4056
    steering_limit_rad                   largest angle of the front wheels; default 0.54
    length_m                             default 4.93
    width_m                              default 1.86
    steering_rate_limit_radps            largest rate of the front wheels, or inf; 1.18 is
                                         17.5 rad/s at the steering wheel (VELOCITY_MAX in
                                         dbw_mkz_msgs/SteeringCmd) over the ratio of 14.8
    tyres                                "brush": saturating; "linear": as in the paper
    friction_ratio                       friction: dry 0.9, wet 0.6, snow 0.3
    drive_lag_s                          time constant of drive and brakes, of first order; 0: they
                                         act at once, as in the paper; Plexe assumes 0.5
    """

    mass_kg: float | None = Field(default=None, gt=100, le=100_000)
    yaw_inertia_kgm2: float | None = Field(default=None, gt=10, le=1_000_000)
    front_cornering_stiffness_n_per_rad: float | None = Field(default=None, gt=1e3, le=1e8)
    rear_cornering_stiffness_n_per_rad: float | None = Field(default=None, gt=1e3, le=1e8)
    front_axle_distance_m: float | None = Field(default=None, gt=0.1, le=20)
    rear_axle_distance_m: float | None = Field(default=None, gt=0.1, le=20)
    steering_frequency_radps: float | None = Field(default=None, gt=0.1, le=1000)
    steering_damping_ratio: float | None = Field(default=None, gt=0, le=10)
    steering_limit_rad: float | None = Field(default=None, gt=0.01, le=1.5)
    length_m: float | None = Field(default=None, gt=0.5, le=50)
    width_m: float | None = Field(default=None, gt=0.3, le=10)
    steering_rate_limit_radps: float = Field(default=1.18, ge=0.01, allow_inf_nan=True)
    tyres: Literal["linear", "brush"] = "brush"
    friction_ratio: float = Field(default=0.9, ge=0.05, le=2)
    drive_lag_s: float = Field(default=0.0, ge=0, le=5)


class EventsTable(Table):
    """Thresholds of events, by true poses.

    lane_width_m      lane width; a vehicle leaves its lane when a corner is more than half of this
                      from the lead's path; motorway lanes are 3.5 to 3.75 m wide
    near_miss_gap_m   smallest true gap without a near miss; shipped convoys keep at least 2 m
    near_miss_time_s  smallest time to collision; conflicts below 1.5 s count as severe in traffic
                      research
    path_lost_s       longest time without a received path; 1 s is longer than the preview
    """

    lane_width_m: float = Field(default=3.5, gt=0, le=100)
    near_miss_gap_m: NotNegative = 1.0
    near_miss_time_s: NotNegative = 1.5
    path_lost_s: NotNegative = 1.0


class ClockTable(Table):
    """Error of a vehicle's clock, by which it stamps its fixes and judges ages.

    offset_ms  clock minus true time at the start of the run
    drift_ppm  drift; a clock with a positive drift runs fast
    """

    offset_ms: float = Field(default=0.0, ge=-10_000, le=10_000)
    drift_ppm: float = Field(default=0.0, ge=-1000, le=1000)


class VehicleTable(Table):
    """Other values for one vehicle.

    A vehicle with `replay` follows a recorded drive and receives nothing. The drive needs times.
    With speed.lead = "recorded" and absolute times in both recordings, their time offset is kept.
    Otherwise both start at the same time.

    replay              recorded drive, of any kind that path.file may be
    replay_vehicle      vehicle of a file with several; of a run.mcap the lead by default
    replay_topic        topic of the positions in another MCAP file, where it has several
    replay_from_s       start of the part that is replayed, since the first point of the drive
    replay_to_s         end of that part
    replay_offset_s     delay of the drive
    drive               points of the drive, written by the program; do not set
    gap_m               initial gap to its predecessor
    lateral_offset_m    initial offset to the left of the path
    heading_offset_deg  initial heading relative to the path, counter-clockwise positive
    transmitter_off     times in which none of its messages is received
    receiver_off        times in which it receives nothing
    clock               error of its clock
    control             keys of [control], except rate_hz
    information_flow    keys of [information_flow]
    gnss                keys of [gnss]
    sending             keys of [sending]
    imu                 keys of [imu]
    gap_sensor          keys of [gap_sensor]
    parameters          keys of [parameters]
    loading             keys of [loading]
    """

    replay: Annotated[str, StringConstraints(min_length=1)] | None = None
    replay_vehicle: VehicleName = None
    replay_topic: str | None = None
    replay_from_s: Bound = None
    replay_to_s: Bound = None
    replay_offset_s: float = Field(default=0.0, ge=-86_400, le=86_400)
    drive: PointsPath | None = None
    gap_m: float | None = Field(default=None, gt=0, le=1000)
    lateral_offset_m: float = Field(default=0.0, ge=-20, le=20)
    heading_offset_deg: float = Field(default=0.0, ge=-90, le=90)
    transmitter_off: Annotated[tuple[TransmitterOff, ...], Field(strict=False)] = ()
    receiver_off: Annotated[tuple[ReceiverOff, ...], Field(strict=False)] = ()
    clock: ClockTable = ClockTable()
    control: SteeringTable | None = None
    information_flow: InformationFlowTable | None = None
    gnss: GnssTable | None = None
    sending: SendingTable | None = None
    imu: SettingsTable[ImuSettings] | None = None
    gap_sensor: SettingsTable[GapSensorSettings] | None = None
    parameters: ParametersTable | None = None
    loading: SettingsTable[Loading] | None = None


def _with_rule(given: object) -> object:
    """Each fix is sent unless the table has another rule."""
    if isinstance(given, dict) and given.keys().isdisjoint(("kind", "use")):
        return {"kind": "every_fix", **given}
    return given


class ScenarioTables(Table):
    """A scenario file.

    extends      scenario to start from: a shipped one, a file, or a recorded drive; its keys are
                 merged first, then validated
    name         name of the scenario
    overrides    overrides by --set and --seed, written by the program; do not set
    description  one line for `convoy list`
    duration_s   length of the run; default: until the lead reaches the end of its path, or a
                 replayed drive ends
    seed         seed of all random numbers
    start_at     start of a virtual run; ignored by real-time runs
    origin       origin of the east-north plane
    convoy       vehicles and gaps
    control      steering
    information_flow  the vehicles whose poses each follower uses
    gnss         receivers
    sending      rule of sending
    imu          inertial sensors
    gap_sensor   on-board sensors of the gap ahead, such as radars; none by default
    speed        speed of lead and followers
    path         path of the lead
    links        all links
    events       thresholds of events
    limits       limits of the run
    log          rates of the log
    replay       vehicles that send their messages of a recorded run again
    link         other values for some links
    change       changes during the run
    event        events of your own (convoy reference plug-ins)
    figure       figures of your own (convoy reference plug-ins)
    parameters   the car without passengers
    loading      passengers in addition to the driver, and luggage
    vehicle      other values for single vehicles
    """

    extends: str | None = None
    name: Name
    overrides: Annotated[tuple[str, ...] | None, Field(strict=False)] = None
    description: str = ""
    duration_s: float | None = Field(default=None, gt=0, le=86_400)
    seed: int = Field(default=1, ge=0, le=2**63 - 1)
    start_at: AwareDatetime = Field(default=datetime(2026, 1, 1, tzinfo=UTC), ge=EPOCH, lt=LATEST)
    origin: OriginTable | None = None
    convoy: ConvoyTable = ConvoyTable()
    control: ControlTable = ControlTable()
    information_flow: InformationFlowTable = InformationFlowTable()
    gnss: GnssTable = GnssTable()
    sending: Annotated[SendingTable, BeforeValidator(_with_rule)] = table_with(EveryFix(), RULES)
    imu: SettingsTable[ImuSettings] = SettingsTable[ImuSettings]()
    gap_sensor: SettingsTable[GapSensorSettings] = SettingsTable[GapSensorSettings]()
    speed: SpeedTable = SpeedTable()
    path: PathTable
    links: LinkTable = LinkTable()
    events: EventsTable = EventsTable()
    limits: LimitsTable = LimitsTable()
    log: LogTable = LogTable()
    replay: ReplayTable | None = None
    link: Annotated[tuple[LinkEntry, ...], Field(strict=False)] = ()
    change: Changes = ()
    event: Annotated[tuple[EventPlugIn, ...], Field(strict=False)] = ()
    figure: Annotated[tuple[FigurePlugIn, ...], Field(strict=False)] = ()
    parameters: ParametersTable = ParametersTable()
    loading: SettingsTable[Loading] = SettingsTable[Loading]()
    vehicle: dict[str, VehicleTable] = Field(default_factory=dict)

    @property
    def repeats_messages(self) -> frozenset[str]:
        """Vehicles that send recorded messages."""
        return frozenset(self.replay.vehicles if self.replay else ())

    @property
    def replayed(self) -> frozenset[str]:
        """Vehicles that follow a recorded drive or send recorded messages: they receive nothing."""
        drives = [name for name, own in self.vehicle.items() if own.replay is not None]
        return self.repeats_messages.union(drives)
