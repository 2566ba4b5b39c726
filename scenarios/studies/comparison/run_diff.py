"""`convoy diff`: what differs between two runs, or between two groups of runs."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from scenarios.definition.errors import require
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import log_in, summary_of
from scenarios.results.summary import RunSummary
from scenarios.studies.comparison.figure_diff import FigureDifference, figure_differences
from scenarios.studies.comparison.message_diff import MessageComparison, compare_messages
from scenarios.studies.comparison.settings_diff import SettingDifference, setting_differences
from transport.log.errors import LogError
from transport.log.reader import LogReader

SCHEMA = "convoy.diff/1"
SEED = "seed"
"""Setting in which the runs of one side differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunDiff:
    """Differences of A and B. `messages` is None with several runs a side."""

    a: tuple[Path, ...]
    b: tuple[Path, ...]
    settings: tuple[SettingDifference, ...]
    messages: MessageComparison | None
    figures: tuple[FigureDifference, ...]
    faults: tuple[str, ...]
    """Damage, interruption, holes and missing parts of the logs, a line each."""

    @property
    def is_equal(self) -> bool:
        """Whether the runs are equal; of several, whether no difference exceeds the noise."""
        if self.messages is not None:
            return not self.settings and self.messages.is_equal
        return not any(figure.exceeds_noise for figure in self.figures)

    @property
    def sentence(self) -> str:
        if self.messages is None:
            return self._noise_sentence
        if self.is_equal:
            return f"identical: all settings and all {self.messages.equal} messages are equal"
        if self.messages.is_equal:
            return f"different settings, equal messages ({self.messages.equal})"
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
        messages=compare_messages(first_a, first_b) if is_single else None,
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
    messages = diff.messages
    content = {
        "schema": SCHEMA,
        "a": [str(log) for log in diff.a],
        "b": [str(log) for log in diff.b],
        "equal": diff.is_equal,
        "sentence": diff.sentence,
        "log_faults": list(diff.faults),
        "settings": [asdict(setting) for setting in diff.settings],
        "messages": None if messages is None else _messages(messages),
        "figures": [
            asdict(figure)
            | {"difference": figure.difference, "exceeds_noise": figure.exceeds_noise}
            for figure in diff.figures
        ],
    }
    return json.dumps(content, indent=2, default=list) + "\n"


def _messages(messages: MessageComparison) -> Mapping[str, Any]:
    first = messages.first
    return {
        "equal": messages.equal,
        "differing": dict(messages.differing),
        "only_in_a": dict(messages.only_in_a),
        "only_in_b": dict(messages.only_in_b),
        "first": None if first is None else asdict(first) | {"sentence": first.sentence},
    }
