"""Outages of a link, from what its table and its vehicles' tables ask for."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, nan

from scenarios.definition.schema.channel.outages import (
    CircleTable,
    OutageTable,
    RandomOutageTable,
    SpanTable,
    StretchTable,
)
from scenarios.definition.schema.table import Table
from transport.links.laws.effect import Effect
from transport.links.laws.outages import (
    BY_CELL,
    CircleOutage,
    Extent,
    RandomOutage,
    StretchOutage,
    TimedOutage,
)
from transport.reasons import DropReason
from vehicles.geometry.geodesy import REACH, LocalPlane
from vehicles.schedule import SECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSetting:
    """What effects of a link need to know of its run beside its table.

    `start_at` (ns) is the run's first instant, the stations (m) are those of both ends then, from
    the path's first point on. `plane` is the scenario's.
    """

    start_at: int = 0
    sender_station: float = nan
    receiver_station: float = nan
    plane: LocalPlane | None = None
    transmitter_off: Sequence[SpanTable] = ()
    receiver_off: Sequence[SpanTable] = ()

    @property
    def off(self) -> bool:
        """Whether one of the two is off at times."""
        return bool(self.transmitter_off or self.receiver_off)


def vehicles_off(setting: LinkSetting) -> list[Effect]:
    """Times at which the sender's transmitter is off, or the receiver's receiver."""
    start_at = setting.start_at
    return [
        *(_timed(one, start_at, "transmitter_off") for one in setting.transmitter_off),
        *(_timed(one, start_at, "receiver_off") for one in setting.receiver_off),
    ]


def outages(tables: Sequence[OutageTable], setting: LinkSetting) -> list[Effect]:
    """The outages of a link itself, in the order given."""
    return [_outage(index, table, setting) for index, table in enumerate(tables)]


def _outage(index: int, table: OutageTable, setting: LinkSetting) -> Effect:
    if isinstance(table, RandomOutageTable):
        # Its place among the outages is part of its draws: another one behind it changes none.
        on, off = round(table.mean_on_s * SECOND), round(table.mean_off_s * SECOND)
        return RandomOutage(on, off, setting.start_at, f"{BY_CELL} {index}")
    if isinstance(table, StretchTable):
        every = inf if table.every_m is None else table.every_m
        stretch = Extent(table.from_m, table.to_m, every)
        return StretchOutage(stretch, table.who, setting.sender_station, setting.receiver_station)
    if isinstance(table, CircleTable):
        east, north = _centre(table, setting.plane)
        return CircleOutage(east, north, table.radius_m, table.who)
    return _timed(table, setting.start_at, "outage")


def _timed(table: SpanTable, start_at: int, reason: DropReason) -> TimedOutage:
    return TimedOutage(
        start=round(table.from_s * SECOND),
        end=round(table.to_s * SECOND),
        start_at=start_at,
        every=round((table.every_s or 0.0) * SECOND),
        reason=reason,
    )


def _centre(table: CircleTable, plane: LocalPlane | None) -> tuple[float, float]:
    """Centre in the plane, which reaches it; NaN, where nobody is, without a plane."""
    if table.east_m is not None and table.north_m is not None:
        return table.east_m, table.north_m
    if plane is None or table.latitude_deg is None or table.longitude_deg is None:
        return nan, nan
    return plane.to_plane(table.latitude_deg, table.longitude_deg, plane.origin.altitude_m)


def outage_problems(tables: Sequence[Table], key: str) -> Iterator[tuple[str, str]]:
    """Give the keys of outages that contradict each other; `key` is that of their list."""
    for index, table in enumerate(tables):
        here = f"{key}[{index}]"
        if isinstance(table, SpanTable):
            yield from _span_problems(here, "s", table.from_s, table.to_s, table.every_s)
        elif isinstance(table, StretchTable):
            yield from _span_problems(here, "m", table.from_m, table.to_m, table.every_m)
        elif isinstance(table, CircleTable):
            yield from _circle_problems(here, table)


def far_circles(tables: Sequence[Table], key: str, plane: LocalPlane) -> Iterator[tuple[str, str]]:
    """Give the circles whose place on the earth is not near the plane's; `key` as above."""
    for index, table in enumerate(tables):
        if not isinstance(table, CircleTable):
            continue
        latitude, longitude = table.latitude_deg, table.longitude_deg
        if latitude is None or longitude is None:
            continue
        if not plane.reaches(latitude, longitude, plane.origin.altitude_m):
            yield (
                f"{key}[{index}].latitude_deg",
                f"given {latitude:g} with longitude_deg {longitude:g}, allowed up to "
                f"{REACH / 1000.0:g} km from the origin of the plane",
            )


def _span_problems(
    key: str, unit: str, start: float, end: float, every: float | None
) -> Iterator[tuple[str, str]]:
    if end <= start:
        yield f"{key}.to_{unit}", f"given {end:g}, allowed more than {start:g}, its from_{unit}"
    elif every is not None and every < end - start:
        yield (
            f"{key}.every_{unit}",
            f"given {every:g}, allowed at least {end - start:g}, the length of the span",
        )


def _circle_problems(key: str, table: CircleTable) -> Iterator[tuple[str, str]]:
    pairs = (("east_m", "north_m"), ("latitude_deg", "longitude_deg"))
    given = [[one for one in pair if getattr(table, one) is not None] for pair in pairs]
    if given[0] and given[1]:
        yield f"{key}.{given[1][0]}", f"given together with {given[0][0]}, allowed one of them"
    elif not given[0] and not given[1]:
        yield f"{key}.east_m", "missing, needed with north_m, or latitude_deg and longitude_deg"
    for pair, found in zip(pairs, given, strict=True):
        if len(found) == 1:
            (missing,) = set(pair) - set(found)
            yield f"{key}.{missing}", f"missing, needed with {found[0]}"
