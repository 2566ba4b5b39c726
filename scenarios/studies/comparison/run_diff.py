"""`convoy diff`: what differs between two runs, or between two groups of runs."""

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isclose, isfinite, sqrt
from pathlib import Path
from statistics import fmean, variance
from typing import Any, get_args

from scenarios.definition.errors import require
from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.results.events import EventKind
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import METADATA_NAME, log_in, summary_of
from scenarios.results.summary import RunIdentity, RunSummary
from scenarios.studies.many.plan import LINK_FIELDS, VEHICLE_FIELDS, SweepFigure
from transport.log.errors import LogError
from transport.log.reader import LogReader

# ---- Figures of two runs, or of two groups of runs with the noise over their seeds


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


def _compared(a: Sequence[RunSummary], b: Sequence[RunSummary]) -> int:
    """Count the figures of two runs; 0 if the summary of one is unknown."""
    return len({name for summary in (*a, *b) for name in _names(summary)}) if a and b else 0


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


# ---- Settings of two runs that differ: the scenario with its defaults, seed, clock and program


NOT_SETTINGS = {"overrides", "description"}
"""Keys of a recorded scenario that repeat or describe other keys."""
LISTED_NUMBERS = 6
"""Longest list of numbers that is shown whole."""


@dataclass(frozen=True, slots=True)
class SettingDifference:
    """A key with its values in two runs, as text; empty where the key is not set."""

    key: str
    a: str
    b: str


def setting_differences(a: LogReader, b: LogReader) -> tuple[SettingDifference, ...]:
    """List the settings that differ between two logs, those of the scenario first.

    A damaged log may lack its scenario; then only what both logs hold is compared.
    """
    groups = []
    for read in (_scenario_settings, _program):
        of_a, of_b = read(a), read(b)
        groups.append((of_a, of_b) if of_a and of_b else ({}, {}))
    return tuple(difference for of_a, of_b in groups for difference in differences_of(of_a, of_b))


def differences_of(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[SettingDifference]:
    """Yield the differing values of two tables with dotted keys."""
    for key in dict.fromkeys((*a, *b)):
        if (key in a) != (key in b) or a.get(key) != b.get(key):
            yield SettingDifference(key, *_texts(a.get(key), b.get(key)))


def _scenario_settings(reader: LogReader) -> dict[str, Any]:
    attached = reader.attachments().get(ATTACHED_AS)
    if attached is None:
        return {}
    try:
        tables = tomllib.loads(attached.decode())
    except ValueError as error:  # not UTF-8, or not TOML
        raise LogError(f"{reader.path} ({ATTACHED_AS}): {error}") from error
    return {key: value for key, value in flattened(tables) if key.split(".")[0] not in NOT_SETTINGS}


def _program(reader: LogReader) -> dict[str, Any]:
    values = reader.metadata().get(METADATA_NAME)
    if not values:
        return {}
    identity = RunIdentity.of_values(values)
    programs = {f"version of {name}": version for name, version in identity.versions.items()}
    programs["digest of the sources"] = identity.sources
    for name, digest in identity.plug_ins.items():
        programs[f"digest of {name}"] = digest
    return {"clock": identity.clock, **programs}


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values; tables in lists are numbered from 1."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from flattened(value, f"{key}.")
        elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            for number, one in enumerate(value, 1):
                yield from flattened(one, f"{key}[{number}].")
        else:
            yield key, value


def _texts(a: Any, b: Any) -> tuple[str, str]:
    if isinstance(a, list) and isinstance(b, list) and max(len(a), len(b)) > LISTED_NUMBERS:
        pairs = enumerate(zip(a, b, strict=False))
        place = next((n for n, (one, other) in pairs if one != other), min(len(a), len(b)))
        return _item(a, place), _item(b, place)
    return _text(a), _text(b)


def _item(values: list[Any], place: int) -> str:
    value = _text(values[place]) if place < len(values) else "none"
    return f"{value} as number {place + 1} of {len(values)}"


def _text(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)


# ---- Run diff


SCHEMA = "convoy.diff/1"
SEED = "seed"
"""Setting in which the runs of one side differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunDiff:
    """Differences of A and B. `compared` counts the figures of two runs; None with several."""

    a: tuple[Path, ...]
    b: tuple[Path, ...]
    settings: tuple[SettingDifference, ...]
    compared: int | None
    figures: tuple[FigureDifference, ...]
    faults: tuple[str, ...]
    """Damage, interruption, holes and missing parts of the logs, a line each."""

    @property
    def is_equal(self) -> bool:
        """Whether the runs are equal; of several, whether no difference exceeds the noise."""
        if self.compared is not None:
            differs = self.settings or self.figures or self.faults
            return bool(self.compared) and not differs
        return not any(figure.exceeds_noise for figure in self.figures)

    @property
    def sentence(self) -> str:
        if self.compared is None:
            return self._noise_sentence
        if self.is_equal:
            return f"identical: all settings and all {self.compared} figures are equal"
        if self.compared and not self.figures:
            return f"different settings, equal figures ({self.compared})"
        return "different" if self.settings else "different, with equal settings"

    @property
    def _noise_sentence(self) -> str:
        exceeding = sum(bool(figure.exceeds_noise) for figure in self.figures)
        judged = sum(figure.exceeds_noise is not None for figure in self.figures)
        if not exceeding:
            return f"no difference beyond the noise over seeds in {judged} figures"
        return (
            f"different: {exceeding} of {judged} figures differ beyond the noise over seeds "
            f"({0.01 * judged:.1f} expected by chance)"
        )


def logs_of(path: Path) -> tuple[Path, ...]:
    """Logs of a run, a folder of runs, or a pattern such as `runs/first-*`; raises LogError."""
    if any(mark in path.name for mark in "*?[") and not path.exists():
        matches = sorted(path.parent.glob(path.name))
        logs = tuple(log for match in matches for log in logs_of(match))
        if not logs:
            raise LogError(f"{path}: matches no run")
        return logs
    if path.is_dir() and not (path / LOG_NAME).exists():
        runs = tuple(sorted(path.glob(f"*/{LOG_NAME}")))
        if not runs:
            raise LogError(f"{path}: holds no run: neither {LOG_NAME} nor */{LOG_NAME}")
        return runs
    return (log_in(path),)


def diff_runs(
    a: Path, b: Path, report: Callable[[int, int], None] = lambda _done, _total: None
) -> RunDiff:
    """Compare two runs, or the runs in two folders; raises LogError or MissingExtraError.

    `report` is called with the number of runs that have been read and their total number.
    """
    of_a, of_b = logs_of(a), logs_of(b)
    total = len(of_a) + len(of_b)
    is_single = total == 2
    if not is_single:
        require("diff of several runs", "studies", "scipy")
    for path, logs in ((a, of_a), (b, of_b)):
        if not is_single and len(logs) == 1:
            raise LogError(f"{path}: holds 1 run; the noise over seeds needs two or more a side")
    faults: list[str] = []
    summaries: tuple[list[RunSummary], list[RunSummary]] = ([], [])
    for done, log in enumerate((*of_a, *of_b), 1):
        summaries[done > len(of_a)].extend(_summary(log, faults, is_needed=not is_single))
        report(done, total)
    first_a, first_b = LogReader(of_a[0]), LogReader(of_b[0])
    settings = setting_differences(first_a, first_b)
    if not is_single:
        settings = tuple(one for one in settings if one.key != SEED)
    return RunDiff(
        a=of_a,
        b=of_b,
        settings=settings,
        compared=_compared(*summaries) if is_single else None,
        figures=figure_differences(*summaries) if all(summaries) else (),
        faults=tuple(faults),
    )


def _summary(log: Path, faults: list[str], *, is_needed: bool) -> list[RunSummary]:
    """Summary of a log; none of a log that lost its scenario, unless it is needed."""
    try:
        return [summary_of(log, faults.append)]
    except LogError as error:
        if is_needed:
            raise
        faults.append(str(error))
        return []


def to_json(diff: RunDiff) -> str:
    content = {
        "schema": SCHEMA,
        "a": [str(log) for log in diff.a],
        "b": [str(log) for log in diff.b],
        "equal": diff.is_equal,
        "sentence": diff.sentence,
        "log_faults": list(diff.faults),
        "settings": [asdict(setting) for setting in diff.settings],
        "figures": [
            asdict(figure)
            | {"difference": figure.difference, "exceeds_noise": figure.exceeds_noise}
            for figure in diff.figures
        ],
    }
    return json.dumps(content, indent=2, default=list) + "\n"
