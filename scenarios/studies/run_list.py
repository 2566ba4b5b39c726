"""The recorded runs in a folder, as a table that can be filtered and sorted."""

import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.wording import did_you_mean
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.log_summary import summary_of
from scenarios.results.outcome import with_outcome_line
from scenarios.results.summary import RunSummary, from_json
from scenarios.runs.run_folder import is_running
from transport.log.mcap_file import ending_fault
from transport.texts import ConvoyError

UNREADABLE = "unreadable"
MISSING = "missing"


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedRun:
    """One run of a folder; `outcome` is "unreadable" for a log without figures.

    `worst_error_m` is the largest true distance of a follower from the lead's path. `line` is the
    outcome in one line, or why the log cannot be read. `faults` describe a missing, incomplete or
    damaged log and its holes, as far as its summary and its ending show; empty without any.
    """

    log: str
    scenario: str = ""
    overrides: tuple[str, ...] = ()
    seed: int | None = None
    clock: str = ""
    outcome: str
    ran_s: float | None = None
    worst_error_m: float | None = None
    worst_vehicle: str = ""
    events: int | None = None
    line: str = ""
    faults: str = ""


COLUMNS = tuple(field.name for field in fields(ListedRun))
OPERATORS: Mapping[str, Callable[[Any, Any], bool]] = {
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "=": operator.eq,
    "<": operator.lt,
    ">": operator.gt,
    "~": operator.contains,
}
CONDITION = re.compile(r"\s*(\w+)\s*(!=|<=|>=|=|<|>|~)\s*(.*?)\s*")
ALLOWED_CONDITIONS = "COLUMN and one of = != < <= > >= ~ and a value, such as worst_error_m>0.5"


def runs_in(folder: Path, count: Callable[[int, int], None] = lambda *_: None) -> list[ListedRun]:
    """Read all runs in a folder and its folders, in the order of their paths.

    A summary whose log is missing is listed too. `count` gets the numbers of runs that were read
    and that there are. Raises ScenarioError without a run.
    """
    logs = sorted({*folder.rglob("*.mcap"), *_lost_logs(folder)}) if folder.is_dir() else []
    if not logs:
        what = "holds no logs (*.mcap)" if folder.is_dir() else "is not a folder"
        raise ScenarioError([f"{folder}: {what}; give the folder of your runs"])
    runs = []
    for number, log in enumerate(logs, 1):
        runs.append(_listed(log))
        count(number, len(logs))
    return runs


def selected(
    runs: Iterable[ListedRun], conditions: Sequence[str] = (), sort: str = ""
) -> list[ListedRun]:
    """Return the runs that meet all conditions, sorted by a column, or by `-COLUMN` descending.

    Runs without a value of the column come last, and meet only `!=`. Raises ScenarioError.
    """
    chosen = list(runs)
    for text in conditions:
        meets = _condition(text)
        chosen = [run for run in chosen if meets(run)]
    if not sort:
        return chosen
    column = _column(sort.removeprefix("-"), "sort")
    known = [run for run in chosen if getattr(run, column) not in {None, ""}]
    known.sort(key=lambda run: getattr(run, column), reverse=sort.startswith("-"))
    return known + [run for run in chosen if getattr(run, column) in {None, ""}]


def _condition(text: str) -> Callable[[ListedRun], bool]:
    match = CONDITION.fullmatch(text)
    if match is None:
        raise ScenarioError([f"--where: given {text!r}, allowed {ALLOWED_CONDITIONS}"])
    column, sign, given = match.groups()
    _column(column, "where")
    compare = OPERATORS[sign]
    if column in {"seed", "ran_s", "worst_error_m", "events"} and sign != "~":
        try:
            number = float(given)
        except ValueError as error:
            raise ScenarioError(
                [f"--where: {column}: given {given!r}, allowed a number"]
            ) from error
        return lambda run: _holds(getattr(run, column), compare, number)
    return lambda run: _holds(_text(getattr(run, column)), compare, given)


def _holds(value: Any, compare: Callable[[Any, Any], bool], given: Any) -> bool:
    return compare is operator.ne if value is None else compare(value, given)


def _text(value: Any) -> str | None:
    return " ".join(value) if isinstance(value, tuple) else None if value is None else str(value)


def _column(name: str, option: str) -> str:
    if name not in COLUMNS:
        hint = did_you_mean(name, COLUMNS)
        raise ScenarioError([f"--{option}: given {name!r}, allowed {', '.join(COLUMNS)}{hint}"])
    return name


def _lost_logs(folder: Path) -> Iterator[Path]:
    """Yield the logs that are missing next to the summary of a run."""
    for file in folder.rglob(SUMMARY_NAME):
        log = file.with_name(LOG_NAME)
        if not log.exists():
            with suppress(OSError, ValueError):  # the summary of something else
                from_json(file.read_text(encoding="utf-8"))
                yield log


def _listed(log: Path) -> ListedRun:
    try:
        return _read(log)
    except (ConvoyError, OSError, ValueError) as error:
        line = " ".join(str(error).split())
        return ListedRun(log=str(log), outcome=UNREADABLE, line=line, faults=line)


def _read(log: Path) -> ListedRun:
    """Read the summary beside a log, unless the log is newer, else that of the log."""
    running = is_running(log)
    file = log.with_name(SUMMARY_NAME)
    if log.name != LOG_NAME or running or not file.is_file() or _is_newer(log, file):
        return _of_summary(log, summary_of(log, running=running), "")
    summary = with_outcome_line(from_json(file.read_text(encoding="utf-8")))
    return _of_summary(log, summary, ending_fault(log) if log.exists() else MISSING)


def _is_newer(log: Path, file: Path) -> bool:
    return log.exists() and log.stat().st_mtime_ns > file.stat().st_mtime_ns


def _of_summary(log: Path, summary: RunSummary, fault: str) -> ListedRun:
    errors = [
        (vehicle.cross_track_error_m_max, vehicle.name)
        for vehicle in summary.vehicles
        if vehicle.cross_track_error_m_max is not None
    ]
    worst_m, worst = max(errors, default=(None, ""))
    holes, poses = len(summary.holes), sum(hole.poses for hole in summary.holes)
    faults = (
        fault or summary.log_faults.removeprefix(f"{log}: "),
        f"{poses} poses are missing in {holes} holes" if holes else "",
    )
    return ListedRun(
        log=str(log.parent if log.name == LOG_NAME else log),
        scenario=summary.identity.scenario,
        overrides=summary.identity.overrides,
        seed=summary.identity.seed,
        clock=summary.identity.clock,
        outcome=summary.outcome,
        ran_s=summary.ran_s,
        worst_error_m=worst_m,
        worst_vehicle=worst,
        events=len(summary.events),
        line=summary.outcome_line,
        faults="; ".join(filter(None, faults)),
    )


def as_rows(runs: Iterable[ListedRun]) -> list[dict[str, Any]]:
    """Runs as rows, for JSON; the overrides are a list."""
    return [asdict(run) | {"overrides": list(run.overrides)} for run in runs]
