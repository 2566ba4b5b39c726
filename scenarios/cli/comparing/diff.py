"""`convoy diff`."""

from pathlib import Path

import click

from scenarios.cli.common_options import json_option
from scenarios.cli.error_lines import clear_errors, warn_of_log


@click.command(
    epilog="""\b
Examples:
  convoy diff runs/first runs/second
  convoy diff runs/alpha-0.5 runs/alpha-0.8      two folders of runs, such as a run per seed
  convoy diff 'runs/before-*' 'runs/after-*' --json
"""
)
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option("--all", "all_figures", is_flag=True, help="Print all differing figures.")
@json_option("Print the differences as JSON.")
def diff(a: Path, b: Path, *, all_figures: bool, as_json: bool) -> None:
    """List the differences of two runs.

    A and B are logs, folders of a run, folders of several runs, or quoted patterns. Lists differing
    settings, the first differing message, and differing figures. Of several runs a side, it lists
    the figures whose difference exceeds the noise over the seeds (99 % interval of the difference
    of the means, from pairs of equal seeds where both sides have them).

    The exit code is 0 for equal runs (of several: no difference beyond the noise), 1 for different
    ones, and 2 for an error.
    """
    from rich.console import Console

    from scenarios.cli.comparing.diff_table import print_diff
    from scenarios.cli.output import progress_of
    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.comparison.run_diff import diff_runs, to_json

    with clear_errors():
        result = diff_runs(a, b, progress_of("runs read"))
        for fault in result.faults:
            warn_of_log(fault)
        if as_json:
            click.echo(to_json(result), nl=False)
        else:
            print_diff(result, Console(), all_figures=all_figures)
    raise SystemExit(0 if result.is_equal else EXIT_FAILED)
