"""Figures of two runs, or of two groups of runs with the noise over their seeds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isclose, isfinite, sqrt
from statistics import fmean, variance
from typing import get_args

from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.results.events.encounters import EventKind
from scenarios.results.summary import RunSummary
from scenarios.studies.many.sweeps.figure import LINK_FIELDS, VEHICLE_FIELDS, SweepFigure

NOISE_CONFIDENCE = 0.99
"""Of the interval that must not contain zero: one of a hundred equal figures is outside."""
OF_PROCESSES = (
    "cpu_ratio", "late", "late_ticks", "lateness_ms", "memory_bytes", "transport_", "ticks_by_mode",
)  # fmt: skip
"""Beginnings of fields about processes, or whose counts other fields repeat."""
ROUNDING_RATIO = 1e-9
"""Relative difference of figures that only the order of sums causes."""
INTERVALS = ("_low", "_high")
"""Ends of figures that bound others."""
MAIN_FIGURES = (
    "cross_track_error_m_max",
    "cross_track_error_m_rms",
    "road_error_m_max",
    "road_error_m_rms",
    "self_estimate_error_m_max",
    "true_gap_m_min",
    "true_gap_m_max",
    "friction_ratio_max",
    "distance_m",
    "string.lateral_gain_l2_from_first",
    "string.spacing_gain_l2_from_first",
    "string.acceleration_gain_l2_from_lead",
    "reaction.mode_changes",
    "reaction.stops",
    "reaction.blind_m",
    "loss_ratio",
    "latency_ms_mean",
    "age_ms_mean",
)
"""Fields whose figures are printed; the others are in the JSON."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureDifference:
    """One figure of both sides: means over the runs that have it, None without any.

    `low` and `high` bound the difference B - A with a confidence of 99 %, from pairs of equal seeds
    where both sides have them (`paired`). They are None with one run a side.
    """

    name: str
    a: float | None
    b: float | None
    count_a: int
    count_b: int
    paired: bool = False
    low: float | None = None
    high: float | None = None

    @property
    def is_main(self) -> bool:
        scope, _, rest = self.name.partition(".")
        is_own = rest.startswith(f"{OWN_FIGURES}.")
        return scope == "events" or is_own or rest in MAIN_FIGURES

    @property
    def difference(self) -> float | None:
        return None if self.a is None or self.b is None else self.b - self.a

    @property
    def is_beyond_rounding(self) -> bool:
        if self.a is None or self.b is None:
            return self.a is not self.b
        return not isclose(self.a, self.b, rel_tol=ROUNDING_RATIO)

    @property
    def exceeds_noise(self) -> bool | None:
        """Whether the interval excludes zero; None where the noise is unknown."""
        if self.low is None or self.high is None:
            return None
        return self.low > 0.0 or self.high < 0.0


def figure_differences(
    a: Sequence[RunSummary], b: Sequence[RunSummary]
) -> tuple[FigureDifference, ...]:
    """Compare the figures of two groups of runs: all that differ, or that have noise."""
    names = dict.fromkeys(name for summary in (*a, *b) for name in _names(summary))
    values_a, values_b = _values(a, names), _values(b, names)
    compared = (_difference(name, values_a[name], values_b[name]) for name in names)
    return tuple(one for one in compared if one.is_beyond_rounding or one.low != one.high)


def _names(summary: RunSummary) -> Iterator[str]:
    yield "ran_s"
    yield from (f"events.{kind}" for kind in get_args(EventKind))
    for row in summary.vehicles:
        yield from (f"{row.name}.{path}" for path in VEHICLE_FIELDS if _is_compared(path))
        yield from (f"{row.name}.{OWN_FIGURES}.{name}" for name in row.own_figures)
    for link in summary.links:
        scope = f"{link.sender}:{link.receiver}"
        yield from (f"{scope}.{path}" for path in LINK_FIELDS if _is_compared(path))


def _is_compared(path: str) -> bool:
    return not (path.startswith(OF_PROCESSES) or path.endswith(INTERVALS))


Values = Mapping[str, dict[int, float]]
"""Values by figure and seed."""


def _values(runs: Sequence[RunSummary], names: Mapping[str, None]) -> Values:
    """Values of each figure by seed; those of runs with a repeated seed by a number below zero."""
    values: dict[str, dict[int, float]] = {name: {} for name in names}
    seen: set[int] = set()
    for number, summary in enumerate(runs, 1):
        seed = summary.identity.seed
        key = -number if seed in seen else seed
        seen.add(seed)
        for name in _names(summary):
            value = SweepFigure(name).of(summary)
            if value is not None and isfinite(value):
                values[name][key] = value
    return values


def _difference(name: str, a: Mapping[int, float], b: Mapping[int, float]) -> FigureDifference:
    paired = len(a) > 1 and a.keys() == b.keys()
    interval = _paired(a, b) if paired else _independent([*a.values()], [*b.values()])
    low, high = interval or (None, None)
    return FigureDifference(
        name=name,
        a=fmean(a.values()) if a else None,
        b=fmean(b.values()) if b else None,
        count_a=len(a),
        count_b=len(b),
        paired=paired,
        low=low,
        high=high,
    )


def _paired(a: Mapping[int, float], b: Mapping[int, float]) -> tuple[float, float]:
    """Student's interval of the mean difference of runs with equal seeds."""
    differences = [b[seed] - a[seed] for seed in a]
    middle, error = fmean(differences), sqrt(_variance_of_mean(differences))
    return _interval(middle, error, len(differences) - 1) if any(differences) else (0.0, 0.0)


def _independent(a: Sequence[float], b: Sequence[float]) -> tuple[float, float] | None:
    """Welch's interval of the difference of two means; None for less than two runs a side.

    Welch, Biometrika 34, 1947.
    """
    if len(a) < 2 or len(b) < 2:
        return None
    middle = fmean(b) - fmean(a)
    if len({*a, *b}) == 1:
        return middle, middle
    of_a, of_b = _variance_of_mean(a), _variance_of_mean(b)
    error = sqrt(of_a + of_b)
    if not error:
        return middle, middle
    freedom = (of_a + of_b) ** 2 / (of_a**2 / (len(a) - 1) + of_b**2 / (len(b) - 1))
    return _interval(middle, error, freedom)


def _variance_of_mean(values: Sequence[float]) -> float:
    """Squared standard error of a mean.

    Counts that are equal by chance have no spread. Theirs is at least that of one more run which
    differs by one.
    """
    count = len(values)
    least = 1.0 / (count + 1) ** 2 if all(map(float.is_integer, map(float, values))) else 0.0
    return max(variance(values) / count, least)


def _interval(middle: float, error: float, freedom: float) -> tuple[float, float]:
    from scipy.stats import t  # noqa: PLC0415 - optional

    half = float(t.ppf(0.5 + 0.5 * NOISE_CONFIDENCE, freedom)) * error
    return middle - half, middle + half
