"""One vehicle of a scenario: its own tables merged into the convoy's."""

import math
from dataclasses import dataclass, replace

from scenarios.definition.schema.plug_ins.point import InstantDraw
from scenarios.definition.schema.scenario_tables import (
    ParametersTable,
    ScenarioTables,
    SteeringTable,
)
from scenarios.definition.schema.settings_table import overlay
from scenarios.definition.topology import InformationFlow, information_flow
from vehicles.car.gnss_settings import GnssSettings
from vehicles.car.imu import ImuSettings
from vehicles.car.parameters import LINCOLN_MKZ, Gains, VehicleParameters, loaded
from vehicles.car.sending_rules import EveryFix, FixedRate, SendingRule
from vehicles.car.sensors import GapSensorSettings
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.steering import LateralController


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSetup:
    """One vehicle; `place` counts from the lead, which is 0.

    `parameters` are those of the loaded car; `assumed_parameters` are those of its controller and
    estimator, without the load unless they know it. `flow` names the vehicles whose poses it uses
    and `senders` all that it receives, from front to back: of a lead none, or all where it waits.
    `imu_rate_hz` is the inertial sensor's own rate, or else that of control. `gap_sensor` is None
    for a vehicle without one.
    """

    name: str
    place: int
    lead: str
    predecessor: str | None
    flow: InformationFlow
    senders: tuple[str, ...]
    lateral_offset_m: float
    heading_offset_rad: float
    parameters: VehicleParameters
    assumed_parameters: VehicleParameters
    steering: SteeringTable
    gnss: GnssSettings
    sending: SendingRule
    imu: ImuSettings
    imu_rate_hz: float
    gap_sensor: GapSensorSettings | None

    @property
    def sends_every_instant(self) -> bool:
        """Whether each measurement is sent at once, from the first one on."""
        each = isinstance(self.sending, EveryFix) and self.sending.dcc is None
        return each and self.gnss.has_fix_every_instant

    @property
    def highest_rate_hz(self) -> float:
        """Largest rate of messages, counted from the start; no fix is sent twice."""
        return self.sending.max_rate(self.gnss.rate)

    @property
    def even_rate_hz(self) -> float | None:
        """Rate of periodic messages; None for other rules of sending."""
        is_periodic = isinstance(self.sending, EveryFix | FixedRate) and self.sending.dcc is None
        return self.highest_rate_hz if is_periodic else None

    def usual_rate_hz(self, speed: float) -> float:
        """Return messages per second at a constant speed (m/s) on a straight.

        The lowest non-zero rate of a profile, the mean of random intervals, the lowest rate of
        congestion control.
        """
        return self.sending.controlled_rate(self.gnss.rate, speed)

    @property
    def has_exact_state(self) -> bool:
        return self.steering.own_state == "exact"

    @property
    def degradation(self) -> DegradationSettings:
        return self.steering.degradation.value

    def controller(self, draw: InstantDraw | None = None) -> LateralController:
        """Construct the lateral controller, which may `draw`; raises PlugInError."""
        controller: LateralController = self.steering.controller.build(
            self.assumed_parameters, self.gains, draw=draw
        )
        return controller

    @property
    def gains(self) -> Gains:
        table = self.steering.gains
        return Gains(table.lateral_rad_per_m, table.heading_rad_per_rad, table.yaw_rate_s)


def vehicle_setup(tables: ScenarioTables, name: str) -> VehicleSetup:
    """Merge the settings of a vehicle; raises ValueError for an unknown name."""
    names = tables.convoy.vehicle_names
    place, own = names.index(name), tables.vehicle.get(name)
    steering = overlay(tables.control, own and own.control)
    empty = empty_car(tables, name)
    full = loaded(empty, overlay(tables.loading, own and own.loading).value)
    predecessor = names[place - 1] if place else None
    flow = information_flow(tables, name)
    imu = overlay(tables.imu, own and own.imu).value
    gap_sensor = overlay(tables.gap_sensor, own and own.gap_sensor).value
    senses_gap = predecessor is not None and gap_sensor.reach > 0.0 and name not in tables.replayed
    sending = own.sending if own and own.sending else tables.sending
    if type(sending) is type(tables.sending):
        sending = overlay(tables.sending, sending)
    return VehicleSetup(
        name=name,
        place=place,
        lead=names[0],
        predecessor=predecessor,
        flow=flow,
        senders=flow.received(names),
        lateral_offset_m=own.lateral_offset_m if own else 0.0,
        heading_offset_rad=math.radians(own.heading_offset_deg) if own else 0.0,
        parameters=full,
        assumed_parameters=full if steering.knows_loading else empty,
        steering=steering,
        gnss=overlay(tables.gnss, own and own.gnss).value,
        sending=sending.value,
        imu=imu,
        imu_rate_hz=imu.rate or tables.control.rate_hz,
        gap_sensor=gap_sensor if senses_gap else None,
    )


def empty_car(tables: ScenarioTables, name: str) -> VehicleParameters:
    """The car of the vehicle `name` without its load."""
    own = tables.vehicle.get(name)
    return _car(overlay(tables.parameters, own and own.parameters))


def _car(table: ParametersTable) -> VehicleParameters:
    """Return the car without passengers: the paper's, with the keys that the scenario gives.

    Its tyres, steering rate and drive lag are the scenario's in any case.
    """
    given = {
        "mass": table.mass_kg,
        "yaw_inertia": table.yaw_inertia_kgm2,
        "front_cornering_stiffness": table.front_cornering_stiffness_n_per_rad,
        "rear_cornering_stiffness": table.rear_cornering_stiffness_n_per_rad,
        "front_axle_distance": table.front_axle_distance_m,
        "rear_axle_distance": table.rear_axle_distance_m,
        "steering_frequency": table.steering_frequency_radps,
        "steering_damping": table.steering_damping_ratio,
        "steering_limit": table.steering_limit_rad,
        "length": table.length_m,
        "width": table.width_m,
    }
    return replace(
        LINCOLN_MKZ,
        steering_rate_limit=table.steering_rate_limit_radps,
        tyres=table.tyres,
        friction=table.friction_ratio,
        drive_lag=table.drive_lag_s,
        **{key: value for key, value in given.items() if value is not None},
    )
