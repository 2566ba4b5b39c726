"""Errors along the string as a table: a row per follower."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

from scenarios.results.vehicles.string_figures import StringFigures
from scenarios.results.vehicles.vehicle_figures import VehicleSummary


@dataclass(frozen=True, slots=True, kw_only=True)
class StringError:
    """Errors and gains of one vehicle; `number` counts from 1, the lead."""

    vehicle: str
    number: int
    error_m_max: float | None
    """Largest true error of the whole run: cross_track_error_m_max of the summary."""
    error_m_rms: float | None
    """Root mean square of the same: cross_track_error_m_rms."""
    figures: StringFigures
    """Norms and gains over the places and times that all vehicles have in common."""

    def row(self) -> dict[str, Any]:
        """All figures by name, those of `figures` too."""
        row = asdict(self)
        figures: dict[str, Any] = row.pop("figures")
        return row | figures


STRING_COLUMNS = (
    *(field.name for field in fields(StringError) if field.name != "figures"),
    *(field.name for field in fields(StringFigures)),
)


def string_errors(vehicles: Sequence[VehicleSummary]) -> tuple[StringError, ...]:
    """Errors and gains of the followers, in the order of the convoy."""
    return tuple(
        StringError(
            vehicle=row.name,
            number=number,
            error_m_max=row.cross_track_error_m_max,
            error_m_rms=row.cross_track_error_m_rms,
            figures=row.string,
        )
        for number, row in enumerate(vehicles, 1)
        if row.role != "lead"
    )
