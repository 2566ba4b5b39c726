"""`convoy compare`: what differs between two or more groups of runs."""

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from scenarios.definition.errors import ScenarioError, require
from scenarios.results.files import LOG_NAME, json_text, plain
from scenarios.results.log_summary import log_in, summary_of
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from scenarios.studies.comparison.metrics import MetricDifference, metric_differences
from scenarios.studies.comparison.road import (
    OffsetDifference,
    PlacedVehicle,
    first_parting,
    offset_difference,
    placed_vehicles,
)
from transport.log.errors import LogError

SCHEMA = "convoy.compare/2"
TOLERANCE = 1e-9
"""Relative difference of metrics that only the order of sums causes."""
APART_M = 0.1
"""Difference of positions from which vehicles part, above the noise of usual receivers."""
MOST_GROUPS = 8
NOT_SETTINGS = ("overrides", "description")
"""Keys of a recorded scenario that repeat or describe other keys."""
LISTED_NUMBERS = 6
"""Longest list of numbers that is shown whole."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedRun:
    """A run with its summary and settings, as far as its log holds them.

    `settings` are those of the scenario, the clock, and the versions of the program, by key.
    """

    record: RunRecord
    summary: RunSummary | None
    settings: Mapping[str, Any]

    @property
    def seed(self) -> int | None:
        return self.summary.identity.seed if self.summary else None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunGroup:
    """Runs of one setting with its label (A, B, …): one, or one per seed.

    The `vehicles` of its first run are placed on the path of A.
    """

    label: str
    runs: Sequence[ComparedRun]
    vehicles: Mapping[str, PlacedVehicle]

    @property
    def record(self) -> RunRecord:
        return self.runs[0].record

    @property
    def summaries(self) -> list[RunSummary]:
        return [run.summary for run in self.runs if run.summary]

    @property
    def title(self) -> str:
        name = self.summaries[0].identity.title if self.summaries else ""
        more = f" and {len(self.runs) - 1} more runs" if len(self.runs) > 1 else ""
        return f"{self.label}: {name or self.record.log}{more}"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunComparison:
    """Differences of groups of runs from the first one, A.

    `settings` have a text per group, empty where a key is not set. `compared` counts the metrics.
    `positions` are those of the first run of each group, of all vehicles. `faults` describe damage,
    holes and missing parts of the logs.
    """

    groups: tuple[RunGroup, ...]
    settings: Mapping[str, tuple[str, ...]]
    compared: int
    metrics: tuple[MetricDifference, ...]
    positions: tuple[OffsetDifference, ...]
    faults: tuple[str, ...]

    @property
    def is_equal(self) -> bool:
        """Whether the logs are whole, and neither metrics nor positions differ."""
        differs = any(row.differs for row in self.metrics) or self.first or self.faults
        return bool(self.compared) and not differs

    @property
    def first(self) -> OffsetDifference | None:
        """The vehicle that parts first; with noise over seeds, positions are not judged."""
        is_single = all(len(group.runs) == 1 for group in self.groups)
        return first_parting(self.positions) if is_single else None

    @property
    def sentence(self) -> str:
        differing = sum(row.differs for row in self.metrics)
        if self.is_equal:
            return f"equal: no difference in {self.compared} metrics and in the vehicles' positions"
        chance = ""
        if any(row.low is not None for row in self.metrics):
            chance = f" beyond the noise over seeds ({0.01 * self.compared:.1f} expected by chance)"
        metrics = f"{differing} of {self.compared} metrics differ{chance}"
        place = f"; {self.first.sentence}" if self.first else ""
        return f"different: {metrics}{place}"


def compare_runs(
    paths: Sequence[Path],
    tolerance: float = TOLERANCE,
    apart_m: float = APART_M,
    report: Callable[[int, int], None] = lambda _done, _total: None,
) -> RunComparison:
    """Compare runs, their logs, or folders of runs; raises LogError, ScenarioError or an extra's.

    `report` is called with the number of runs that have been read and their total number.
    """
    faults: list[str] = []
    sides = [logs_of(path) for path in paths]
    total, read = sum(map(len, sides)), []
    for side in sides:
        read.append([_recorded(log, faults) for log in side])
        report(sum(map(len, read)), total)
    grouped = _grouped(read)
    reference = grouped[0][0].record
    first, *others = groups = tuple(
        RunGroup(label=label, runs=runs, vehicles=placed_vehicles(runs[0].record, reference))
        for label, runs in zip(ascii_uppercase, grouped, strict=False)
    )
    compared = 0
    metrics: list[MetricDifference] = []
    for group in others if all(group.summaries for group in groups) else ():
        summaries = first.summaries, group.summaries
        count, differing = metric_differences(group.label, *summaries, tolerance)
        compared, metrics = compared + count, metrics + differing
    return RunComparison(
        groups=groups,
        settings=setting_differences(groups),
        compared=compared,
        metrics=tuple(metrics),
        positions=tuple(
            offset_difference(group.label, vehicle, group.vehicles[name], apart_m)
            for group in others
            for name, vehicle in first.vehicles.items()
            if name in group.vehicles
        ),
        faults=tuple(dict.fromkeys(faults)),
    )


def logs_of(path: Path) -> tuple[Path, ...]:
    """Logs of a run, a folder of runs, or a pattern such as `runs/first-*`; raises LogError."""
    if any(mark in path.name for mark in "*?[") and not path.exists():
        logs = tuple(log for match in sorted(path.parent.glob(path.name)) for log in logs_of(match))
        if not logs:
            raise LogError(f"{path}: matches no run")
        return logs
    if path.is_dir() and not (path / LOG_NAME).exists():
        runs = tuple(sorted(path.glob(f"*/{LOG_NAME}")))
        if not runs:
            raise LogError(f"{path}: holds no run: neither {LOG_NAME} nor */{LOG_NAME}")
        return runs
    return (log_in(path),)


def _recorded(log: Path, faults: list[str]) -> ComparedRun:
    """Read a run; a damaged log may lack its summary."""
    record, summary = RunRecord(log), None
    tables = tomllib.loads(record.scenario.text)
    settings: dict[str, Any] = dict(
        flattened({key: value for key, value in tables.items() if key not in NOT_SETTINGS})
    )
    try:
        summary = summary_of(log, faults.append)
    except LogError as error:
        faults.append(str(error))
    else:
        about = summary.identity
        settings |= {"clock": about.clock, "digest of the sources": about.sources}
        settings |= {f"version of {name}": version for name, version in about.versions.items()}
        settings |= {f"digest of {name}": digest for name, digest in about.plug_ins.items()}
    return ComparedRun(record=record, summary=summary, settings=settings)


def _grouped(sides: Sequence[Sequence[ComparedRun]]) -> list[list[ComparedRun]]:
    """Group the runs of one folder, and single runs whose settings differ in the seed only.

    Runs are groups of their own if that would leave one group, and if a seed would repeat.
    """
    groups: dict[object, list[ComparedRun]] = {}
    for number, side in enumerate(sides):
        key: object = number
        if len(side) == 1:
            key = str({name: value for name, value in side[0].settings.items() if name != "seed"})
            if side[0].seed in {run.seed for run in groups.get(key, ())}:
                key = number
        groups.setdefault(key, []).extend(side)
    if len(groups) == 1:
        groups = {number: list(side) for number, side in enumerate(sides)}
    if not 2 <= len(groups) <= MOST_GROUPS:
        raise ScenarioError([f"compare: given {len(groups)} runs, allowed 2 to {MOST_GROUPS}"])
    sizes = [len(group) for group in groups.values()]
    if max(sizes) > 1:
        require("compare of several runs a group", "studies", "scipy")
        lonely = [group[0].record.log for group in groups.values() if len(group) == 1]
        if lonely:
            raise LogError(f"{lonely[0]}: is 1 run; the noise over seeds needs two or more")
    return list(groups.values())


def setting_differences(groups: Sequence[RunGroup]) -> dict[str, tuple[str, ...]]:
    """Differing settings of the first runs; of groups of several runs without the seed.

    What a damaged log has lost is not compared.
    """
    runs = [group.runs[0] for group in groups]
    is_whole = all(run.summary for run in runs)
    found = {}
    for key in dict.fromkeys(key for run in runs for key in run.settings):
        texts = tuple(_text(run.settings.get(key)) for run in runs)
        if len(set(texts)) > 1 and (is_whole or all(key in run.settings for run in runs)):
            found[key] = texts
    if any(len(group.runs) > 1 for group in groups):
        found.pop("seed", None)
    return found


def flattened(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values; tables in lists and long lists are numbered from 1."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from flattened(entry, f"{name}.{key}" if name else key)
    elif isinstance(value, list) and (
        len(value) > LISTED_NUMBERS or any(isinstance(entry, Mapping) for entry in value)
    ):
        for number, entry in enumerate(value, 1):
            yield from flattened(entry, f"{name}[{number}]")
    else:
        yield name, value


def _text(value: Any) -> str:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def to_json(comparison: RunComparison) -> str:
    groups = comparison.groups
    content = {
        "schema": SCHEMA,
        "groups": {one.label: [str(run.record.log) for run in one.runs] for one in groups},
        "equal": comparison.is_equal,
        "sentence": comparison.sentence,
        "log_faults": comparison.faults,
        "settings": comparison.settings,
        "metrics": [plain(row) | {"difference": row.difference} for row in comparison.metrics],
        "positions": [one.row() for one in comparison.positions],
    }
    return json_text(content)
