"""The radio of a directed link, from its table: effects, and keys that contradict each other."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from scenarios.definition.road.route import Route
from scenarios.definition.schema.channel.radio import (
    ErrorTable,
    ObstructionTable,
    PathLossRadio,
    PerVehicleTable,
    RadioTable,
    ShadowingTable,
    TableRadio,
)
from scenarios.definition.schema.links import LinkTable
from transport.links.laws.radio.delivery import (
    DeliveryOverDistance,
    ErrorCurve,
    Propagation,
    Sight,
    highway_loss,
    noise_power,
)
from transport.links.laws.radio.obstruction import (
    Obstruction,
    OnceForAll,
    PerVehicle,
    Road,
    VehiclesBetween,
)
from transport.links.laws.radio.reservations import Reservations
from transport.links.laws.radio.shadowing import ShadowField
from vehicles.geometry.path import Path

ROAD_STEP = 2.0
"""Metres between two places of the road by which vehicles in between are sought."""

Between = Callable[[], VehiclesBetween]
"""Says who drives between sender and receiver, and along which road."""


def nobody() -> VehiclesBetween:
    """Say that there is nobody between sender and receiver."""
    return VehiclesBetween(0, Road(1.0, (0.0, 0.0), (0.0, 0.0)), 0.0, 0.0)


def vehicles_between(route: Route, sender: int, receiver: int) -> VehiclesBetween:
    """Say who drives between the vehicles at two places of the convoy, the lead's being 0."""
    first = float(route.path.station[0])
    return VehiclesBetween(
        count=max(abs(receiver - sender) - 1, 0),
        road=_road(route.path),
        sender_start=route.start_station(sender) - first,
        receiver_start=route.start_station(receiver) - first,
    )


def _road(path: Path) -> Road:
    """Sample a path; the last piece is on the straight that leaves it."""
    first, count = float(path.station[0]), int(path.length / ROAD_STEP) + 1
    nodes = first + ROAD_STEP * np.arange(count)
    beyond = [path.at(first + ROAD_STEP * (count + more)) for more in (0, 1)]
    return Road(
        ROAD_STEP,
        (*np.interp(nodes, path.station, path.east).tolist(), *(point.east for point in beyond)),
        (*np.interp(nodes, path.station, path.north).tolist(), *(point.north for point in beyond)),
    )


def radio_effect(table: RadioTable, between: Between) -> DeliveryOverDistance | Propagation:
    """Return what a link's radio does to messages; `between` is asked where it matters."""
    if isinstance(table, TableRadio):
        return DeliveryOverDistance(table.distance_m, table.delivery_ratio, _reservations(table))
    own = table.reference_loss_db, table.exponent
    is_own = table.propagation == "log_distance"
    reference, exponent = own if is_own else (highway_loss(table.frequency_hz), 2.0)
    errors, shadowing = table.errors, table.shadowing or ShadowingTable()
    field = ShadowField(shadowing.decorrelation_m)
    return Propagation(
        power=table.power_dbm,
        noise=noise_power(table.bandwidth_hz, table.noise_figure_db),
        reference=reference,
        exponent=exponent,
        in_sight=Sight(ErrorCurve(errors.snr_db, errors.error_ratio), shadowing.deviation_db),
        obstructed=Sight(
            ErrorCurve(errors.obstructed_snr_db, errors.obstructed_error_ratio),
            shadowing.obstructed_deviation_db,
        ),
        shadowing=field if table.shadowing else None,
        obstruction=_obstruction(table.obstruction, between, field),
    )


def _reservations(table: TableRadio) -> Reservations | None:
    if table.burst == "independent":
        return None
    return Reservations(
        table.reselection_messages_min, table.reselection_messages_max, table.keep_ratio
    )


def _obstruction(
    table: ObstructionTable | None, between: Between, shadowing: ShadowField
) -> Obstruction | None:
    if table is None:
        return None
    others = between()
    if not others.count:
        return None
    others = replace(others, radius=table.radius_m)
    if isinstance(table, PerVehicleTable):
        return PerVehicle(others, table.loss_db)
    wavering = ShadowField(shadowing.decorrelation, "obstruction")
    return OnceForAll(others, table.mean_db, table.deviation_db, wavering)


def radio_problems(link: LinkTable) -> Iterator[tuple[str, str]]:
    """Give every key of a link's radio that does not fit the others, as `radio.distance_m`."""
    table = link.radio
    if isinstance(table, PathLossRadio):
        yield from _curve_problems("radio.errors", table.errors)
    if not isinstance(table, TableRadio):
        return
    yield from _pair_problems("radio", "distance_m", "delivery_ratio", table.model_dump())
    least, most = table.reselection_messages_min, table.reselection_messages_max
    if most < least:
        allowed = f"at least reselection_messages_min, {least}"
        yield "radio.reselection_messages_max", f"given {most}, allowed {allowed}"


def _curve_problems(key: str, table: ErrorTable) -> Iterator[tuple[str, str]]:
    for word in ("", "obstructed_"):
        numbers = table.model_dump()
        yield from _pair_problems(key, f"{word}snr_db", f"{word}error_ratio", numbers)
        errors = numbers[f"{word}error_ratio"]
        for index, (before, after) in enumerate(pairwise(errors), 1):
            if after >= before:
                why = f"given {after}, allowed less than {before}, the entry before"
                yield f"{key}.{word}error_ratio[{index}]", why


def _pair_problems(
    key: str, over: str, numbers: str, given: Mapping[str, tuple[float, ...]]
) -> Iterator[tuple[str, str]]:
    """Two lists must be of one length, and the first of them increasing."""
    if len(given[over]) != len(given[numbers]):
        count, wanted = len(given[numbers]), len(given[over])
        yield f"{key}.{numbers}", f"given {count} numbers, allowed {wanted} as {key}.{over}"
    for index, (before, after) in enumerate(pairwise(given[over]), 1):
        if after <= before:
            why = f"given {after}, allowed more than {before}, the entry before"
            yield f"{key}.{over}[{index}]", why
