"""`convoy run --clock virtual`, with a picture and tables."""

from pathlib import Path

from scenarios.cli.display_options import DisplayOptions
from scenarios.cli.error_lines import print_error
from scenarios.cli.running.display import observers, print_start, show
from scenarios.definition.scenario import Scenario
from scenarios.results.metrics import Metrics
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual.logged_run import run_virtual


def run_virtually(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    run: str,
    options: DisplayOptions,
) -> int:
    print_start(run, folder, options)
    metrics, lost = Metrics.of(scenario), list[str]()
    with observers(scenario, metrics, options, folder, lost) as watchers:
        stop.begun = True
        summary = run_virtual(scenario, folder, stop, metrics=metrics, observers=watchers)
    show(summary, folder, options)
    if options.quiet and stop.exit_code == EXIT_FAILED:  # signals are reported when they arrive
        print_error(summary.reason)
    if summary.reason:
        return stop.exit_code
    return EXIT_FAILED if lost else 0
