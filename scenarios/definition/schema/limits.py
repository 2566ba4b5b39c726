"""What a scenario file may say that a run has to hold, or else has failed."""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.table import Name, NotNegative, Ratio, Table

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


class LimitsTable(Table):
    """Limits whose breach makes a run fail; one that is left out is none.

    collisions_max, lane_departures_max, near_misses_max, paths_lost_max, stops_max, distrusts_max
                             counts of events
    cross_track_error_m_max  largest true distance of a follower from the path the lead drove
    true_gap_m_min           smallest true distance between the bodies of two neighbours
    believed_minus_true_error_m_max
                             by how much a follower is wrong about its own error
    blind_m_max              how far a follower drives beyond the road that it knows
    friction_ratio_max       largest share of the friction that a vehicle uses
    modes, sources, recovery
                             what followers have to have done by an instant

    `after_collision` says whether the run ends when a collision breaks the limit, or with "end" and
    without that limit, at the first one. Left out, it ends if there is a limit.
    """

    collisions_max: Count | None = None
    lane_departures_max: Count | None = None
    near_misses_max: Count | None = None
    paths_lost_max: Count | None = None
    stops_max: Count | None = None
    distrusts_max: Count | None = None
    cross_track_error_m_max: NotNegative | None = None
    true_gap_m_min: NotNegative | None = None
    believed_minus_true_error_m_max: NotNegative | None = None
    blind_m_max: NotNegative | None = None
    friction_ratio_max: Ratio | None = None
    modes: Annotated[tuple[ModeLimit, ...], Field(strict=False)] = ()
    sources: Annotated[tuple[SourceLimit, ...], Field(strict=False)] = ()
    recovery: Annotated[tuple[RecoveryLimit, ...], Field(strict=False)] = ()
    after_collision: Literal["end", "go_on"] | None = None
