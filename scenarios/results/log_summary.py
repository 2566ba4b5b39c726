"""The summary and the scenario of a run, from its log alone."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.metrics import Metrics
from scenarios.results.outcome import with_outcome_line
from scenarios.results.summarise import METADATA_NAME, summarise
from scenarios.results.summary import RunIdentity, RunSummary, from_json
from transport.log.errors import LogError
from transport.log.mcap_file import REPAIRED
from transport.log.reader import LogReader

PARTIAL = "use the rest of it by --partial"
"""Remedy for a refused log that is damaged or incomplete."""
SHOWN_RUNS = 3
"""Number of runs, the last by name, that the error of a folder of runs lists."""


def log_in(path: Path) -> Path:
    """Return the log of a run's folder; raises LogError for a folder of runs."""
    log = path / LOG_NAME if path.is_dir() else path
    if path.is_dir() and not log.exists():
        runs = sorted(str(run.parent) for run in path.glob(f"*/{LOG_NAME}"))
        if runs:
            count = "1 run" if len(runs) == 1 else f"{len(runs)} runs"
            others = "…, " if len(runs) > SHOWN_RUNS else ""
            names = ", ".join(runs[-SHOWN_RUNS:])
            raise LogError(f"{path}: holds {count}, give one of them: {others}{names}")
    return log


def summary_of(
    log: Path, warn: Callable[[str], None] = lambda _: None, *, running: bool = False
) -> RunSummary:
    """The summary inside `log`; for an incomplete or repaired log, computed from its messages.

    `warn` gets a line about damage and holes, which the summary holds too. The log of a `running`
    run is still being written.
    """
    reader = LogReader(log)
    attachments = reader.attachments()
    if reader.damage and not {SUMMARY_NAME, ATTACHED_AS} & attachments.keys():
        raise LogError(f"{reader.damage}; with it the scenario")
    faults = "" if running else reader.faults
    if faults:
        warn(faults)
    is_complete = not reader.truncated and REPAIRED not in reader.metadata()
    if SUMMARY_NAME in attachments and is_complete:
        try:
            written = from_json(attachments[SUMMARY_NAME].decode())
            return with_outcome_line(replace(written, log_faults=faults))
        except ValueError as error:
            raise LogError(f"{log} ({SUMMARY_NAME}): {error}") from error
    scenario = scenario_in(reader)
    metrics = Metrics.of(scenario)
    for at, _, message in reader.messages(metrics.topics):
        metrics.listen(at, message)
    start_at = metrics.start_at or 0
    thinned = reader.thinned
    if thinned:
        held = ", ".join(thinned)
        warn(f"{log}: holds only part of its {held}; the figures cover only that part")
    breaks_off = "" if running else "the log breaks off"
    summary = summarise(
        _identity_in(reader),
        scenario,
        metrics,
        ran_ns=max(reader.last_at - start_at, 0) if start_at else 0,
        reason="the log is damaged" if reader.damage else breaks_off,
        rejected={},
    )
    holes = summary.holes
    if "truth" in thinned:  # thinned true poses are no holes
        holes = tuple(hole for hole in holes if hole.kind == "pose")
    outcome = "running" if running else summary.outcome
    return with_outcome_line(
        replace(summary, outcome=outcome, outcome_line="", holes=holes, log_faults=faults)
    )


def _identity_in(reader: LogReader) -> RunIdentity:
    try:
        return RunIdentity.of_values(reader.metadata().get(METADATA_NAME, {}))
    except ValueError as error:
        raise LogError(f"{reader.path} (metadata {METADATA_NAME}): {error}") from error


def scenario_of(log: Path) -> Scenario:
    return scenario_in(LogReader(log))


def scenario_in(reader: LogReader) -> Scenario:
    """The scenario inside a log with the lead's path or trace, ready to run again."""
    log, attached = reader.path, reader.attachments().get(ATTACHED_AS)
    if attached is None:
        raise LogError(f"{log}: holds no scenario; was it written by `convoy`?")
    try:
        text = attached.decode()
    except UnicodeDecodeError as error:
        raise LogError(f"{log} ({ATTACHED_AS}): is not text") from error
    return scenario_from_text(text, label=f"{log} ({ATTACHED_AS})", recorded=True)
