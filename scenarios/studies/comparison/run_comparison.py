"""Runs along one path: where the vehicles of several runs part, by place and by time."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.errors import ScenarioError
from scenarios.results.data_table import DataTable
from scenarios.results.run_record import ModeFrom, RunRecord, mode_changes
from scenarios.results.summary import RunSummary
from scenarios.results.vehicle_figures import StringError, string_errors
from transport.log.errors import LogError
from vehicles.geometry.driven_path import PathWalk
from vehicles.geometry.geodesy import LocalPlane

Floats = NDArray[np.float64]
SCHEMA = "convoy.compare/1"
TOLERANCE_M = 0.1
"""Difference from which two runs count as different, above the noise of usual receivers."""
BESIDE_M = 50.0
"""Largest offset from the common path; a vehicle further away drives another road."""
MOST_RUNS = 8


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
class ComparedRun:
    """One run with its label (A, B, …), its figures if the log holds them, and its vehicles."""

    label: str
    record: RunRecord
    summary: RunSummary | None
    vehicles: Mapping[str, PlacedVehicle]

    @property
    def title(self) -> str:
        about = self.summary.identity if self.summary else None
        name = (about.title or about.scenario) if about else ""
        return f"{self.label}: {name or self.record.log}"

    @property
    def string_errors(self) -> tuple[StringError, ...]:
        """Errors along the string; none without figures."""
        return string_errors(self.summary.vehicles) if self.summary else ()

    @property
    def ran_s(self) -> float:
        """Time of the last true pose."""
        return max(float(vehicle.true.t_s[-1]) for vehicle in self.vehicles.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class OffsetDifference:
    """Offset of a vehicle of run `label` minus that of the same vehicle of A, at equal places (M).

    `station_m` are places of A; `at_s` the times at which the vehicle of `label` is there.
    """

    label: str
    vehicle: str
    station_m: Floats
    at_s: Floats
    offset_m: Floats

    @property
    def largest(self) -> tuple[float, float]:
        """Largest difference (m, with its sign) and its place (m)."""
        if not self.offset_m.size:
            return 0.0, float("nan")
        row = int(np.abs(self.offset_m).argmax())
        return float(self.offset_m[row]), float(self.station_m[row])


@dataclass(frozen=True, slots=True, kw_only=True)
class Divergence:
    """The first place at which a vehicle of run `label` is beside its place in A.

    `station_m` is the place along the path of A, `at_s` the time in run `label`, and `offset_m` the
    difference there.
    """

    label: str
    vehicle: str
    station_m: float
    at_s: float
    offset_m: float

    @property
    def sentence(self) -> str:
        side = "left" if self.offset_m > 0.0 else "right"
        return (
            f"{self.label} leaves A at {self.station_m:.1f} m ({self.at_s:.2f} s): {self.vehicle} "
            f"is {abs(self.offset_m):.2f} m to the {side}"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunComparison:
    """Several runs on the path of the first one, A.

    `first` is the earliest divergence by time, None if no vehicle differs by more than
    `tolerance_m`. `faults` describe damage, holes and missing parts of the logs.
    """

    runs: tuple[ComparedRun, ...]
    tolerance_m: float
    differences: tuple[OffsetDifference, ...]
    divergences: tuple[Divergence, ...]
    faults: tuple[str, ...]

    @property
    def first(self) -> Divergence | None:
        return min(self.divergences, key=lambda one: (one.at_s, one.station_m), default=None)

    @property
    def sentence(self) -> str:
        if self.first is None:
            return f"no vehicle differs by {self.tolerance_m:g} m at the same place"
        return self.first.sentence

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield where each vehicle of B, C, … leaves its place in A, and its largest difference."""
        places = {(one.label, one.vehicle): one for one in self.divergences}
        for one in self.differences:
            place = places.get((one.label, one.vehicle))
            largest, at_m = one.largest if one.offset_m.size else (None, None)
            yield {
                "label": one.label,
                "vehicle": one.vehicle,
                "diverges_at_m": place.station_m if place else None,
                "diverges_at_s": place.at_s if place else None,
                "difference_m_max": largest,
                "difference_at_m": at_m,
            }


def compare_runs(
    logs: Sequence[Path],
    tolerance_m: float = TOLERANCE_M,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> RunComparison:
    """Read runs and compare each with the first one; raises LogError or ScenarioError.

    `report` is called with the number of runs that have been read and their total number.
    """
    if not 2 <= len(logs) <= MOST_RUNS:
        raise ScenarioError([f"compare: given {len(logs)} runs, allowed 2 to {MOST_RUNS}"])
    faults: list[str] = []
    runs: list[ComparedRun] = []
    for label, log in zip(ascii_uppercase, logs, strict=False):
        record = RunRecord(log)
        if record.faults:
            faults.append(record.faults)
        reference = runs[0].record if runs else record
        vehicles = _placed(record, reference)
        summary = _summary(record, faults)
        runs.append(ComparedRun(label=label, record=record, summary=summary, vehicles=vehicles))
        report(len(runs), len(logs))
    differences = tuple(
        _difference(run.label, one, run.vehicles[name])
        for run in runs[1:]
        for name, one in runs[0].vehicles.items()
        if name in run.vehicles
    )
    found = (_divergence(difference, tolerance_m) for difference in differences)
    return RunComparison(
        runs=tuple(runs),
        tolerance_m=tolerance_m,
        differences=differences,
        divergences=tuple(one for one in found if one is not None),
        faults=tuple(faults),
    )


def _summary(record: RunRecord, faults: list[str]) -> RunSummary | None:
    try:
        return record.summary
    except (LogError, ScenarioError) as error:
        faults.append(str(error))
        return None


def _placed(record: RunRecord, reference: RunRecord) -> dict[str, PlacedVehicle]:
    """Place the vehicles of a run on the path of the lead in the reference run."""
    route = reference.scenario.route
    placed = {}
    for name, vehicle in record.vehicles.items():
        if not len(record.columns_of("truth").get(name, ())):
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
    if run.known_scenario is None:
        return points
    origin, wanted = run.known_scenario.origin, reference.scenario.origin
    if origin == wanted:
        return points
    plane, target = LocalPlane(origin), LocalPlane(wanted)
    geodetic = np.array([plane.to_geodetic(east, north) for east, north in points.T.tolist()])
    return target.to_plane_all(geodetic[:, 0], geodetic[:, 1], wanted.altitude_m)


def _difference(label: str, a: PlacedVehicle, b: PlacedVehicle) -> OffsetDifference:
    station, offset = a.by_place()
    places, offsets = b.by_place()
    if places.size:
        times = _known(station, *_increasing(b))
        difference = _known(station, places, offsets) - offset
    else:
        times = difference = np.full(station.size, np.nan)
    known = np.isfinite(difference) & np.isfinite(times)
    return OffsetDifference(
        label=label,
        vehicle=a.name,
        station_m=station[known],
        at_s=times[known],
        offset_m=difference[known],
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


def _divergence(difference: OffsetDifference, tolerance_m: float) -> Divergence | None:
    beyond = np.flatnonzero(np.abs(difference.offset_m) > tolerance_m)
    if not beyond.size:
        return None
    row = int(beyond[0])
    return Divergence(
        label=difference.label,
        vehicle=difference.vehicle,
        station_m=float(difference.station_m[row]),
        at_s=float(difference.at_s[row]),
        offset_m=float(difference.offset_m[row]),
    )


def to_json(comparison: RunComparison) -> str:
    first = comparison.first
    content = {
        "schema": SCHEMA,
        "runs": {run.label: str(run.record.log) for run in comparison.runs},
        "tolerance_m": comparison.tolerance_m,
        "log_faults": list(comparison.faults),
        "first": None if first is None else asdict(first) | {"sentence": first.sentence},
        "divergences": [asdict(one) for one in comparison.divergences],
        "differences": [
            {"label": one.label, "vehicle": one.vehicle}
            | dict(zip(("offset_m_max", "station_m"), one.largest, strict=True))
            for one in comparison.differences
            if one.offset_m.size
        ],
    }
    return json.dumps(content, indent=2) + "\n"
