"""Limits of a scenario file, which a run has to keep, or else has failed."""

from collections.abc import Mapping
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, create_model
from pydantic_core import PydanticCustomError

from scenarios.definition.schema.base_table import Name, NotNegative, Table
from scenarios.definition.schema.limit_rows import LIMITS, LimitRow

Count = Annotated[int, Field(ge=0)]
Span = Annotated[float, Field(gt=0, le=86_400)]


class DeadlineTable(Table):
    """Something that a follower has to have done `within_s` after the instant `after_s`."""

    vehicle: Name
    after_s: NotNegative = 0.0
    within_s: Span


class ModeLimit(DeadlineTable):
    """It steers in this mode by then; one that it has already at `after_s` counts."""

    mode: Literal["composite", "lead", "predecessor", "coast", "stop", "straight"]


class SourceLimit(DeadlineTable):
    """It makes this of a source by then: of the lead, or of the vehicle ahead of it."""

    source: Name
    status: Literal["fresh", "late", "lost", "distrusted", "probation"]


class RecoveryLimit(DeadlineTable):
    """From then on, to the end, it relies on all its sources and keeps within `error_m` (true)."""

    error_m: NotNegative


def _bound(row: LimitRow) -> Any:
    figure = NotNegative if row.most == inf else Annotated[float, Field(ge=0, le=row.most)]
    return (Count if row.event else figure) | None, None


if TYPE_CHECKING:

    class VehicleLimits(Table):
        """Bounds of one vehicle; its keys are those of `LIMITS`."""

        def __init__(self, **bounds: Any) -> None: ...
        def __getattr__(self, key: str) -> Any: ...

else:
    VehicleLimits = create_model(
        "VehicleLimits", __base__=Table, **{key: _bound(row) for key, row in LIMITS.items()}
    )


def _vehicle_table(given: object) -> object:
    """Refuse what is no table as an unknown key, rather than as a table of the wrong type."""
    if not isinstance(given, Mapping | VehicleLimits):
        raise PydanticCustomError("extra_forbidden", "unknown key")
    return given


OwnLimits = Annotated[VehicleLimits, BeforeValidator(_vehicle_table)]


class LimitsTable(VehicleLimits):
    """Limits whose breach makes a run fail; one that is left out is none.

    Its keys are those of `LIMITS`. A table with the name of a vehicle has the same keys: its bounds
    replace those of the convoy for that vehicle, its counts are of the events that involve it.
    `modes`, `sources` and `recovery` are what followers have to have done by an instant.

    `after_collision` tells whether the run ends when a collision breaks the limit of the convoy, or
    with "end" and without that limit, at the first one. Left out, it ends if there is a limit.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, OwnLimits] = Field(init=False)

    modes: Annotated[tuple[ModeLimit, ...], Field(strict=False)] = ()
    sources: Annotated[tuple[SourceLimit, ...], Field(strict=False)] = ()
    recovery: Annotated[tuple[RecoveryLimit, ...], Field(strict=False)] = ()
    after_collision: Literal["end", "continue"] | None = None

    if TYPE_CHECKING:

        def __init__(self, **limits: Any) -> None: ...

    @property
    def of_vehicles(self) -> Mapping[str, VehicleLimits]:
        """Limits of single vehicles by name."""
        return self.__pydantic_extra__
