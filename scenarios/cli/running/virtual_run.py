"""`convoy run --clock virtual`, with a picture and tables."""

from pathlib import Path

import click

from scenarios.cli.running.display import layout, observers, show
from scenarios.definition.scenario import Scenario
from scenarios.results.metrics import Metrics
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual.logged_run import run_virtual


def run_virtually(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    rerun: str,
    *,
    quiet: bool,
) -> int:
    metrics = Metrics.of(scenario)
    with (
        layout(folder, scenario, rerun, quiet=quiet),
        observers(scenario, metrics, rerun, run_id=folder.name, quiet=quiet) as watchers,
    ):
        stop.begun = True
        summary = run_virtual(scenario, folder, stop, metrics=metrics, observers=watchers)
    show(summary, folder, quiet=quiet)
    if quiet and stop.exit_code == EXIT_FAILED:  # signals are reported when they arrive
        click.echo(summary.reason, err=True)
    return stop.exit_code if summary.reason else 0
