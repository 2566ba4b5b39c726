"""`convoy export`: tables and tracks of a recorded run as files."""

from pathlib import Path

import click

from scenarios.cli.error_lines import clear_errors, warn_of_log


@click.command(
    epilog="""\b
Examples:
  convoy export runs/20260101-120000-lane_change
  convoy export run.mcap --format parquet --out tables
  convoy run tables/v1.gpx --clock virtual      a recorded lead leads again

\b
Files:
  vehicles.csv, .parquet   a row for each instant of a vehicle: true position,
                           speed, error and gap, and its own errors and mode
  links.csv, .parquet      a row for each message of a link: number, time of
                           sending, outcome, cause and delay
  NAME.gpx                 measured positions of a vehicle
  export.json              of CSV files: their log, its scenario, seed and faults;
                           Parquet and GPX files have them in their metadata
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "formats",
    multiple=True,
    default=("csv", "gpx"),
    show_default=True,
    type=click.Choice(["csv", "parquet", "gpx"]),
    help="Format of the files. Repeatable.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the files. Default: export, next to the log.",
)
def export(log: Path, *, formats: tuple[str, ...], out: Path | None) -> None:
    """Write tables and tracks of a recorded run.

    LOG is a run.mcap or its folder. It may be incomplete or damaged. Names of columns end in their
    unit; unknown values are empty in CSV and null in Parquet.
    """
    from scenarios.results.recorded.run_record import RunRecord
    from scenarios.results.recorded.table_files import export_run

    with clear_errors():
        run = RunRecord(log)
        warn_of_log(run.faults)
        folder = out or run.log.parent / "export"
        faults = run.origin["log_faults"]
        suffix = f" (log: {faults})" if faults else ""
        export_run(run, folder, formats, lambda path: click.echo(f"written: {path}{suffix}"))
