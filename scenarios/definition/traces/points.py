"""The recorded drive that a scenario names, read into the scenario itself."""

from pathlib import Path

from scenarios.definition.errors import Refused
from scenarios.definition.library import TRACES
from scenarios.definition.schema.path import PointsPath, TracePath
from scenarios.definition.schema.tables import OriginTable, ScenarioTables
from scenarios.definition.traces.formats import TraceError
from scenarios.definition.traces.recorded import read_trace
from vehicles.geometry.geodesy import Origin


def with_points(tables: ScenarioTables, folder: Path) -> ScenarioTables:
    """Replace a path that names a trace by its points, and fill in the origin; raises Refused.

    A trace is sought in `folder`, then among those that ship. Without an origin in the scenario
    the plane touches the earth at the first point.
    """
    table = tables.path
    if not isinstance(table, TracePath):
        return tables.model_copy(update={"origin": tables.origin or OriginTable()})
    shipped = TRACES / table.file
    file = (
        shipped if shipped.is_file() and not (folder / table.file).exists() else folder / table.file
    )
    given = Origin(**tables.origin.model_dump()) if tables.origin else None
    try:
        trace = read_trace(file, origin=given, vehicle=table.vehicle)
    except TraceError as error:
        raise Refused("path.file", str(error)) from error
    points = PointsPath(
        kind="points",
        source=table.file,
        skipped_lines=len(trace.skipped),
        skipped_first=trace.skipped[0] if trace.skipped else "",
        east_m=trace.east_m,
        north_m=trace.north_m,
        time_s=trace.time_s,
        speed_mps=trace.speed_mps,
        **table.model_dump(include={"smoothing_m", "closed", "laps"}),
    )
    origin = trace.origin or given
    touches = (
        OriginTable()
        if origin is None
        else OriginTable(
            latitude_deg=origin.latitude_deg,
            longitude_deg=origin.longitude_deg,
            altitude_m=origin.altitude_m,
        )
    )
    return tables.model_copy(update={"origin": touches, "path": points})
