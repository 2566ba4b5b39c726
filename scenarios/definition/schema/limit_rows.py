"""The limits of a run as a table.

The keys of `[limits]`, the words of `--limit`, the summary, live checks, the template and the help
follow it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import Literal

# fmt: off
Live = Literal["", "gap", "error", "road_error", "self_estimate", "blind", "friction", "end"]
# fmt: on
"""Figure of a running simulation that a limit bounds; "end" for a figure that is known at the end
only."""
OWN_FIGURES = "own_figures"
"""Table of bounds on figures of the user's classes, and the field of their summary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitRow:
    """One limit; its key ends in `_max` or `_min`.

    It bounds the number of events of the kind `event`, or `figure`, a field of the summary of each
    follower, or `own_figure`, that of a class of the user. `of_lead` limits apply to the lead as
    well. `word` is the name for `--limit`. A breach is reported as `breach`, where `at` is the
    field with its instant. `least` and `most` are the bounds that make sense. `live` is the figure
    that is judged while a run goes on. `doc` and `example` are for the template.
    """

    key: str
    doc: str
    example: float
    word: str
    event: str = ""
    figure: str = ""
    own_figure: str = ""
    of_lead: bool = False
    breach: str = ""
    at: str = ""
    least: float = 0.0
    most: float = inf
    live: Live = ""

    @property
    def is_least(self) -> bool:
        """Whether smaller figures break the limit."""
        return self.key.endswith("_min")


# fmt: off
_ROWS = (
    LimitRow(key="collisions_max", doc="collisions of two vehicles",
             example=0, word="collision", event="collision", of_lead=True),
    LimitRow(key="lane_departures_max", doc="times that a follower leaves the lane",
             example=0, word="lane", event="lane_departure"),
    LimitRow(key="near_misses_max", doc="times that two vehicles nearly collide",
             example=0, word="near_miss", event="near_miss", of_lead=True),
    LimitRow(key="paths_lost_max",
             doc="times that a follower has no usable path for events.path_lost_s",
             example=0, word="path_lost", event="path_lost"),
    LimitRow(key="stops_max", doc="times that a follower begins to stop without a reliable source",
             example=0, word="stop", event="stop"),
    LimitRow(key="distrusts_max", doc="times that a follower rejects a source as implausible",
             example=0, word="distrust", event="distrust"),
    LimitRow(key="falls_behind_max",
             doc="times that a gap is wider than law and age of data explain",
             example=0, word="falls_behind", event="falls_behind"),
    LimitRow(key="stranded_max", doc="times that a follower stands although the lead drives",
             example=0, word="stranded", event="stranded"),
    LimitRow(key="overspeeds_max", doc="times that a follower is faster than the lead was",
             example=0, word="overspeed", event="overspeed"),
    LimitRow(key="hard_brakings_max",
             doc="times that a follower brakes hard although no vehicle ahead does",
             example=0, word="hard_braking", event="hard_braking"),
    LimitRow(key="overridden_ratio_max",
             doc="largest share of the time in which the guard overrides the longitudinal law",
             example=0.2, word="overridden_ratio", live="end",
             figure="overridden_ratio", most=1,
             breach="was overridden for {figure:.2f} of the time"),
    LimitRow(key="cross_track_error_m_max",
             doc="largest true distance of a follower from the path the lead drove",
             example=0.5, word="error_m", live="error",
             figure="cross_track_error_m_max", at="cross_track_error_max_at_s",
             breach="was {figure:.2f} m off the lead's path, {at:.2f} s after the start"),
    LimitRow(key="road_error_m_max",
             doc="largest true distance of a vehicle from the road",
             example=0.5, word="road_error_m", live="road_error",
             figure="road_error_m_max", at="road_error_max_at_s", of_lead=True,
             breach="was {figure:.2f} m off the road, {at:.2f} s after the start"),
    LimitRow(key="true_gap_m_min",
             doc="smallest true gap to the predecessor",
             example=1.0, word="gap_m", live="gap",
             figure="true_gap_m_min", at="true_gap_min_at_s",
             breach="was {figure:.2f} m from the vehicle ahead, {at:.2f} s after the start"),
    LimitRow(key="self_estimate_error_m_max",
             doc="largest error of a follower's self-estimate of its error",
             example=0.3, word="self_estimate_error_m", live="self_estimate",
             figure="self_estimate_error_m_max",
             breach="was {figure:.2f} m wrong about its error"),
    LimitRow(key="blind_m_max", doc="distance that a follower drives beyond its known path",
             example=5.0, word="blind_m", live="blind", figure="reaction.blind_m",
             breach="drove {figure:.2f} m beyond its known path"),
    LimitRow(key="friction_ratio_max", doc="largest share of the friction that a vehicle uses",
             example=0.8, word="friction_ratio", live="friction",
             figure="friction_ratio_max", of_lead=True, most=1,
             breach="used {figure:.2f} of the friction"),
    *(LimitRow(key=f"{name}_max", doc=f"largest {norm} gain of the {signal} error {reach}",
               example=1.0, figure=f"string.{name}", live="end",
               word=name,
               breach=f"has an {norm} gain of {{figure:.2f}} of the {signal} error {reach}")
      for signal in ("lateral", "spacing")
      for reach, end in (("from the vehicle ahead", ""),
                         ("from the first follower", "_from_first"))
      for norm in ("L2", "L∞")
      for name in [f"{signal}_gain_{norm.lower().replace('∞', 'inf')}{end}"]),
)
# fmt: on
LIMITS: Mapping[str, LimitRow] = {row.key: row for row in _ROWS}
WORDS: Mapping[str, LimitRow] = {row.word: row for row in _ROWS}


@cache
def own_row(name: str) -> LimitRow:
    """Return the limit of a bound in [limits.own_figures], such as "SteeringEffort_max"."""
    figure = name.rpartition("_")[0]
    return LimitRow(
        key=f"{OWN_FIGURES}.{name}",
        doc="figure of a class of yours",
        example=1.0,
        word=name,
        own_figure=figure,
        of_lead=True,
        breach=f"had {figure} {{figure:.4g}}",
        least=-inf,
    )


def row_of(key: str) -> LimitRow | None:
    """Return the limit of a key of [limits], which may be "own_figures.NAME"; None without one."""
    table, dot, name = key.partition(".")
    return own_row(name) if dot and table == OWN_FIGURES else LIMITS.get(key)


def words_with_examples() -> str:
    """List the words of `--limit`, figures with an example of their bound."""
    return ", ".join(
        word if row.event else f"{word}={row.example:g}" for word, row in WORDS.items()
    )
