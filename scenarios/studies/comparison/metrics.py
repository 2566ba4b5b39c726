"""The metrics of runs that differ, with the noise over the seeds of several runs a group."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from itertools import chain
from math import isclose, isfinite, sqrt
from statistics import fmean, variance
from typing import Any

from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.results.summary import RunSummary

CONFIDENCE = 0.99
"""Of the interval that must not contain zero: one of a hundred equal metrics is outside."""
COUNTS = re.compile(r"(.*\.)?(events|dropped|not_arrived|false)\.\w+")
"""Counts by kind: those that a summary lacks are 0."""
NOT_COMPARED = re.compile(
    r"(.*\.)?(cpu_ratio|late|late_ticks|lateness_ms|memory_bytes|transport_|ticks_by_mode|in_flight"
    r"|\w+_low$|\w+_high$).*"
)
"""Metrics of processes and their clocks, ends of intervals, and counts that others repeat."""
MAIN = re.compile(
    r"ran_s|events\..*|.*\.(cross_track_error_m_(max|rms)|road_error_m_(max|rms)|true_gap_m_(min|max)"
    r"|self_estimate_error_m_max|friction_ratio_max|distance_m|loss_ratio|latency_ms_mean|age_ms_mean"
    rf"|reaction\.(mode_changes|stops|blind_m)|string\.\w+_gain_l2_from_(first|lead)|{OWN_FIGURES}\..*)"
)
"""Printed metrics; the others are in the JSON."""
Values = Mapping[int, float]
"""Values of a metric by seed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MetricDifference:
    """A metric of the runs of A and of the group `label`: means, None where no run has it.

    `low` and `high` bound the difference from A with a confidence of 99 %, from pairs of equal
    seeds where both groups have them (`paired`); they are None with one run a group. `differs`
    states whether the difference exceeds the tolerance and, with an interval, the noise.
    """

    label: str
    name: str
    a: float | None
    b: float | None
    paired: bool
    low: float | None
    high: float | None
    differs: bool

    @property
    def is_main(self) -> bool:
        return MAIN.fullmatch(self.name) is not None

    @property
    def difference(self) -> float | None:
        return None if self.a is None or self.b is None else self.b - self.a


def metrics_of(summary: RunSummary) -> dict[str, float]:
    """Compared numbers of a summary, such as `v2.distance_m` and `v1:v2.dropped.loss`."""
    whole = {
        "ran_s": summary.ran_s,
        "events": Counter(event.kind for event in summary.events),
        **{row.name: row for row in summary.vehicles},
        **{f"{row.sender}:{row.receiver}": row for row in summary.links},
    }
    return {name: value for name, value in numbers(whole) if not NOT_COMPARED.fullmatch(name)}


def numbers(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the finite numbers in dataclasses and mappings by their dotted names."""
    if isinstance(value, int | float):
        if isfinite(value):
            yield name, float(value)
        return
    entries: Mapping[str, Any] = {}
    if isinstance(value, Mapping):
        entries = value
    elif is_dataclass(value):
        entries = {field.name: getattr(value, field.name) for field in fields(value)}
    for key, entry in entries.items():
        yield from numbers(entry, f"{name}.{key}" if name else key)


def metric_differences(
    label: str, a: Sequence[RunSummary], b: Sequence[RunSummary], tolerance: float
) -> tuple[int, list[MetricDifference]]:
    """Count the metrics of the groups A and `label`, and list those that are not equal.

    `tolerance` is relative to the larger value.
    """
    of_a, of_b = _by_seed(a), _by_seed(b)
    names = dict.fromkeys(chain.from_iterable((*of_a.values(), *of_b.values())))
    compared = [
        _difference(label, name, _values(of_a, name), _values(of_b, name), tolerance)
        for name in names
    ]
    return len(compared), [row for row in compared if row.differs or (row.low != row.high)]


def _by_seed(runs: Sequence[RunSummary]) -> dict[int, dict[str, float]]:
    """Metrics of each run by its seed, or by a number below zero if a run before has this seed."""
    metrics: dict[int, dict[str, float]] = {}
    for number, summary in enumerate(runs, 1):
        seed = summary.identity.seed
        metrics[-number if seed in metrics else seed] = metrics_of(summary)
    return metrics


def _values(runs: Mapping[int, Mapping[str, float]], name: str) -> Values:
    missing = 0.0 if COUNTS.fullmatch(name) else None
    values = {seed: metrics.get(name, missing) for seed, metrics in runs.items()}
    return {seed: value for seed, value in values.items() if value is not None}


def _difference(label: str, name: str, a: Values, b: Values, tolerance: float) -> MetricDifference:
    mean_a, mean_b = (fmean(values.values()) if values else None for values in (a, b))
    paired = len(a) > 1 and a.keys() == b.keys()
    interval = _paired(a, b) if paired else _independent([*a.values()], [*b.values()])
    low, high = interval or (None, None)
    if mean_a is None or mean_b is None:
        differs = True
    else:
        is_noise = interval is not None and interval[0] <= 0.0 <= interval[1]
        differs = not is_noise and not isclose(mean_a, mean_b, rel_tol=tolerance)
    return MetricDifference(
        label=label,
        name=name,
        a=mean_a,
        b=mean_b,
        paired=paired,
        low=low,
        high=high,
        differs=differs,
    )


def _paired(a: Values, b: Values) -> tuple[float, float]:
    """Student's interval of the mean difference of runs with equal seeds."""
    differences = [b[seed] - a[seed] for seed in a]
    if not any(differences):
        return 0.0, 0.0
    error = sqrt(_variance_of_mean(differences))
    return _interval(fmean(differences), error, len(differences) - 1)


def _independent(a: Sequence[float], b: Sequence[float]) -> tuple[float, float] | None:
    """Welch's interval of the difference of two means; None for less than two runs a group.

    Welch, Biometrika 34, 1947.
    """
    if len(a) < 2 or len(b) < 2:
        return None
    middle = fmean(b) - fmean(a)
    of_a, of_b = _variance_of_mean(a), _variance_of_mean(b)
    error = sqrt(of_a + of_b)
    if not error or len({*a, *b}) == 1:
        return middle, middle
    freedom = (of_a + of_b) ** 2 / (of_a**2 / (len(a) - 1) + of_b**2 / (len(b) - 1))
    return _interval(middle, error, freedom)


def _variance_of_mean(values: Sequence[float]) -> float:
    """Squared standard error of a mean.

    Counts that are equal by chance have no spread. Theirs is at least that of one more run which
    differs by one.
    """
    count = len(values)
    least = 1.0 / (count + 1) ** 2 if all(map(float.is_integer, values)) else 0.0
    return max(variance(values) / count, least)


def _interval(middle: float, error: float, freedom: float) -> tuple[float, float]:
    from scipy.stats import t  # noqa: PLC0415 - an extra

    half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, freedom)) * error
    return middle - half, middle + half
