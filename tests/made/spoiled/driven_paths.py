"""Drive a file."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.check.findings import CheckReport, report_of
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path_tables import PointsPath
from tests.made.spoiled.synthetic_drives import PLACE
from vehicles.geometry.geodesy import LocalPlane

Floats = NDArray[np.float64]

SPACING = 0.05
"""Distance (m) of the points of a path that is compared."""


@dataclass(frozen=True, kw_only=True)
class Driven:
    scenario: Scenario
    report: CheckReport
    path: Floats

    @property
    def length(self) -> float:
        """Distance (m) from the first to the last recorded point along the path."""
        return self.scenario.route.path.length - self.scenario.route.first_point

    @property
    def table(self) -> PointsPath:
        assert isinstance(self.scenario.tables.path, PointsPath)
        return self.scenario.tables.path

    @property
    def left_out(self) -> int:
        return self.table.skipped_lines

    @property
    def listed(self) -> list[int]:
        places = re.findall(r"(?:line|point|message) (\d+)", " ".join(self.report.warnings))
        return [int(place) for place in places]

    def speed_at(self, distance: float) -> float:
        """Speed (m/s) at a distance from the first recorded point."""
        route = self.scenario.route
        profile = route.profile
        at = profile.time_to(distance + route.first_point - route.start)
        return profile.at(at)[0]


def load(
    folder: Path, name: str, *, lead: str = "recorded", path: str = "", more: str = ""
) -> Scenario:
    scenario_file = folder / f"{Path(name).name}.toml"
    scenario_file.write_text(
        f'name = "drive"\n[path]\nkind = "trace"\nfile = "{name}"\n{path}\n'
        f'[speed]\nlead = "{lead}"\n{more}\n'
    )
    return load_scenario(str(scenario_file), ())


def driven(
    folder: Path, name: str, *, lead: str = "recorded", path: str = "", more: str = ""
) -> Driven:
    scenario = load(folder, name, lead=lead, path=path, more=more)
    return Driven(
        scenario=scenario,
        report=report_of(scenario),
        path=_in_place(scenario, _sampled(scenario)),
    )


def written(folder: Path, name: str, data: bytes) -> str:
    (folder / name).write_bytes(data)
    return name


def _sampled(scenario: Scenario) -> Floats:
    path, begin = scenario.route.path, scenario.route.first_point
    at = np.append(np.arange(begin, path.length, SPACING), path.length)
    return np.array(
        (np.interp(at, path.station, path.east), np.interp(at, path.station, path.north))
    )


def _in_place(scenario: Scenario, points: Floats) -> Floats:
    table, origin = scenario.tables.path, scenario.origin
    assert isinstance(table, PointsPath)
    if not table.geodetic:
        offset: Floats = np.array((table.east_offset_m, table.north_offset_m))
        return np.add(points, offset[:, None])
    plane, common = LocalPlane(origin), LocalPlane(PLACE)
    every = max(1, points.shape[1] // 200)
    anchors = np.unique(np.append(np.arange(0, points.shape[1], every), points.shape[1] - 1))
    shifts = np.array(
        [
            np.subtract(common.to_plane(*plane.to_geodetic(x, y)[:2], PLACE.altitude_m), (x, y))
            for x, y in points[:, anchors].T.tolist()
        ]
    )
    along = np.arange(points.shape[1])
    moved: Floats = points + [np.interp(along, anchors, shifts[:, axis]) for axis in (0, 1)]
    return moved
