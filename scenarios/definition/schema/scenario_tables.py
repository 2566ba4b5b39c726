"""What a scenario file may say: its tables, their keys with units, defaults and limits.

Every number's key ends in its unit. Nothing is converted: a text where a number belongs, an
unknown key, NaN or infinity is refused. A heading is a compass course in degrees (clockwise from
north); left is positive for curvature and for offsets from the path.
"""

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AwareDatetime, Field, StringConstraints

from scenarios.definition.schema.base_table import Name, NotNegative, Ratio, Speed, Table
from scenarios.definition.schema.change_tables import Changes
from scenarios.definition.schema.gnss_table import GnssTable
from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.definition.schema.log_table import LogTable
from scenarios.definition.schema.path_tables import PathTable, PointsPath
from scenarios.definition.schema.settings_table import SettingsTable, one_of, table_with
from transport.links.laws.outages.by_time import ReceiverOff, TransmitterOff
from vehicles.car.imu_settings import ImuSettings
from vehicles.car.parameters import NOMINAL_GAINS, Loading
from vehicles.car.sending.every_fix import EveryFix
from vehicles.car.sending.rule import SendingRule
from vehicles.car.sending.sending_rules import RULES
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.speed import GapLimits
from vehicles.preview.curve_fit import FitSettings

FIT = FitSettings()
GAP_LIMITS = GapLimits()
EPOCH, LATEST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)
"""Between them instants fit into 64 bits of nanoseconds, of which a log's have no sign."""

CONTROLLERS = {
    "slip_compensated": "vehicles.driver.steering.SlipCompensated",
    "feedforward_feedback": "vehicles.driver.steering.FeedforwardFeedback",
    "stanley": "vehicles.driver.steering.Stanley",
    "pure_pursuit": "vehicles.driver.steering.PurePursuit",
}
"""The shipped controllers; any other is the dotted name of the user's own class."""


if TYPE_CHECKING:
    SendingTable = SettingsTable[SendingRule]
else:
    SendingTable = one_of(RULES)


class OriginTable(Table):
    """Where the east-north plane touches the earth (WGS84)."""

    latitude_deg: float = Field(default=30.6380, ge=-90, le=90)
    longitude_deg: float = Field(default=-96.4810, ge=-180, le=180)
    altitude_m: float = Field(default=80.0, ge=-500, le=10_000)


class ConvoyTable(Table):
    """Who drives, in order from the lead, and how far apart.

    A gap is the distance along the path from the rear bumper of a vehicle to the front bumper of
    its follower. Without `gap_m` the convoy starts at 10 m, or at the gap that it keeps. A
    wall-clock run does not start while a vehicle's clock is further from the recorder's than
    `clock_offset_ms_max`.
    """

    vehicles: int = Field(default=4, ge=1, le=200)
    names: Annotated[tuple[Name, ...], Field(strict=False)] = ()
    gap_m: float | None = Field(default=None, gt=0, le=1000)
    on_vehicle_failure: Literal["end", "continue"] = "end"
    clock_offset_ms_max: float = Field(default=50.0, gt=0, le=60_000)

    @property
    def vehicle_names(self) -> tuple[str, ...]:
        return self.names or tuple(f"v{place}" for place in range(1, self.vehicles + 1))


class GainsTable(Table):
    """Feedback gains of the steering law (paper, Section III-E); the nominal ones by default."""

    lateral_rad_per_m: float = Field(default=NOMINAL_GAINS.lateral, ge=0, le=10)
    heading_rad_per_rad: float = Field(default=NOMINAL_GAINS.heading, ge=0, le=100)
    yaw_rate_s: float = Field(default=NOMINAL_GAINS.yaw_rate, ge=0, le=10)


class SteeringTable(Table):
    """How a vehicle makes its trajectory from the poses received, and steers along it.

    With own_state = "exact" it knows its own true state; what it broadcasts is measured anyway.
    """

    controller: str = "slip_compensated"
    fusion: Literal["composite", "predecessor", "blend"] = "composite"
    trajectory: Literal["fitted", "paper", "paper_prefix"] = "fitted"
    alpha_ratio: Ratio = 0.5
    preview_s: float = Field(default=FIT.preview_time, ge=0.1, le=10)
    tolerance_m: float = Field(default=FIT.tolerance, gt=0, le=10)
    knows_loading: bool = False
    estimate_slip: bool = False
    own_state: Literal["estimated", "exact"] = "estimated"
    gains: GainsTable = GainsTable()
    degradation: SettingsTable[DegradationSettings] = SettingsTable[DegradationSettings]()


class ControlTable(SteeringTable):
    """Steering of all vehicles, and the rate at which they decide."""

    rate_hz: float = Field(default=50.0, ge=5, le=500)


class ProfilePoint(Table):
    """The speed wanted at a time after the start; between two points it changes linearly."""

    at_s: NotNegative
    speed_mps: Speed


class GapTable(Table):
    """Gap keeping: `standstill_m + headway_s * speed` to the vehicle ahead, and its limits.

    Followers may brake harder than their lead, to compensate for the delay of what they receive.
    """

    standstill_m: float = Field(default=3.0, gt=0, le=1000)
    headway_s: float = Field(default=0.5, ge=0, le=10)
    acceleration_mps2_max: float = Field(default=GAP_LIMITS.acceleration, ge=0.1, le=10)
    braking_mps2_max: float = Field(default=GAP_LIMITS.deceleration, ge=0.1, le=12)


class SpeedTable(Table):
    """How fast the convoy goes.

    The lead drives one set speed, a profile, or the speed recorded in its trace. Before curves,
    set speeds and profiles are lowered to keep the lateral acceleration. With `lead_waits` it
    listens to its followers, and slows down while one of them is lost. The others drive the same
    speed at the same time (as in the paper), or keep their gap.
    """

    lead: Literal["set", "profile", "recorded"] = "set"
    lead_waits: bool = False
    set_mps: float = Field(default=20.0, ge=0.1, le=100)
    profile: Annotated[tuple[ProfilePoint, ...], Field(strict=False)] = ()
    followers: Literal["same", "gap"] = "same"
    lateral_acceleration_mps2_max: float = Field(default=3.0, ge=0.1, le=20)
    acceleration_mps2_max: float = Field(default=1.5, ge=0.1, le=10)
    braking_mps2_max: float = Field(default=2.5, ge=0.1, le=12)
    gap: GapTable = GapTable()


class ParametersTable(Table):
    """The empty car; a key that is left out keeps the value of the paper's Table I.

    What Table I does not know: tyres that saturate ("brush") where the paper's are "linear",
    the friction between them and the road (0.9: dry asphalt), and how fast the front wheels can be
    turned, or inf for no limit. 1.18 rad/s is what the drive-by-wire kit for the paper's car
    takes, 17.5 rad/s at the steering wheel (VELOCITY_MAX in dbw_mkz_msgs/SteeringCmd; its first
    releases took half of that), over the steering ratio of 14.8.
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


class EventsTable(Table):
    """From when on something that happens on the road is an event.

    lane_width_m       a corner of a body further than half of it from the lead's driven path has
                       left the lane; lanes of motorways are 3.5 to 3.75 m wide
    near_miss_gap_m    gap of neighbours; convoys that ship keep 2 m at least
    near_miss_time_s   that gap over the speed at which it shrinks; conflicts below 1.5 s count
                       as severe in traffic research
    path_lost_s        time without a path from what was received: 1 s is more than the preview,
                       so nothing is left of what was known of the road
    """

    lane_width_m: float = Field(default=3.5, gt=0, le=100)
    near_miss_gap_m: NotNegative = 1.0
    near_miss_time_s: NotNegative = 1.5
    path_lost_s: NotNegative = 1.0


class ClockTable(Table):
    """How far a vehicle's own clock is off: at the start of the run, and by how much more since."""

    offset_ms: float = Field(default=0.0, ge=-10_000, le=10_000)
    drift_ppm: float = Field(default=0.0, ge=-1000, le=1000)


class VehicleTable(Table):
    """What is different about one vehicle; keys that are left out keep the convoy's values.

    With `replay` it moves as in that recorded drive, `replay_offset_s` later, rather than by its
    own decision; of the log of a run it is `replay_vehicle`. When the file has been read, its
    points are the `drive`. While its transmitter or receiver is off no link from or to it carries
    anything.
    """

    replay: Annotated[str, StringConstraints(min_length=1)] | None = None
    replay_vehicle: str | None = None
    replay_offset_s: float = Field(default=0.0, ge=-86_400, le=86_400)
    drive: PointsPath | None = None
    gap_m: float | None = Field(default=None, gt=0, le=1000)
    lateral_offset_m: float = Field(default=0.0, ge=-20, le=20)
    heading_offset_deg: float = Field(default=0.0, ge=-90, le=90)
    transmitter_off: Annotated[tuple[TransmitterOff, ...], Field(strict=False)] = ()
    receiver_off: Annotated[tuple[ReceiverOff, ...], Field(strict=False)] = ()
    clock: ClockTable = ClockTable()
    control: SteeringTable | None = None
    gnss: GnssTable | None = None
    sending: SendingTable | None = None
    imu: SettingsTable[ImuSettings] | None = None
    parameters: ParametersTable | None = None
    loading: SettingsTable[Loading] | None = None


class ScenarioTables(Table):
    """A scenario file as a whole.

    `extends` names the file that another one is laid over; it is resolved before the tables are
    validated, and None here. `overrides` are the `key.path=value` that were laid over the file, for
    its title; in it they change nothing any more.
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
    gnss: GnssTable = GnssTable()
    sending: SendingTable = table_with(EveryFix(), RULES)
    imu: SettingsTable[ImuSettings] = SettingsTable[ImuSettings]()
    speed: SpeedTable = SpeedTable()
    path: PathTable
    links: LinkTable = LinkTable()
    events: EventsTable = EventsTable()
    limits: LimitsTable = LimitsTable()
    log: LogTable = LogTable()
    link: Annotated[tuple[LinkEntry, ...], Field(strict=False)] = ()
    change: Changes = ()
    parameters: ParametersTable = ParametersTable()
    loading: SettingsTable[Loading] = SettingsTable[Loading]()
    vehicle: dict[str, VehicleTable] = Field(default_factory=dict)
