"""Tables of the limits of a run."""

from collections.abc import Mapping
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, create_model
from pydantic_core import PydanticCustomError

from scenarios.definition.schema.limit_rows import LIMITS, OWN_FIGURES, LimitRow
from scenarios.definition.schema.settings_table import Name, NotNegative, Table

Count = Annotated[int, Field(ge=0)]
Span = Annotated[float, Field(gt=0, le=86_400)]


class DeadlineTable(Table):
    """A deadline of a follower: `within_s` after `after_s`."""

    vehicle: Name
    after_s: NotNegative = 0.0
    within_s: Span


class ModeLimit(DeadlineTable):
    """Deadline for a mode of a follower, met at once if it is in this mode at `after_s`.

    vehicle   the follower
    mode      mode of the follower; see the modes of a vehicle below
    after_s   time after the start of the run
    within_s  deadline after `after_s`
    """

    mode: Literal["composite", "lead", "predecessor", "intermediate", "coast", "stop", "straight"]


class SourceLimit(DeadlineTable):
    """Deadline for the status of a source, such as the lead or the predecessor.

    vehicle   the follower
    source    the vehicle that it receives from
    status    status of the source
    after_s   time after the start of the run
    within_s  deadline after `after_s`
    """

    source: Name
    status: Literal["fresh", "late", "lost", "distrusted", "probation"]


class RecoveryLimit(DeadlineTable):
    """Deadline for recovery: from then on all sources are fresh and the error is bounded.

    vehicle   the follower
    error_m   largest true distance from the lead's path
    after_s   time after the start of the run
    within_s  deadline after `after_s`
    """

    error_m: NotNegative


def _bound(row: LimitRow) -> Any:
    figure = NotNegative if row.most == inf else Annotated[float, Field(ge=0, le=row.most)]
    return (Count if row.event else figure) | None, None


if TYPE_CHECKING:

    class VehicleLimits(Table):
        """Bounds of one vehicle; its keys are those of `LIMITS`, and `own_figures`."""

        own_figures: Mapping[str, float] | None = None

        def __init__(self, **bounds: Any) -> None: ...
        def __getattr__(self, key: str) -> Any: ...

else:
    VehicleLimits = create_model(
        "VehicleLimits",
        __base__=Table,
        **{key: _bound(row) for key, row in LIMITS.items()},
        **{OWN_FIGURES: (dict[str, float] | None, None)},
    )


def _vehicle_table(given: object) -> object:
    """Report a value that is not a table as an unknown key."""
    if not isinstance(given, Mapping | VehicleLimits):
        raise PydanticCustomError("extra_forbidden", "unknown key")
    return given


OwnLimits = Annotated[VehicleLimits, BeforeValidator(_vehicle_table)]


DEADLINES = ("modes", "sources", "recovery")
"""Keys of the deadlines of followers."""


class LimitsTable(VehicleLimits):
    """Limits of a run, which fails if it breaks one.

    A table with the name of a vehicle, such as [limits.v3], has the same bounds: they replace those
    of the convoy for that vehicle, and count the events that involve it.

    own_figures      bounds on figures of your own by their names (convoy reference plug-ins):
                     SteeringEffort_max = 0.02
    modes            deadlines for modes of followers
    sources          deadlines for the status of sources
    recovery         deadlines for recovery after a failure
    holes_s_max      largest total time (s) for which messages that a limit judges may be missing,
                     by default 0; beyond it the limit is not judged and the run has failed
    late_s_max       likewise the largest delay (s) of a vehicle in real time, by default 1 s
    after_collision  "end" the run with the collision that breaks the limit, or with the first
                     without a limit; or "continue". Default: "end" if collisions_max is given
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, OwnLimits] = Field(init=False)

    modes: Annotated[tuple[ModeLimit, ...], Field(strict=False)] = ()
    sources: Annotated[tuple[SourceLimit, ...], Field(strict=False)] = ()
    recovery: Annotated[tuple[RecoveryLimit, ...], Field(strict=False)] = ()
    holes_s_max: NotNegative | None = None
    late_s_max: NotNegative | None = None
    after_collision: Literal["end", "continue"] | None = None

    if TYPE_CHECKING:

        def __init__(self, **limits: Any) -> None: ...

    @property
    def of_vehicles(self) -> Mapping[str, VehicleLimits]:
        """Bounds of single vehicles by name."""
        return self.__pydantic_extra__
