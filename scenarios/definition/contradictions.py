"""Keys of a scenario that contradict each other, each valid by itself."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from scenarios.definition.changes import link_change_problems
from scenarios.definition.channel.build import end_problems, entries_about, requested_link, ties
from scenarios.definition.errors import Problem
from scenarios.definition.road.point_path import LONGEST
from scenarios.definition.road.route import Route, longest_run, vehicle_names
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.path_tables import SegmentTable
from scenarios.definition.schema.plug_ins.table import default_of
from scenarios.definition.schema.scenario_tables import OriginTable, ScenarioTables, VehicleTable
from scenarios.definition.topology import directed_links, flow_problems
from scenarios.definition.vehicle_setup import vehicle_setup
from scenarios.definition.wording import toml_repr
from transport.links.laws.link_law import LinkLaw
from transport.topics import RUN_SENDER
from vehicles.car.dynamics import fastest_rate
from vehicles.geometry.geodesy import REACH, LocalPlane, Origin

# ---- Contradictions


FASTEST_RATE = 20_000.0
"""Fastest rate (1/s) of a car's tyres or steering that runs in real time; the paper's car has 206.
A truck's mass on a toy's inertia would take hours per second."""

MOST_PERIODS = 10_000
"""Number of periods of the lead's speed, each of which has 64 points."""

MARGIN = 1000.0
"""Distance (m) of the road from the reach of the plane, so that noise does not leave it."""


def between_keys(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield keys that contradict others, except those that depend on the path."""
    yield from _names(tables)
    yield from _flow(tables)
    yield from _links(tables)
    yield from link_change_problems(tables)
    yield from _channels(tables)
    yield from _senders(tables)
    yield from _speed(tables)
    yield from _path(tables)
    yield from _cars(tables)
    yield from _gap_sensors(tables)


def _names(tables: ScenarioTables) -> Iterator[Problem]:
    convoy, names = tables.convoy, vehicle_names(tables)
    usual = type(convoy).model_fields["vehicles"].default  # ignored with names
    if convoy.names and convoy.vehicles not in {len(names), usual}:
        yield "convoy.vehicles", f"given {convoy.vehicles}, but convoy.names has {len(names)} names"
    for index, name in enumerate(names):
        if name in names[:index]:
            first = names.index(name)
            yield (
                f"convoy.names[{index}]",
                f"given {toml_repr(name)}, already convoy.names[{first}]",
            )
        elif name == RUN_SENDER:
            yield (
                f"convoy.names[{index}]",
                f"given {toml_repr(name)}, which is the launcher's own name",
            )
    yield from _vehicles(tables, names)


def _vehicles(tables: ScenarioTables, names: Sequence[str]) -> Iterator[Problem]:
    for name, vehicle in tables.vehicle.items():
        if name not in names:
            yield f"vehicle.{name}", f"no such vehicle, allowed {', '.join(names)}"
        elif name == names[0] and vehicle.gap_m is not None:
            yield f"vehicle.{name}.gap_m", "given for the lead, which has no predecessor"
        if name == names[0] and vehicle.replay is not None:
            yield f"vehicle.{name}.replay", "given for the lead, whose drive is path.file"
        for key in sorted(vehicle.model_fields_set):
            if vehicle.replay is None and key.startswith("replay_"):
                yield f"vehicle.{name}.{key}", "given without replay, allowed only with it"


def _flow(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield invalid sources, and followers that degrade without data of their predecessor."""
    names = vehicle_names(tables)
    if len(set(names)) < len(names):  # reported by _names
        return
    problems = list(flow_problems(tables))
    yield from problems
    for name in () if problems else names[1:]:
        setup = vehicle_setup(tables, name)
        if name in tables.replayed:
            continue
        law = setup.steering.longitudinal
        needs = tables.speed.followers == "gap" and getattr(law.plugged, "needs_predecessor", False)
        if needs and setup.predecessor not in setup.flow.longitudinal:
            yield (
                "information_flow.longitudinal",
                f"{setup.predecessor} is not a source of {name}, whose control.longitudinal = "
                f'{toml_repr(law.use)} needs its predecessor, allowed with "consensus"',
            )
            return
        if setup.degradation.reaction == "degrade" and setup.predecessor not in setup.senders:
            yield (
                "information_flow",
                f"{name} does not receive its predecessor {setup.predecessor}, for which it brakes "
                'with control.degradation.reaction = "degrade": add it to a '
                'direction, or set another reaction, such as "extrapolate"',
            )
            return


def _links(tables: ScenarioTables) -> Iterator[Problem]:
    names = vehicle_names(tables)
    for index, link in enumerate(tables.link):
        for key, why in end_problems(link, tables):
            yield f"link[{index}]{key}", why
    for first, later, key in ties(tables):
        yield (
            f"link[{later}].{key}",
            f"given by link[{first}] too, which is equally specific for a link, allowed in one of "
            "them",
        )
    yield from dict.fromkeys(_laws(tables, names))


def _laws(tables: ScenarioTables, names: Sequence[str]) -> Iterator[Problem]:
    for pair in directed_links(tables):
        about = [entry for _, entry in entries_about(tables.link, names, *pair)]
        link = requested_link(tables, names, *pair)
        merged = {"loss": link.loss, "collisions": link.collisions, "radio": link.radio}
        for key, why in _problems_of(merged, _problems):
            table = key.split(".")[0]
            source_key = next(
                (one for one in reversed(about) if table in one.model_fields_set), None
            )
            index = next(
                (place for place, one in enumerate(tables.link) if one is source_key), None
            )
            yield (f"links.{key}" if index is None else f"link[{index}].{key}"), why


def _channels(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield contradictions inside one table of a link, or of a vehicle's radio."""
    laws: dict[str, LinkLaw | None] = {}
    for key, link in _link_tables(tables).items():
        laws |= {f"{key}.content": link.content, f"{key}.delay": link.delay}
        laws |= _listed(f"{key}.outages", link.outages)
    for name, vehicle in tables.vehicle.items():
        laws |= _listed(f"vehicle.{name}.transmitter_off", vehicle.transmitter_off)
        laws |= _listed(f"vehicle.{name}.receiver_off", vehicle.receiver_off)
    yield from _problems_of(laws, _problems)


def _listed(key: str, laws: Sequence[LinkLaw] | None) -> dict[str, LinkLaw | None]:
    return {f"{key}[{place}]": law for place, law in enumerate(laws or ())}


def _problems(law: LinkLaw) -> Iterator[Problem]:
    return law.problems()


def _problems_of(
    laws: Mapping[str, LinkLaw | None], problems: Callable[[LinkLaw], Iterator[Problem]]
) -> Iterator[Problem]:
    for place, law in laws.items():
        if law is not None:
            yield from ((f"{place}.{key}", why) for key, why in problems(law))


def _link_tables(tables: ScenarioTables) -> dict[str, LinkTable]:
    return {"links": tables.links, **{f"link[{k}]": one for k, one in enumerate(tables.link)}}


def _senders(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield contradictions of receivers and sending, and of link rates with the rule of sending."""
    result: dict[Problem, None] = {}
    names = vehicle_names(tables)
    for name in names:
        own, setup = tables.vehicle.get(name), vehicle_setup(tables, name)
        gnss = f"vehicle.{name}.gnss" if own and own.gnss else "gnss"
        sending = f"vehicle.{name}.sending" if own and own.sending else "sending"
        result |= {(f"{gnss}.{key}", why): None for key, why in setup.gnss.problems()}
        result |= {(f"{sending}.{key}", why): None for key, why in setup.sending.problems()}
    yield from result
    if result:
        return
    for sender, receiver in directed_links(tables):
        setup = vehicle_setup(tables, sender)
        rate_hz = requested_link(tables, names, sender, receiver).rate_hz
        if rate_hz is None or setup.even_rate_hz is not None:
            continue
        entries = entries_about(tables.link, names, sender, receiver)
        sources = [one for _, one in entries if "rate_hz" in one.model_fields_set]
        key = f"link[{tables.link.index(sources[-1])}]" if sources else "links"
        yield (
            f"{key}.rate_hz",
            f"given {rate_hz:g}, but {sender} does not send periodically, allowed with "
            'sending.kind = "every_fix" or "fixed" and without dcc',
        )
        return


def _oscillation(tables: ScenarioTables) -> Iterator[Problem]:
    speed, oscillation = tables.speed, tables.speed.oscillation
    if oscillation.amplitude_mps > speed.set_mps:
        allowed = f"allowed at most {speed.set_mps:g}, the set speed"
        yield "speed.oscillation.amplitude_mps", f"given {oscillation.amplitude_mps:g}, {allowed}"
    if tables.duration_s is None:
        yield "duration_s", 'missing, needed with speed.lead = "oscillating"'
    elif tables.duration_s * oscillation.frequency_hz > MOST_PERIODS:
        allowed = f"allowed at most {MOST_PERIODS / tables.duration_s:.3g} for this duration"
        yield "speed.oscillation.frequency_hz", f"given {oscillation.frequency_hz:g}, {allowed}"


def _speed(tables: ScenarioTables) -> Iterator[Problem]:
    speed = tables.speed
    if speed.lead == "profile" and not speed.profile:
        yield "speed.profile", 'missing, needed with speed.lead = "profile"'
    if speed.lead == "oscillating":
        yield from _oscillation(tables)
    for index, (before, after) in enumerate(itertools.pairwise(speed.profile), 1):
        if after.at_s <= before.at_s:
            allowed = f"allowed more than {before.at_s}, the entry before"
            yield f"speed.profile[{index}].at_s", f"given {after.at_s}, {allowed}"


def selections(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield selected longitudinal laws that do not fit the speed, and repeated names."""
    speed, laws = tables.speed, {"control": tables.control.longitudinal}
    for name, own in tables.vehicle.items():
        if own.control and "longitudinal" in own.control.model_fields_set:
            laws[f"vehicle.{name}.control"] = own.control.longitudinal
    for place, law in laws.items():
        key, given = f"{place}.longitudinal", f"given {law.use}, but speed"
        if speed.followers != "gap" and law != default_of(law.point):
            allowed = f'{given}.followers = {toml_repr(speed.followers)}, allowed with "gap"'
            yield key, allowed
        elif getattr(law.plugged, "needs_headway", False) and not speed.gap.headway_s:
            yield key, f"{given}.gap.headway_s = 0, allowed with more than 0"
    for key, entries in (("event", tables.event), ("figure", tables.figure)):
        words = [table.word for table in entries]
        for index, word in enumerate(words):
            if word in words[:index]:
                yield f"{key}[{index}]", f"given {word} twice, allowed one of a name"


def _path(tables: ScenarioTables) -> Iterator[Problem]:
    path = tables.path
    if path.kind == "segments":
        for index, segment in enumerate(path.segments):
            yield from _segment(f"path.segments[{index}]", segment)
    elif not path.closed and path.laps > 1:
        yield "path.laps", f"given {path.laps}, allowed 1 unless path.closed = true"
    if path.kind == "points":
        yield from _points(path.model_dump())


def _segment(key: str, segment: SegmentTable) -> Iterator[Problem]:
    if (segment.radius_m is None) != (segment.turn is None):
        given, needed = ("turn", "radius_m") if segment.radius_m is None else ("radius_m", "turn")
        yield f"{key}.{needed}", f"missing, needed with {given}"
    if segment.radius_m is not None and segment.curvature_per_m is not None:
        yield f"{key}.curvature_per_m", "given together with radius_m, allowed one of them"


def _points(path: dict[str, tuple[float, ...]]) -> Iterator[Problem]:
    wanted = len(path["east_m"])
    for key in ("north_m", "time_s", "speed_mps"):
        if len(path[key]) != wanted and (path[key] or key == "north_m"):
            yield f"path.{key}", f"given {len(path[key])} numbers, allowed {wanted} as path.east_m"


def _cars(tables: ScenarioTables) -> Iterator[Problem]:
    problems: dict[str, str] = {}
    for name in vehicle_names(tables):
        own = tables.vehicle.get(name)
        setup = vehicle_setup(tables, name)
        rate = max(map(fastest_rate, (setup.parameters, setup.assumed_parameters)))
        if rate > FASTEST_RATE:
            table = f"vehicle.{name}.parameters" if own and own.parameters else "parameters"
            problems[table] = (
                f"the car's tyres and steering answer at {rate:.3g} 1/s, allowed up to "
                f"{FASTEST_RATE:g}: too stiff for its mass and yaw inertia"
            )
    yield from problems.items()


def _gap_sensors(tables: ScenarioTables) -> Iterator[Problem]:
    names = vehicle_names(tables)
    common = tables.gap_sensor.model_fields_set
    some_have_range = any(_has_range(tables.vehicle.get(name)) for name in names[1:])
    if common and "range_m" not in common and not some_have_range:
        yield "gap_sensor.range_m", "missing, needed with other keys of the sensor"
    for name, own in tables.vehicle.items():
        if own.gap_sensor is None:
            continue
        if name == names[0]:
            yield f"vehicle.{name}.gap_sensor", "given, but the lead has no predecessor to measure"
        elif not (_has_range(own) or "range_m" in common):
            yield f"vehicle.{name}.gap_sensor.range_m", "missing, needed with other keys"


def _has_range(own: VehicleTable | None) -> bool:
    sensor = own and own.gap_sensor
    return bool(sensor and "range_m" in sensor.model_fields_set)


def on_the_road(tables: ScenarioTables, route: Route) -> Iterator[Problem]:
    """Yield problems that show on the road, such as a path that is too short."""
    duration = tables.duration_s
    if duration is None and not 0.0 < longest_run(route) < LONGEST:
        yield "duration_s", "missing, needed where the lead does not reach the end of its path"
    elif duration is not None and route.profile.distance(duration) > route.length + 1e-3:
        driven = route.profile.distance(duration)
        yield (
            "duration_s",
            f"given {duration:g}, allowed at most {longest_run(route):g}: the lead would drive "
            f"{driven:.1f} m, its path is {route.length:.1f} m long",
        )
    yield from _out_of_reach(tables, route)
    origin = tables.origin or OriginTable()
    plane = LocalPlane(Origin(origin.latitude_deg, origin.longitude_deg, origin.altitude_m))
    for key, link in _link_tables(tables).items():
        outages = _listed(f"{key}.outages", link.outages)
        yield from _problems_of(outages, lambda law: law.plane_problems(plane))


def _out_of_reach(tables: ScenarioTables, route: Route) -> Iterator[Problem]:
    """Yield where the road leaves the plane, beyond which vehicles accept no poses."""
    driven = route.length
    if tables.duration_s is not None:
        driven = min(driven, route.profile.distance(tables.duration_s))
    path, least = route.path, route.start_station(len(vehicle_names(tables)) - 1)
    away = np.hypot(path.east, path.north)
    on_road = (path.station >= least) & (path.station <= route.start + driven)
    beyond = np.flatnonzero(on_road & (away > REACH - MARGIN))
    if beyond.size:
        first = int(beyond[0])
        after = max(float(path.station[first]) - route.start, 0.0)
        yield (
            "path",
            f"given {np.max(away[on_road]) / 1000.0:.1f} km from the origin of the plane, allowed "
            f"at most {(REACH - MARGIN) / 1000.0:g} km: the lead gets there after {after:.0f} m; "
            "shorten duration_s or the path, or cut the drive in two",
        )
