"""Runs along one path: where their vehicles part, by place and by time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.results.data_table import DataTable
from scenarios.results.run_record import ModeFrom, RunRecord, mode_changes
from transport.log.errors import LogError
from vehicles.geometry.driven_path import PathWalk
from vehicles.geometry.geodesy import LocalPlane

Floats = NDArray[np.float64]
BESIDE_M = 50.0
"""Largest offset from the common path; a vehicle further away drives another road."""
POSITION_COLUMNS = (
    *("label", "vehicle", "parts_at_m", "parts_at_s", "difference_m_max", "difference_at_m"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedVehicle:
    """A vehicle of one run on the common path, at its true poses (N).

    `true` are its true states, with the error from the lead's path and the gap. `station_m` is the
    distance along the path from the place where the lead of A starts, and `offset_m` the offset to
    its left; NaN beside another road. East and north are those of the common plane.
    """

    name: str
    true: DataTable
    modes: tuple[ModeFrom, ...]
    east_m: Floats
    north_m: Floats
    station_m: Floats
    offset_m: Floats

    def station_at(self, at_s: Floats) -> Floats:
        """Stations (m) at times (s); NaN outside of the record."""
        return _known(at_s, self.true.t_s, self.station_m)

    def by_place(self) -> tuple[Floats, Floats]:
        """Increasing stations and their offsets, the last one at each place."""
        known = np.isfinite(self.station_m) & np.isfinite(self.offset_m)
        station, offset = self.station_m[known], self.offset_m[known]
        keep = np.ones(station.size, bool)
        keep[:-1] = station[:-1] < np.minimum.accumulate(station[::-1])[::-1][1:]
        return station[keep], offset[keep]


@dataclass(frozen=True, slots=True, kw_only=True)
class OffsetDifference:
    """Offset of a vehicle of run `label` minus that of the same vehicle of A, at equal places (M).

    `station_m` are places of A; `at_s` the times at which the vehicle of `label` is there. The
    vehicles part at row `parts`, None if they never differ by `apart_m`.
    """

    label: str
    vehicle: str
    station_m: Floats
    at_s: Floats
    offset_m: Floats
    apart_m: float

    @property
    def parts(self) -> int | None:
        beyond = np.flatnonzero(np.abs(self.offset_m) > self.apart_m)
        return int(beyond[0]) if beyond.size else None

    @property
    def largest(self) -> int | None:
        """Row of the largest difference; None without a common place."""
        return int(np.abs(self.offset_m).argmax()) if self.offset_m.size else None

    def row(self) -> dict[str, str | float | None]:
        """Where the vehicles part, and their largest difference, to the left positive."""

        def at(values: Floats, row: int | None) -> float | None:
            return None if row is None else float(values[row])

        places = (
            at(self.station_m, self.parts),
            at(self.at_s, self.parts),
            at(self.offset_m, self.largest),
            at(self.station_m, self.largest),
        )
        return dict(zip(POSITION_COLUMNS, (self.label, self.vehicle, *places), strict=True))

    @property
    def sentence(self) -> str:
        """Where the vehicles part; empty if they do not."""
        if (row := self.parts) is None:
            return ""
        side = "left" if self.offset_m[row] > 0.0 else "right"
        return (
            f"{self.label} leaves A at {self.station_m[row]:.1f} m ({self.at_s[row]:.2f} s): "
            f"{self.vehicle} is {abs(self.offset_m[row]):.2f} m to the {side}"
        )


def first_parting(differences: Sequence[OffsetDifference]) -> OffsetDifference | None:
    """The difference that exceeds its limit at the earliest time."""
    parted = [(one.at_s[one.parts], one) for one in differences if one.parts is not None]
    return min(parted, key=lambda pair: pair[0])[1] if parted else None


def placed_vehicles(record: RunRecord, reference: RunRecord) -> Mapping[str, PlacedVehicle]:
    """Place the vehicles of a run on the path of the lead in the reference run."""
    route = reference.scenario.route
    placed = {}
    for name, vehicle in record.vehicles.items():
        if "truth" not in record.topics_of(name):
            continue  # such as a vehicle that never started
        true = vehicle.true
        points = _in_plane_of(np.stack((true.east_m, true.north_m)), record, reference)
        east, north = points[:, 0].tolist()
        start = route.path.project(east, north, None).station - true.distance_m.item(0)
        station, offset = PathWalk(route.path, start).feet(points, true.distance_m)
        away = ~(np.abs(offset) <= BESIDE_M)
        station[away] = offset[away] = np.nan
        placed[name] = PlacedVehicle(
            name=name,
            true=true,
            modes=mode_changes(vehicle),
            east_m=points[0],
            north_m=points[1],
            station_m=station - route.start,
            offset_m=offset,
        )
    if not placed:
        raise LogError(f"{record.log}: holds no true poses of a vehicle")
    return placed


def _in_plane_of(points: Floats, run: RunRecord, reference: RunRecord) -> Floats:
    """Move points (2, n) into the plane of the reference run, if its origin differs."""
    origin, wanted = run.scenario.origin, reference.scenario.origin
    if origin == wanted:
        return points
    plane, target = LocalPlane(origin), LocalPlane(wanted)
    geodetic = np.array([plane.to_geodetic(east, north) for east, north in points.T.tolist()])
    return target.to_plane_all(geodetic[:, 0], geodetic[:, 1], wanted.altitude_m)


def offset_difference(
    label: str, a: PlacedVehicle, b: PlacedVehicle, apart_m: float
) -> OffsetDifference:
    """Compare a vehicle of A with that of run `label`."""
    station, offset = a.by_place()
    times = _known(station, *_increasing(b))
    difference = _known(station, *b.by_place()) - offset
    known = np.isfinite(difference) & np.isfinite(times)
    return OffsetDifference(
        label=label,
        vehicle=a.name,
        station_m=station[known],
        at_s=times[known],
        offset_m=difference[known],
        apart_m=apart_m,
    )


def _increasing(vehicle: PlacedVehicle) -> tuple[Floats, Floats]:
    """Stations and the first time at which the vehicle is there."""
    known = np.isfinite(vehicle.station_m)
    furthest = np.maximum.accumulate(vehicle.station_m[known])
    station, rows = np.unique(furthest, return_index=True)
    return station, vehicle.true.t_s[known][rows]


def _known(at: Floats, known_at: Floats, values: Floats) -> Floats:
    """Interpolate; NaN outside of the known range."""
    if not known_at.size:
        return np.full(at.size, np.nan)
    found: Floats = np.interp(at, known_at, values, np.nan, np.nan)
    return found
