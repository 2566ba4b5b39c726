"""`convoy check`: figures and warnings of a scenario before it runs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import hypot, inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenarios.definition.channel.build import ExpectedChannel, expected_channel, vehicles_between
from scenarios.definition.check.drive_report import DriveReport, drive_report, drive_warnings
from scenarios.definition.check.held_braking import HeldBraking, held_braking
from scenarios.definition.check.preview import history_warnings, preview_warnings
from scenarios.definition.check.steering_loop import (
    largest_alphas,
    sampled_loop_warnings,
    slip_warnings,
)
from scenarios.definition.check.unusual import unusual_settings
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.change_tables import SpeedChangeTable
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.definition.vehicle_setup import VehicleSetup
from transport.links.laws.recorded_losses import EarlierRun
from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import GRAVITY
from vehicles.geometry.sampled_path import FloatArray

# ---- Accuracy of receivers compared with the room in the lane


DEVIATIONS = 2.0
"""Standard deviations taken into account: one pair of receivers in twenty differs by more."""

NOTICED = 0.3
"""Difference of receivers (m) from which a follower notably leaves the lead's path."""


class _Lasting(NamedTuple):
    """Lasting errors of a receiver: standard deviation (m) per axis, and a given bias (m)."""

    deviation: float = 0.0
    east: float = 0.0
    north: float = 0.0

    def from_another(self, other: "_Lasting") -> float:
        """Largest difference (m) between two receivers."""
        given = hypot(self.east - other.east, self.north - other.north)
        return DEVIATIONS * hypot(self.deviation, other.deviation) + given


def receiver_warnings(scenario: Scenario) -> Iterator[str]:
    """Warn of receivers that differ by more than the lane leaves beside a car, or by `NOTICED`.

    A follower drives as far off a path as its receiver differs from the sender's. No measurement
    shows that: both know absolute positions only, and the shape of a path is the same at its side.
    Only drift and bias count: fit and filter average white noise.
    """
    apart, rooms = dict[str, float](), dict[str, float]()
    setups = {name: scenario.vehicle(name) for name in scenario.vehicle_names}
    errors = {name: _lasting(setup) for name, setup in setups.items()}
    for name in scenario.vehicle_names[1:]:
        if name in scenario.tables.replayed:
            continue
        setup = setups[name]
        own = _Lasting() if setup.has_exact_state else errors[name]
        apart[name] = max(own.from_another(errors[sender]) for sender in setup.flow.lateral)
        rooms[name] = 0.5 * max(scenario.tables.events.lane_width_m - setup.parameters.width, 0.0)
    for is_beyond in (True, False):
        names = [
            name
            for name, off in apart.items()
            if off > NOTICED and (off > rooms[name]) == is_beyond
        ]
        if not names:
            continue
        what, effect = "followers drive off the lead's path", ""
        if is_beyond:
            room = min(rooms[name] for name in names)
            what = "receivers differ"
            effect = f": the lane leaves {room:.1f} m beside a car, which will leave it"
        yield (
            f"{', '.join(names)}: {what} by up to {max(apart[one] for one in names):.1f} m (two "
            f"standard deviations of drift and bias) even on clean links{effect}. Set gnss.preset "
            '= "rtk_fixed", or gnss.common_drift for an error that all receivers share.'
        )


def _lasting(setup: VehicleSetup) -> _Lasting:
    bias = setup.gnss.bias
    east, north = (bias.east, bias.north) if bias else (0.0, 0.0)
    return _Lasting(setup.gnss.lasting_deviation, east, north)


# ---- Findings


USUAL_GNSS_RATE = 20.0
"""Highest rate (Hz) of receivers for driving (paper, Section III-A)."""

SLACK_S = 0.5
"""Time (s) without a record of replayed vehicles up to which there is no warning."""

STRAIGHT = 1e-6
"""Curvature (1/m) up to which a path is straight."""

GROWTH_M = 1.0
"""Growth of a gap by a follower's limit of acceleration up to which there is no warning."""

BRAKING_SLACK_MPS2 = 0.2
"""Resolution of the held braking."""

STEP = 0.05
"""Time step (s) at which the lead's planned run is sampled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """Figures of a valid scenario that its file does not hold, and warnings.

    `largest_alpha` is by follower with lead data, `replays` of recorded drives by vehicle, and
    `channel` the requested figures of each link, null where no number is known. `radius_m_min` is
    None on a straight road. `drive` is about a recorded drive that the scenario names.
    `held_braking` is the braking of the lead that the gaps hold.
    """

    name: str
    description: str
    vehicles: tuple[str, ...]
    gaps_m: tuple[float, ...]
    duration_s: float
    seed: int
    lead_speed: str
    largest_alpha: dict[str, dict[str, float]]
    replays: dict[str, dict[str, Any]]
    channel: dict[str, ExpectedChannel]
    path_length_m: float
    driven_m: float
    radius_m_min: float | None
    speed_mps_min: float
    speed_mps_max: float
    acceleration_mps2_max: float
    braking_mps2_max: float
    lateral_acceleration_mps2_max: float
    warnings: tuple[str, ...]
    drive: DriveReport | None = None
    held_braking: HeldBraking | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """The lead's planned speeds (m/s) and curvatures (1/m) at every STEP."""

    speeds: FloatArray
    curvatures: FloatArray

    @property
    def lateral_max(self) -> float:
        """Greatest lateral acceleration (m/s²)."""
        return float(np.max(self.speeds * self.speeds * np.abs(self.curvatures)))

    @property
    def sharpest(self) -> float:
        """Greatest curvature (1/m), in either direction."""
        return float(np.max(np.abs(self.curvatures)))

    @property
    def braking_max(self) -> float:
        """Greatest braking (m/s²)."""
        return float(np.max(0.0 - np.diff(self.speeds) / STEP, initial=0.0))

    @property
    def speed_range(self) -> tuple[float, float]:
        """Lowest and highest speed (m/s)."""
        return float(np.min(self.speeds)), float(np.max(self.speeds))


def whole_report(scenario: Scenario, drive: DriveInPlane | None = None) -> CheckReport:
    """Report on a scenario and its recorded drive, with the findings that take longer."""
    report, held = report_of(scenario), held_braking(scenario)
    braking = _braking_warnings(report.braking_mps2_max, held)
    return replace(
        report,
        held_braking=held,
        warnings=(*report.warnings, *braking),
        drive=drive_report(drive, scenario) if drive is not None else None,
    )


def _braking_warnings(planned: float, held: HeldBraking | None) -> Iterator[str]:
    if held is not None and planned > held.simulated_mps2 + BRAKING_SLACK_MPS2:
        yield (
            f"the lead brakes at up to {planned:.1f} m/s², the gaps hold "
            f"{held.simulated_mps2:.1f} m/s² in a simulation without losses: a collision is "
            "possible. Raise the gaps or gnss.rate_hz, or lower the braking."
        )


def check(
    name_or_path: str | Path, overrides: Sequence[str] = (), seed: int | None = None
) -> CheckReport:
    """Read a scenario as `load_scenario` does, and report on it."""
    return report_of(load_scenario(name_or_path, overrides, seed))


def report_of(scenario: Scenario) -> CheckReport:
    tables, route, run = scenario.tables, scenario.route, _run(scenario)
    changes = np.diff(run.speeds) / STEP
    return CheckReport(
        name=scenario.name,
        description=tables.description,
        vehicles=scenario.vehicle_names,
        gaps_m=route.gaps[1:],
        duration_s=scenario.duration_s,
        seed=scenario.seed,
        lead_speed=tables.speed.lead,
        largest_alpha=largest_alphas(scenario, run.speed_range),
        replays=_replays(scenario),
        channel={f"{pair[0]} → {pair[1]}": _requested(scenario, *pair) for pair in scenario.links},
        path_length_m=route.length,
        driven_m=route.profile.distance(scenario.duration_s),
        radius_m_min=1.0 / run.sharpest if run.sharpest > STRAIGHT else None,
        speed_mps_min=run.speed_range[0],
        speed_mps_max=run.speed_range[1],
        acceleration_mps2_max=float(np.max(changes, initial=0.0)),
        braking_mps2_max=run.braking_max,
        lateral_acceleration_mps2_max=run.lateral_max,
        warnings=(*unusual_settings(scenario, wall_clock=True), *_warnings(scenario, run)),
    )


def _requested(scenario: Scenario, sender: str, receiver: str) -> ExpectedChannel:
    """Requested figures of a link, for vehicles as far apart as at the start."""
    source, place = scenario.vehicle(sender), scenario.vehicle(receiver).place
    first, last = sorted((source.place, place))
    return expected_channel(
        scenario.links[sender, receiver],
        source.highest_rate_hz,
        sum(scenario.route.spacings[first + 1 : last + 1]),
        partial(vehicles_between, scenario.route, source.place, place),
    )


def _replays(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """By replayed vehicle: the file, the time in it at which the run starts, and the clock."""
    return {
        name: {
            "file": scenario.tables.vehicle[name].replay,
            "begun_s": drive.begun,
            "clock": "common" if drive.common else "own",
            "deviation_m_max": drive.road.deviation_max,
        }
        for name, drive in scenario.replays.items()
    }


def _run(scenario: Scenario) -> _Run:
    profile, path = scenario.route.profile, scenario.route.path
    times = STEP * np.arange(max(int(scenario.duration_s / STEP), 1) + 1)
    speeds = np.interp(times, profile.times, profile.speeds)
    driven = np.cumsum(0.5 * STEP * (speeds[1:] + speeds[:-1]))
    stations = scenario.route.start + np.concatenate((np.zeros(1), driven))
    # A path continues straight beyond both ends.
    curvatures = np.interp(stations, path.station, path.curvature, left=0.0, right=0.0)
    return _Run(speeds, curvatures)


def warnings(scenario: Scenario) -> tuple[str, ...]:
    """Return the warnings of a valid scenario, except those of unusual settings."""
    return _warnings(scenario, _run(scenario))


def _warnings(scenario: Scenario, run: _Run) -> tuple[str, ...]:
    has_bends = float(np.max(np.abs(scenario.route.path.curvature))) > STRAIGHT
    result = (
        *drive_warnings(scenario),
        *_vehicle_warnings(scenario),
        *_recording_warnings(scenario),
        *_replay_warnings(scenario),
        *(preview_warnings(scenario, run.speed_range) if has_bends else ()),
        *history_warnings(scenario, run.speed_range[1]),
        *receiver_warnings(scenario),
        *sampled_loop_warnings(scenario, run.speed_range),
        *_speed_warnings(scenario, run),
        *_acceleration_warnings(scenario, run),
        *slip_warnings(scenario, run.speeds, run.curvatures),
    )
    return tuple(dict.fromkeys(result))  # one file may be the path and replayed as well


def _recording_warnings(scenario: Scenario) -> Iterator[str]:
    for link in scenario.links.values():
        if isinstance(link.loss, EarlierRun) and link.loss.log_faults:
            yield f"{link.loss.source}: {link.loss.log_faults}"


def _replay_warnings(scenario: Scenario) -> Iterator[str]:
    """Warn if the record of replayed vehicles covers only a part of the run."""
    replay = scenario.tables.replay
    if replay is None or replay.recorded_s is None:
        return
    first, last = replay.recorded_s
    if first > SLACK_S or last < scenario.duration_s - SLACK_S:
        yield (
            f"{', '.join(replay.vehicles)}: recorded from {first:.1f} to {last:.1f} s of "
            f"{scenario.duration_s:.1f} s: followers lose them outside of that time. Lower "
            "duration_s, or replay a complete log."
        )


def _vehicle_warnings(scenario: Scenario) -> Iterator[str]:
    for name in scenario.vehicle_names:
        rate = scenario.vehicle(name).gnss.rate
        if rate > USUAL_GNSS_RATE:
            yield (
                f"{name} measures at {rate:g} Hz, real receivers at up to {USUAL_GNSS_RATE:g} Hz: "
                "results will be too good. Lower gnss.rate_hz."
            )


def _friction_warnings(
    scenario: Scenario, cars: Sequence[VehicleParameters], run: _Run
) -> Iterator[str]:
    """Warn if the lead's plan, which all follow, exceeds the grip of the most slippery tyres."""
    least = min((car.friction for car in cars if car.tyres == "brush"), default=inf)
    if run.lateral_max > least * GRAVITY:
        yield (
            f"curves are planned at {run.lateral_max:.1f} m/s², tyres hold up to "
            f"{least * GRAVITY:.1f} m/s² (parameters.friction_ratio = {least:g}): cars will slide. "
            f"{_slower_in_curves(scenario)}."
        )


def _slower_in_curves(scenario: Scenario) -> str:
    """Return what reduces the lateral acceleration of the lead."""
    lead, road = scenario.tables.speed.lead, scenario.route.smoothed
    if lead != "recorded":
        key = "profile" if lead == "profile" else "set_mps"
        return f"Lower speed.{key} or speed.lateral_acceleration_mps2_max"
    noise = f" = {road.half_width:g} if they are noise of the points" if road else ""
    return f'Set speed.lead = "set", or raise path.smoothing_m{noise}'


def _acceleration_warnings(scenario: Scenario, run: _Run) -> Iterator[str]:
    """Warn if followers that keep a gap cannot accelerate like the lead, and fall behind."""
    if scenario.tables.speed.followers != "gap" or len(scenario.vehicle_names) == 1:
        return
    most = scenario.gap_limits.acceleration
    speed, behind, growth = float(run.speeds[0]), 0.0, 0.0
    for planned in run.speeds.tolist():
        speed = min(speed + most * STEP, planned)
        behind = behind + (planned - speed) * STEP if speed < planned else 0.0
        growth = max(growth, behind)
    if growth > GROWTH_M:
        hardest = float(np.max(np.diff(run.speeds))) / STEP
        yield (
            f"the lead accelerates at up to {hardest:.1f} m/s², followers at up to {most:g} m/s²: "
            f"gaps grow by up to {growth:.1f} m. Raise speed.gap.acceleration_mps2_max."
        )


def _speed_warnings(scenario: Scenario, run: _Run) -> Iterator[str]:
    speed = scenario.tables.speed
    cars = [scenario.vehicle(name).parameters for name in scenario.vehicle_names]
    car = max(cars, key=lambda car: car.wheelbase / car.steering_limit)
    tightest = car.wheelbase / car.steering_limit
    if run.sharpest * tightest > 1.0:
        yield (
            f"the path has a smallest radius of {1.0 / run.sharpest:.1f} m, cars turn at "
            f"{tightest:.1f} m: they will leave the path. Raise path.smoothing_m or the radius."
        )
    yield from _friction_warnings(scenario, cars, run)
    if speed.profile and speed.lead != "profile":
        yield f'speed.profile is not used with speed.lead = "{speed.lead}". Set it to "profile".'
    if speed.oscillation != type(speed.oscillation)() and speed.lead != "oscillating":
        yield (
            f'speed.oscillation is not used with speed.lead = "{speed.lead}". Set it to '
            '"oscillating".'
        )
    begins = speed.oscillation.from_s
    if speed.lead == "oscillating" and begins >= scenario.duration_s:
        yield (
            f"speed.oscillation.from_s = {begins:g} is not before the end of the run at "
            f"{scenario.duration_s:g} s: the lead drives at its set speed. Lower it, or raise "
            "duration_s."
        )
    changes = [one for one in scenario.tables.change if isinstance(one, SpeedChangeTable)]
    least_set = min([speed.set_mps, *(one.speed_mps for one in changes)])
    if speed.lead == "set" and run.speed_range[0] < least_set:
        yield (
            f"the set speed of {least_set:g} m/s is lowered to {run.speed_range[0]:.1f} m/s in "
            f"curves: {speed.lateral_acceleration_mps2_max:g} m/s² are allowed. Raise "
            "speed.lateral_acceleration_mps2_max to drive faster."
        )
    if run.lateral_max > speed.lateral_acceleration_mps2_max * 1.1:
        yield (
            f"the recorded speed takes curves at {run.lateral_max:.1f} m/s², more than "
            f"speed.lateral_acceleration_mps2_max = {speed.lateral_acceleration_mps2_max:g}, which "
            f"applies to set speeds only. {_slower_in_curves(scenario)}."
        )
