"""Run and check scenarios."""

import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import current_thread, main_thread
from types import FrameType
from typing import Any

from scenarios.api.home import INSTALLED_IN
from scenarios.api.recorded import Run
from scenarios.definition.check.findings import CheckReport, whole_report
from scenarios.definition.check.findings import warnings as scenario_warnings
from scenarios.definition.check.unusual import unusual_settings
from scenarios.definition.errors import ScenarioError
from scenarios.definition.overrides import OverrideError, override_text
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import log_in
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import ClockName
from scenarios.runs.observer import ProgressLines
from scenarios.runs.replayed import replayed_session
from scenarios.runs.run_folder import claimed, folder_of
from scenarios.runs.stop import EXIT_BAD_INPUT, Stop
from scenarios.runs.virtual import run_virtual

Settings = Mapping[str, Any]
"""Values by key of the scenario, such as {"links.loss_ratio": 0.4, "convoy.vehicles": 6}."""


@contextmanager
def arguments_named() -> Iterator[None]:
    """Let errors name arguments of Python, such as `set`, instead of options like --set."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError([line.removeprefix("--") for line in error.lines]) from error


def run(
    scenario: str | Path = "lane_change",
    *,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    seed: int | None = None,
    duration: float | None = None,
    clock: ClockName = "virtual",
    out: str | Path | None = None,
    report: Callable[[str], None] | None = None,
) -> Run:
    """Run a scenario and open its log, like `convoy run`.

    A run that broke a limit or failed is returned too: see `summary.outcome` and `summary.reason`.
    Warnings of the scenario are warnings of Python. Ctrl-C completes the log before it raises
    KeyboardInterrupt.

    Args:
        scenario: A shipped name, a TOML file, or a recorded drive, such as a GPX file.
        set: Settings to override, by key.
        seed: Replaces the scenario's seed.
        duration: Length of the run (s), short for the setting "duration_s".
        clock: As fast as possible in this process ("virtual"), or in real time with a process per
            vehicle ("wall").
        out: Folder for the log and the summary; by default a new folder in `runs`.
        report: Called with a line of progress every few seconds, such as `print`.

    Raises:
        Error: The scenario is refused.

    """
    if duration is not None:
        set = {**(set or {}), "duration_s": duration}  # noqa: A001
    overrides = overrides_of(set)
    arguments = [str(scenario), *(f"--set={text}" for text in overrides)]
    arguments += [] if seed is None else [f"--seed={seed}"]
    with arguments_named():
        loaded = load_scenario(str(scenario), overrides, seed)
    return run_loaded(
        loaded,
        arguments,
        clock=clock,
        out=out,
        report=report,
    )


def run_loaded(
    loaded: Scenario,
    arguments: Sequence[str],
    *,
    clock: ClockName,
    out: str | Path | None,
    report: Callable[[str], None] | None,
) -> Run:
    if clock not in {"virtual", "wall"}:
        raise ScenarioError([f"clock: given {clock!r}, allowed 'virtual' or 'wall'"])
    unusual = unusual_settings(loaded, wall_clock=clock == "wall")
    for line in (*unusual, *scenario_warnings(loaded)):
        warnings.warn(line, stacklevel=3)
    folder = folder_of(loaded, None if out is None else Path(out))
    if clock == "virtual":
        shown = [] if report is None else [ProgressLines(loaded, report)]
        with claimed(folder, fresh=out is None), completed_on_ctrl_c() as stop:
            run_virtual(loaded, folder, stop, watchers=shown, observers=shown)
    else:
        _run_processes(arguments, folder, report)
    return Run(folder)


@arguments_named()
def check(
    scenario: str | Path = "lane_change",
    *,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    seed: int | None = None,
) -> CheckReport:
    """Report the settings, the figures and the warnings of a scenario, like `convoy check`.

    `drive` has the facts of a recorded drive, its holes and pauses. Nothing of a run is simulated
    but the braking of the lead that the gaps hold. Raises Error if the scenario is refused.
    """
    drives: list[DriveInPlane] = []
    loaded = load_scenario(str(scenario), overrides_of(set), seed, on_drive=drives.append)
    return whole_report(loaded, drives[0] if drives else None)


def overrides_of(settings: Settings | None) -> tuple[str, ...]:
    """Settings as texts for `--set`; raises ScenarioError."""
    try:
        return tuple(override_text(key, value) for key, value in (settings or {}).items())
    except OverrideError as error:
        raise ScenarioError([f"set: {error}"]) from error


@contextmanager
def completed_on_ctrl_c() -> Iterator[Stop]:
    """Turn Ctrl-C into a request to stop, and raise KeyboardInterrupt at the end of the block."""
    stop = Stop()
    if current_thread() is not main_thread():
        yield stop
        return

    signals = stop.signals

    def note(number: int, _: FrameType | None) -> None:
        signals.append(number)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)
    if stop.signals:
        raise KeyboardInterrupt


def _run_processes(
    arguments: Sequence[str], folder: Path, report: Callable[[str], None] | None
) -> None:
    """Run on the wall clock by the command line, whose processes are started from a small one."""
    quiet = ["--quiet"] if report is None else []
    options = ["--clock=wall", *quiet, f"--out={folder}"]
    command = [sys.executable, "-P", "-m", "scenarios.cli", "run", *arguments, *options]
    paths = (str(INSTALLED_IN), os.environ.get("PYTHONPATH", ""))
    errors = []
    with subprocess.Popen(  # noqa: S603 - this program
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
    ) as process:
        try:
            for line in map(str.rstrip, process.stderr or ()):
                if line.startswith("error: "):
                    errors.append(line.removeprefix("error: "))
                elif report is not None and not line.startswith("warning: "):
                    report(line)
        except BaseException:
            process.send_signal(signal.SIGINT)
            process.communicate()
            raise
    if process.returncode == EXIT_BAD_INPUT or not (folder / LOG_NAME).exists():
        with suppress(OSError):  # not empty
            folder.rmdir()
        raise ScenarioError(errors)


def replay(
    log: str | Path | RunRecord,
    vehicles: Sequence[str],
    *,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    seed: int | None = None,
    clock: ClockName = "virtual",
    out: str | Path | None = None,
    partial: bool = False,
    report: Callable[[str], None] | None = None,
) -> Run:
    """Let recorded `vehicles` send their messages again, and simulate the others behind them.

    Like `convoy replay`; `partial` allows a damaged or incomplete log. The other arguments are
    those of `run`. Raises Error for an invalid log, vehicle or setting.
    """
    scenario = replayed_session(
        log_in(log.log if isinstance(log, RunRecord) else Path(log)),
        vehicles,
        overrides_of(set),
        seed,
        warn=warnings.warn,
        partial=partial,
    )
    with TemporaryDirectory(prefix="convoy-") as folder:
        file = Path(folder, f"{scenario.name}.toml")
        file.write_text(scenario.text, encoding="utf-8")
        return run_loaded(scenario, [str(file)], clock=clock, out=out, report=report)
