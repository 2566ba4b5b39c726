"""Limits that no run could keep, or that nobody could check."""

from collections.abc import Iterator, Sequence

from scenarios.definition.limits.limit import no_vehicle, problem_of
from scenarios.definition.refusal import shown
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.limit_rows import LIMITS
from scenarios.definition.schema.limits import DeadlineTable, ModeLimit, SourceLimit
from scenarios.definition.schema.tables import ScenarioTables

SLACK_S = 1e-9
OF_TWO = {"composite", "predecessor"}
"""Modes of a follower that hears somebody besides the lead."""

Problem = tuple[str, str]
"""Key, and what is wrong with it."""


def limit_problems(tables: ScenarioTables, duration_s: float) -> Iterator[Problem]:
    """Give limits of unknown vehicles or of a lead that has none, and deadlines after the end."""
    limits, names = tables.limits, vehicle_names(tables)
    for name, own in limits.of_vehicles.items():
        if name not in names:
            yield f"limits.{name}", no_vehicle(name, names)
            continue
        for key in own.model_fields_set:
            if problem := problem_of(LIMITS[key], name, names):
                yield f"limits.{name}.{key}", problem
    for name in ("modes", "sources", "recovery"):
        for index, limit in enumerate(getattr(limits, name)):
            key = f"limits.{name}[{index}]"
            yield from _about(tables, key, limit)
            if limit.after_s + limit.within_s > duration_s + SLACK_S:
                yield (
                    f"{key}.within_s",
                    f"given {limit.within_s:g} after {limit.after_s:g} s, allowed together at most "
                    f"the run's {duration_s:g}",
                )


def _about(tables: ScenarioTables, key: str, limit: DeadlineTable) -> Iterator[Problem]:
    names = vehicle_names(tables)
    if limit.vehicle not in names[1:]:
        allowed = f"allowed a follower: {', '.join(names[1:]) or 'there is none'}"
        yield f"{key}.vehicle", f"given {shown(limit.vehicle)}, {allowed}"
        return
    own = tables.vehicle.get(limit.vehicle)
    if own is not None and own.replay is not None:
        yield (
            f"{key}.vehicle",
            f"given {shown(limit.vehicle)}, which moves as it was recorded and listens to nobody",
        )
    if isinstance(limit, ModeLimit) and limit.vehicle == names[1] and limit.mode in OF_TWO:
        yield (
            f"{key}.mode",
            f"given {shown(limit.mode)}, but {limit.vehicle} hears the lead alone: allowed "
            '"lead", "coast", "stop" or "straight"',
        )
    if isinstance(limit, SourceLimit):
        yield from _source(names, key, limit)


def _source(names: Sequence[str], key: str, limit: SourceLimit) -> Iterator[Problem]:
    heard = dict.fromkeys((names[0], names[names.index(limit.vehicle) - 1]))
    if limit.source not in heard:
        yield (
            f"{key}.source",
            f"given {shown(limit.source)}, whom {limit.vehicle} does not hear: allowed "
            f"{' or '.join(heard)}",
        )
