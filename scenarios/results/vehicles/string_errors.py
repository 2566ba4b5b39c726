"""Errors along the string: whether errors grow from one vehicle to the next."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

from scenarios.results.vehicles.vehicle_figures import VehicleSummary


@dataclass(frozen=True, slots=True, kw_only=True)
class StringError:
    """Errors of one vehicle and their ratios to those of the vehicle ahead; None if unknown.

    `number` counts from 1, the lead.
    """

    vehicle: str
    number: int
    error_m_max: float | None
    """Largest true error: cross_track_error_m_max of the summary."""
    error_m_rms: float | None
    """Root mean square of the same: cross_track_error_m_rms."""
    ratio_max: float | None = None
    """Largest error over that of the vehicle ahead; above 1 the error grows."""
    ratio_rms: float | None = None
    """The same of the root mean square."""


STRING_COLUMNS = tuple(field.name for field in fields(StringError))


def string_errors(vehicles: Sequence[VehicleSummary]) -> tuple[StringError, ...]:
    """Errors of the followers in the order of the convoy, with their ratios."""
    followers = [(number, row) for number, row in enumerate(vehicles, 1) if row.role != "lead"]
    errors = [
        StringError(
            vehicle=row.name,
            number=number,
            error_m_max=row.cross_track_error_m_max,
            error_m_rms=row.cross_track_error_m_rms,
        )
        for number, row in followers
    ]
    return (*errors[:1], *(_with_ratios(ahead, behind) for ahead, behind in pairwise(errors)))


def head_to_tail(errors: Sequence[StringError]) -> tuple[float | None, float | None]:
    """Ratio of the last follower's error to the first one's: largest and root mean square."""
    if len(errors) < 2:
        return None, None
    first, last = errors[0], errors[-1]
    return (
        _ratio(last.error_m_max, first.error_m_max),
        _ratio(last.error_m_rms, first.error_m_rms),
    )


def _with_ratios(ahead: StringError, behind: StringError) -> StringError:
    return StringError(
        vehicle=behind.vehicle,
        number=behind.number,
        error_m_max=behind.error_m_max,
        error_m_rms=behind.error_m_rms,
        ratio_max=_ratio(behind.error_m_max, ahead.error_m_max),
        ratio_rms=_ratio(behind.error_m_rms, ahead.error_m_rms),
    )


def _ratio(value: float | None, reference: float | None) -> float | None:
    return value / reference if value is not None and reference else None
