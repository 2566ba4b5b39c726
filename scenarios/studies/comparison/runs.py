"""`convoy compare`: what differs between two or more groups of runs."""

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from string import ascii_uppercase
from typing import Any

from scenarios.definition.errors import ScenarioError, require
from scenarios.results.files import LOG_NAME
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
class RunGroup:
    """Runs of one setting with its label (A, B, …): one, or one per seed.

    `record` is its first run, whose `vehicles` are placed on the path of A. A damaged log may hold
    no summary.
    """

    label: str
    logs: tuple[Path, ...]
    record: RunRecord
    summaries: tuple[RunSummary, ...]
    vehicles: Mapping[str, PlacedVehicle]

    @property
    def title(self) -> str:
        name = self.summaries[0].identity.title if self.summaries else ""
        more = f" and {len(self.logs) - 1} more runs" if len(self.logs) > 1 else ""
        return f"{self.label}: {name or self.logs[0]}{more}"


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
        is_single = all(len(group.logs) == 1 for group in self.groups)
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
    sides = [logs_of(path) for path in paths]
    faults: list[str] = []
    summaries: dict[Path, RunSummary | None] = {}
    logs = [log for side in sides for log in side]
    for done, log in enumerate(logs, 1):
        summaries[log] = _summary(log, faults)
        report(done, len(logs))
    grouped = _grouped(sides, summaries)
    records = [RunRecord(group[0]) for group in grouped]
    groups = tuple(
        RunGroup(
            label=label,
            logs=tuple(group),
            record=record,
            summaries=tuple(one for log in group if (one := summaries[log])),
            vehicles=placed_vehicles(record, records[0]),
        )
        for label, group, record in zip(ascii_uppercase, grouped, records, strict=False)
    )
    first, *others = groups
    compared = 0
    metrics: list[MetricDifference] = []
    for group in others if all(group.summaries for group in groups) else ():
        count, differing = metric_differences(
            group.label, first.summaries, group.summaries, tolerance
        )
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


def _summary(log: Path, faults: list[str]) -> RunSummary | None:
    """Summary of a log; None for a log that lost its scenario."""
    try:
        return summary_of(log, faults.append)
    except LogError as error:
        faults.append(str(error))
        return None


def _grouped(
    sides: Sequence[Sequence[Path]], summaries: Mapping[Path, RunSummary | None]
) -> list[list[Path]]:
    """Group the runs of one folder, and single runs whose settings differ in the seed only.

    Runs are groups of their own if that would leave one group, and if a seed would repeat.
    """
    groups: dict[object, list[Path]] = {}
    for number, side in enumerate(sides):
        summary = summaries[side[0]]
        key: object = number
        if len(side) == 1 and summary:
            about = summary.identity
            scenario = RunRecord(side[0]).known_scenario
            tables = settings_of(scenario.text) if scenario else {}
            texts = str({key: value for key, value in tables.items() if key != "seed"})
            key = (texts, about.clock, about.sources, tuple(about.versions.items()))
            seeds = [one.identity.seed for log in groups.get(key, ()) if (one := summaries[log])]
            key = (key, number) if about.seed in seeds else key
        groups.setdefault(key, []).extend(side)
    if len(groups) == 1:
        groups = dict(enumerate([*side] for side in sides))
    sizes = [len(group) for group in groups.values()]
    if not 2 <= len(groups) <= MOST_GROUPS:
        raise ScenarioError([f"compare: given {len(groups)} runs, allowed 2 to {MOST_GROUPS}"])
    if min(sizes) == 1 < max(sizes):
        (lonely, *_) = next(group for group in groups.values() if len(group) == 1)
        raise LogError(f"{lonely}: is 1 run; the noise over seeds needs two or more of each group")
    if max(sizes) > 1:
        require("compare of several runs a group", "studies", "scipy")
    return list(groups.values())


def settings_of(text: str) -> dict[str, Any]:
    """Keys and values of the scenario of a log."""
    tables = tomllib.loads(text)
    return {key: value for key, value in flattened(tables) if key.split(".")[0] not in NOT_SETTINGS}


def setting_differences(groups: Sequence[RunGroup]) -> dict[str, tuple[str, ...]]:
    """Differing settings of the first runs: scenario, seed, clock and versions of the program.

    A damaged log may lack its scenario; then only what all logs hold is compared.
    """
    scenarios = [group.record.known_scenario for group in groups]
    known = [settings_of(scenario.text) for scenario in scenarios if scenario]
    programs = [_program(group.summaries[0]) for group in groups if group.summaries]
    found = {}
    for tables in (known, programs):
        for key in dict.fromkeys(key for table in tables for key in table):
            values = [table.get(key) for table in tables]
            if len(tables) == len(groups) and any(value != values[0] for value in values):
                found[key] = _texts(values)
    if any(len(group.logs) > 1 for group in groups):
        found.pop("seed", None)
    return found


def _program(summary: RunSummary) -> dict[str, Any]:
    about = summary.identity
    versions = {f"version of {name}": version for name, version in about.versions.items()}
    digests = {f"digest of {name}": digest for name, digest in about.plug_ins.items()}
    return {"clock": about.clock, **versions, "digest of the sources": about.sources, **digests}


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


def _texts(values: Sequence[Any]) -> tuple[str, ...]:
    """Values as text; of long lists only the first number that differs."""
    lists = [value for value in values if isinstance(value, list)]
    if len(lists) < len(values) or max(map(len, lists)) <= LISTED_NUMBERS:
        return tuple(map(_text, values))
    places = range(max(map(len, lists)))
    place = next(
        place for place in places if len({str(one[place : place + 1]) for one in lists}) > 1
    )
    return tuple(
        f"{_text(one[place]) if place < len(one) else 'none'} as number {place + 1} of {len(one)}"
        for one in lists
    )


def _text(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)


def to_json(comparison: RunComparison) -> str:
    content = {
        "schema": SCHEMA,
        "groups": {group.label: [str(log) for log in group.logs] for group in comparison.groups},
        "equal": comparison.is_equal,
        "sentence": comparison.sentence,
        "log_faults": comparison.faults,
        "settings": comparison.settings,
        "metrics": [asdict(row) | {"difference": row.difference} for row in comparison.metrics],
        "positions": [one.row() for one in comparison.positions],
    }
    return json.dumps(content, indent=2) + "\n"
