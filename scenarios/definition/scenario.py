"""A scenario: read from a file, validated, and resolved to all that a run needs."""

import hashlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import tomli_w
from pydantic import ValidationError

from scenarios.definition import contradictions
from scenarios.definition.changes import joins_late, vehicle_change_problems
from scenarios.definition.channel.build import expected_channel, requested_link
from scenarios.definition.channel.presets import with_presets
from scenarios.definition.channel.recordings import with_recorded_delays, with_recordings
from scenarios.definition.errors import Problem, ScenarioError, collected
from scenarios.definition.library import ScenarioFile, drills, library, read_file
from scenarios.definition.overrides import MergedScenario, Raw, merged
from scenarios.definition.problem_lines import error_lines
from scenarios.definition.recorded_messages import with_recorded_messages
from scenarios.definition.road.replayed_drive import (
    ReplayedDrive,
    plan_replay,
    replay_problems,
    whole_run,
)
from scenarios.definition.road.route import (
    Route,
    is_closed,
    least_spacings,
    plan_route,
    source_policies,
    spacing_policy,
    vehicle_names,
)
from scenarios.definition.run_limits import limit_problems
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.plug_ins.point import InstantDraw
from scenarios.definition.schema.plug_ins.table import RECORDED, own_classes
from scenarios.definition.schema.scenario_tables import ClockTable, OriginTable, ScenarioTables
from scenarios.definition.topology import directed_links
from scenarios.definition.traces.reading import (
    OnDrive,
    at_recorded_speed,
    with_points,
    with_replays,
)
from scenarios.definition.vehicle_setup import VehicleSetup, vehicle_setup
from scenarios.definition.wording import toml_repr
from transport.links.laws.link_law import LinkSetting
from vehicles.car.clock import VehicleClock
from vehicles.car.tyres import GRAVITY
from vehicles.driver.controller import (
    GapLimits,
    LongitudinalController,
    LongitudinalSetup,
    SpacingPolicy,
)
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.geometry.sampled_path import SampledPath
from vehicles.schedule import MILLISECOND, SECOND

LEAST_CLOCK_UNCERTAINTY_MS = 5.0
"""Least required uncertainty of clocks: without latency, messages are late anyway."""

__all__ = [
    "Scenario",
    "drills",
    "library",
    "load_scenario",
    "scenario_from_text",
    "scenario_text",
]


FOLLOWERS_LATERAL = 1.25
"""Lateral acceleration of followers that keep a gap, over the lead's: at the lead's own limit noise
alone would leave them behind."""

READ_WITH = ("path.", "origin.", "speed.")
"""Keys with which a recorded drive is read."""

LONGEST_SLUG = 80
"""Longest name of a folder, so that it fits a line of a terminal."""


def _range(values: Sequence[float]) -> str:
    least, most = f"{min(values):.4g}", f"{max(values):.4g}"
    return least if least == most else f"{least} to {most}"


def _lossy(link: LinkTable) -> list[str]:
    """Return the keys of a link that lose messages, or its own class; none with a preset."""
    if link.preset:
        return []
    keys = ("loss", "collisions", "outages", "radio", "queue", "content")
    laws = {key: law for key in keys if (law := getattr(link, key)) is not None}
    return [getattr(law, "use", "") or key.replace("_", " ") for key, law in laws.items()]


@dataclass(frozen=True)
class Scenario:
    """A valid scenario; `tables` holds every key, and the contents of the files that keys name."""

    tables: ScenarioTables

    @property
    def name(self) -> str:
        return self.tables.name

    @property
    def overrides(self) -> tuple[str, ...]:
        """Overrides of the file in order, as `key.path=value`."""
        return self.tables.overrides or ()

    @cached_property
    def fingerprint(self) -> str:
        """Six hexadecimal digits of the content; empty for a shipped scenario with any overrides.

        Two files of the user may have the same name, or that of a shipped scenario.
        """
        if self.name in (*library(), *drills()):
            try:
                if self.text == _text_of(_read(read_file(self.name), self.overrides)[1]):
                    return ""
            except ScenarioError:
                pass  # these overrides do not fit the shipped one: another file of that name
        return hashlib.sha256(self.text.encode()).hexdigest()[:6]

    @cached_property
    def title(self) -> str:
        """The run in one line: name, fingerprint, seed, weight of the predecessor, loss, overrides.

        The loss is the total of all laws; presets or keys are named where it is unknown.
        """
        weights = [self.vehicle(name).steering.alpha_ratio for name in self.vehicle_names[1:]]
        expected = [(expected_channel(link).loss_ratio, link) for link in self.links.values()]
        losses = [100.0 * loss for loss, _ in expected if loss is not None]
        laws = dict.fromkeys(law for loss, link in expected if loss is None for law in _lossy(link))
        presets = dict.fromkeys(link.preset for link in self.links.values() if link.preset)
        replay = self.tables.replay
        parts = [
            f"{self.name} ({self.fingerprint})" if self.fingerprint else self.name,
            f"seed {self.seed}",
            *([f"α {_range(weights)}"] if weights else []),
            *([f"loss {_range(losses)} %"] if losses else []),
            *([f"loss by {' and '.join(laws)}"] if laws else []),
            *([f"channel {' and '.join(presets)}"] if presets else []),
            *([f"replays {', '.join(replay.vehicles)}"] if replay else []),
            *(text for text in self.overrides if not text.startswith("seed=")),
        ]
        return ", ".join(parts)

    @property
    def slug(self) -> str:
        """Name and overrides as the name of a folder; long ones end in a checksum."""
        text = "-".join((self.name, *self.overrides))
        slug = re.sub(r"[^A-Za-z0-9_.=-]+", "_", text)
        if slug == text and len(slug) <= LONGEST_SLUG:
            return slug
        digest = hashlib.sha256(text.encode()).hexdigest()[:8]
        return f"{slug[: LONGEST_SLUG - 9]}-{digest}"

    @property
    def virtual_run_id(self) -> str:
        """Identifier of its virtual run: slug, seed, fingerprint."""
        return "-".join(filter(None, (self.slug, str(self.seed), self.fingerprint)))

    @property
    def seed(self) -> int:
        return self.tables.seed

    @cached_property
    def duration_s(self) -> float:
        """Length of the run: as given, or until the lead's or a replayed drive ends."""
        given = self.tables.duration_s
        return whole_run(self.route, self.replays.values()) if given is None else given

    @property
    def start_at_ns(self) -> int:
        """Unix time at which a virtual run starts."""
        start = self.tables.start_at
        return int(start.timestamp()) * SECOND + start.microsecond * 1000

    @property
    def control_rate_hz(self) -> float:
        return self.tables.control.rate_hz

    @property
    def continues_without_failed(self) -> bool:
        return self.tables.convoy.on_vehicle_failure == "continue"

    @cached_property
    def vehicle_names(self) -> tuple[str, ...]:
        return vehicle_names(self.tables)

    @property
    def lead(self) -> str:
        return self.vehicle_names[0]

    @property
    def origin(self) -> Origin:
        table = self.tables.origin or OriginTable()
        return Origin(table.latitude_deg, table.longitude_deg, table.altitude_m)

    @cached_property
    def off_links(self) -> frozenset[tuple[str, str]]:
        """Links (sender, receiver) with an end whose radio is off for a time."""
        return frozenset(pair for pair in self.links if self.link_setting(*pair, 0).off)

    @cached_property
    def route(self) -> Route:
        return plan_route(self.tables)

    @cached_property
    def replays(self) -> Mapping[str, ReplayedDrive]:
        return {
            name: plan_replay(self.tables, name, self.route)
            for name, own in self.tables.vehicle.items()
            if own.replay is not None
        }

    def road_of(self, name: str) -> tuple[SampledPath, float]:
        """Return the road of a vehicle and the station (m) from which its distance counts.

        The road is the lead's path, or the vehicle's own drive if it is replayed.
        """
        if (drive := self.replays.get(name)) is not None:
            return drive.road.path, drive.stations[0]
        return self.route.path, self.route.start_station(self.vehicle_names.index(name))

    @cached_property
    def least_spacings(self) -> tuple[float, ...]:
        """Spacing (m) of each vehicle to its predecessor at which their bumpers touch."""
        return least_spacings(self.tables)

    def is_measured(self, name: str) -> bool:
        """Whether the gap sensor of the next vehicle measures the true poses of `name`."""
        behind = self.vehicle_names[self.vehicle_names.index(name) + 1 :]
        return bool(behind) and self.vehicle(behind[0]).gap_sensor is not None

    def spacing_policy(self, place: int) -> SpacingPolicy:
        return spacing_policy(self.tables, self.least_spacings[place])

    def kept_spacing(self, place: int) -> SpacingPolicy:
        """Spacing that the follower at `place` keeps; at a common speed that of the start."""
        if self.tables.speed.followers == "same":
            return SpacingPolicy(self.route.spacings[place])
        return self.spacing_policy(place)

    @property
    def gap_limits(self) -> GapLimits:
        gap, speed = self.tables.speed.gap, self.tables.speed
        lateral = FOLLOWERS_LATERAL * speed.lateral_acceleration_mps2_max
        before_bends = min(speed.braking_mps2_max, 0.5 * gap.braking_mps2_max)
        return GapLimits(gap.acceleration_mps2_max, gap.braking_mps2_max, lateral, before_bends)

    def usable_lateral(self, name: str) -> float:
        """Lateral acceleration (m/s²) that the friction allows a follower; infinite for no limit.

        It counts for bends that the follower has received. Followers that keep a gap also keep
        their limit of `gap_limits`.
        """
        ratio = self.tables.speed.friction_ratio_max
        friction = ratio * self.vehicle(name).parameters.friction * GRAVITY
        if ratio == math.inf or self.tables.speed.followers == "same":
            return friction
        return min(friction, self.gap_limits.lateral)

    def vehicle(self, name: str) -> VehicleSetup:
        """Return the settings of a vehicle; raises ScenarioError for an unknown name."""
        if name not in self.vehicle_names:
            known = ", ".join(self.vehicle_names)
            raise ScenarioError([f"{self.name}: no vehicle {toml_repr(name)}, allowed {known}"])
        if name not in self._setups:
            self._setups[name] = vehicle_setup(self.tables, name)
        return self._setups[name]

    @cached_property
    def _setups(self) -> dict[str, VehicleSetup]:
        """Cache of `vehicle`, which a run calls a hundred times for each."""
        return {}

    @cached_property
    def links(self) -> Mapping[tuple[str, str], LinkTable]:
        """Settings of each link by (sender, receiver), without links to replayed vehicles."""
        return {
            pair: requested_link(self.tables, self.vehicle_names, *pair)
            for pair in directed_links(self.tables)
            if pair[1] not in self.tables.replayed
        }

    def clock(self, name: str, start_at: int) -> VehicleClock:
        own = self.tables.vehicle.get(name)
        table = own.clock if own else ClockTable()
        return VehicleClock(start_at, round(table.offset_ms * MILLISECOND), table.drift_ppm)

    def clock_error_ns(self, name: str) -> int:
        """Return the largest error (ns) of a vehicle's clock during the run."""
        clock, end = self.clock(name, 0), round(self.duration_s * SECOND)
        return max(abs(clock.error(0)), abs(clock.error(end)))

    def joins_late(self, name: str) -> bool:
        """Whether a human drives a vehicle from the start until it joins."""
        return joins_late(self.tables.change, name)

    def link_setting(self, sender: str, receiver: str, start_at: int) -> LinkSetting:
        """Return what the laws of a link need of a run that starts at `start_at` (ns)."""
        source, sink = (self.tables.vehicle.get(name) for name in (sender, receiver))
        return LinkSetting(
            start_at=start_at,
            sender_station=self._start_station(sender),
            receiver_station=self._start_station(receiver),
            plane=LocalPlane(self.origin),
            radio_off=(
                *(source.transmitter_off if source else ()),
                *(sink.receiver_off if sink else ()),
            ),
        )

    def _start_station(self, name: str) -> float:
        """Arc length (m) from the path's first point to the start of a vehicle."""
        route = self.route
        if name in self.replays:
            drive = self.replays[name]
            first = drive.road.path.at(drive.stations[0])
            away = np.hypot(route.path.east - first.east, route.path.north - first.north)
            return float(route.path.station[int(np.argmin(away))]) - route.first_point
        return route.start_station(self.vehicle_names.index(name)) - route.first_point

    @cached_property
    def text(self) -> str:
        """The scenario as one self-contained TOML file for `scenario_from_text`."""
        return _text_of(self.tables)

    @property
    def clock_uncertainty_ns_max(self) -> int:
        """Largest uncertainty (ns) of a process's clock with which a wall-clock run starts.

        By default half the smallest latency of the links, so that clock errors and the delay of
        the transport together stay below that latency.
        """
        given = self.tables.convoy.clock_uncertainty_ms_max
        floors = [
            link.latency_ms for pair, link in self.links.items() if pair not in self.off_links
        ]
        default = max(min(floors, default=0.0) / 2.0, LEAST_CLOCK_UNCERTAINTY_MS)
        return round((default if given is None else given) * MILLISECOND)

    def longitudinal_setup(self, name: str) -> LongitudinalSetup:
        """Constants of a follower for its longitudinal control."""
        setup = self.vehicle(name)
        return LongitudinalSetup(
            self.kept_spacing(setup.place),
            self.gap_limits,
            self.least_spacings[setup.place],
            1.0 / self.control_rate_hz,
            max(self.route.profile.speeds),
            setup.assumed_parameters,
            setup.lead,
            setup.predecessor or "",
            self.route.spacings[setup.place],
            self.tables.speed.catch_up_ratio,
            source_policies(self.tables, setup),
        )

    def longitudinal_controller(
        self, name: str, start: LongitudinalSetup, draw: InstantDraw | None = None
    ) -> LongitudinalController:
        """Construct the longitudinal controller of a follower, which may `draw`; PlugInError."""
        controller: LongitudinalController = self.vehicle(name).steering.longitudinal.build(
            start, draw=draw
        )
        return controller

    @property
    def own_figures(self) -> tuple[str, ...]:
        """Names of the figures of the user's classes."""
        return tuple(table.word for table in self.tables.figure)

    @cached_property
    def plug_ins(self) -> list[str]:
        """Dotted names of the user's classes."""
        return sorted(set(own_classes(self.tables)))

    @cached_property
    def digest(self) -> str:
        """Sixteen hexadecimal digits of the content without name and seed."""
        neutral = self.tables.model_copy(update={"seed": 0, "name": "any"})
        if replay := neutral.replay:  # the log has another path on another machine
            update = {"replay": replay.model_copy(update={"log": "any"})}
            neutral = neutral.model_copy(update=update)
        return hashlib.sha256(_text_of(neutral).encode()).hexdigest()[:16]


def _text_of(tables: ScenarioTables) -> str:
    apart = {"link", "vehicle", "change"}
    whole = tables.model_dump(exclude_none=True, exclude=apart)
    # Keys that these omit must stay omitted: they have the convoy's values.
    some = tables.model_dump(
        exclude_unset=True, exclude_none=True, include={"link", "vehicle", "change"}
    )
    return tomli_w.dumps(whole | some)


def load_scenario(
    name_or_path: str | Path,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    *,
    on_drive: OnDrive = lambda _: None,
) -> Scenario:
    """Read a shipped scenario by its name, or a file; `overrides` are `key.path=value` in TOML.

    The scenario of a recorded drive drives along it, at its recorded speed if it has times.
    `on_drive` receives the recorded drive of the lead, also if it is refused afterwards.
    Raises ScenarioError with a line for each mistake: file, key, given and allowed values.
    """
    return _scenario(read_file(name_or_path), overrides, seed, on_drive)


def scenario_text(
    name_or_path: str | Path, overrides: Sequence[str] = ()
) -> tuple[str, tuple[str, ...]]:
    """Return a scenario with the contents of its files as TOML, and the `overrides` in it.

    Overrides of path, origin and speed are in it, since a recorded drive is read with them. Raises
    ScenarioError; problems that depend on the road are not checked.
    """
    read_with = tuple(text for text in overrides if text.lstrip().startswith(READ_WITH))
    tables = _read(read_file(name_or_path), read_with)[1]
    return _text_of(tables), read_with


def scenario_from_text(
    text: str,
    *,
    label: str = "scenario",
    folder: Path | None = None,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    recorded: bool = False,
) -> Scenario:
    """Read a scenario from text; `label` names it in error lines.

    Traces and the base of `extends` are searched in `folder`. A `recorded` scenario, from a log,
    may have old names of keys and values.
    """
    file = ScenarioFile(label, folder or Path(), text, recorded=recorded)
    return _scenario(file, overrides, seed)


def _scenario(
    file: ScenarioFile,
    overrides: Sequence[str],
    seed: int | None,
    on_drive: OnDrive = lambda _: None,
) -> Scenario:
    given, tables = _read(file, overrides, seed, on_drive)
    scenario = Scenario(tables)
    problems: list[Problem] = []
    with collected(problems):
        problems += contradictions.selections(tables)
        problems += contradictions.on_the_road(tables, scenario.route)
        for name, drive in () if problems else scenario.replays.items():
            problems += replay_problems(tables, name, drive, scenario.duration_s)
        problems += vehicle_change_problems(tables, scenario.duration_s)
        problems += limit_problems(tables, scenario.duration_s)
    if problems:
        raise _scenario_error(given, problems)
    return scenario


def _read(
    file: ScenarioFile,
    overrides: Sequence[str],
    seed: int | None = None,
    on_drive: OnDrive = lambda _: None,
) -> tuple[MergedScenario, ScenarioTables]:
    """Read all keys and the files that they name; raises ScenarioError with all problems.

    Problems that depend on the road are not checked here.
    """
    given = merged(file, overrides)
    if seed is not None:
        given.raw["seed"] = seed
        overrides = [*overrides, f"seed={seed}"]
    before = given.raw.get("overrides")
    if overrides and isinstance(before, list | None):  # the validation reports anything else
        given.raw["overrides"] = [*(before or []), *overrides]
    problems: list[Problem] = []
    raw = with_presets(given.raw, problems)
    tables: ScenarioTables | None
    try:
        tables = _with_lead_gap(
            ScenarioTables.model_validate(raw, context=RECORDED if file.recorded else None),
            recorded=file.recorded,
        )
        problems += contradictions.between_keys(tables)
    except ValidationError as error:
        problems += error_lines(error)
        tables = _valid_part(raw, error)
    if tables is not None:
        tables = _with_files(tables, given, problems, on_drive)
    if tables is None or problems or given.invalid_overrides:
        raise _scenario_error(given, problems)
    return given, tables


def _with_lead_gap(tables: ScenarioTables, *, recorded: bool) -> ScenarioTables:
    """Let the lead of a closed path keep its gap to members ahead, unless the key is given.

    A `recorded` scenario states it.
    """
    if tables.speed.lead_keeps_gap is not None or recorded or not is_closed(tables.path):
        return tables
    speed = tables.speed.model_copy(update={"lead_keeps_gap": True})
    return tables.model_copy(update={"speed": speed})


def _with_files(
    tables: ScenarioTables, given: MergedScenario, problems: list[Problem], on_drive: OnDrive
) -> ScenarioTables:
    """Replace the files that keys name by their contents; appends what is wrong with them."""
    with collected(problems):
        tables = with_points(tables, given.folder("path.file"), on_drive)
        if any(file.is_drive for file in given.files):
            tables = at_recorded_speed(tables)
    with collected(problems):
        tables = with_recordings(tables, given.folder)
    with collected(problems):
        tables = with_recorded_delays(tables, given.folder)
    with collected(problems):
        tables = with_replays(tables, given.folder)
    if not given.files[-1].recorded:  # the log that holds it is enough to read it
        with collected(problems):
            tables = with_recorded_messages(tables, given.folder)
    return tables


def _valid_part(raw: Raw, error: ValidationError) -> ScenarioTables | None:
    """Return the scenario without its invalid keys, so that its files can be checked too.

    None where nothing valid is left.
    """
    rest = deepcopy(raw)
    for problem in error.errors(include_url=False):
        _delete(rest, problem["loc"])
    try:
        return ScenarioTables.model_validate(rest)
    except ValidationError:
        return None


def _delete(raw: Raw, location: Sequence[str | int]) -> None:
    """Delete the innermost key of a location, or the whole list that it is inside."""
    table, key = raw, ""
    for part in location:
        inner = table.get(key) if key else table
        if not isinstance(inner, dict):
            break  # a list, or the value itself
        if part in inner:  # else a union tag, or a missing key
            table, key = inner, str(part)
    table.pop(key, None)


def _scenario_error(given: MergedScenario, problems: Iterable[Problem]) -> ScenarioError:
    lines = (_line(given, key, why) for key, why in problems)
    return ScenarioError((*given.invalid_overrides, *lines))


def _line(given: MergedScenario, key: str, why: str) -> str:
    source, file = given.source(key), given.files[-1]
    if file.is_drive and source == file.label and key.startswith("path"):
        return f"{source}: {why.removeprefix(f'{source}: ')}"  # the drive itself, not its key
    return f"{source}: {key}: {why}"
