"""Commands that read recorded runs: review, report, explain."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.common_options import (
    Tables,
    json_option,
    rerun_option,
    tables_option,
    time_option,
)
from scenarios.cli.output import clear_errors, print_whole, progress_of, table_of, warn_of_log
from scenarios.definition.errors import require
from scenarios.results.files import json_text, plain
from scenarios.results.summary_columns import Column

if TYPE_CHECKING:
    from rich.console import Console

    from scenarios.results.log_info import ChannelInfo, LogInfo
    from scenarios.studies.run_list import ListedRun


@click.command(
    epilog="""\b
Examples:
  convoy review runs/20260101-120000-lane_change/run.mcap
  convoy review run.mcap --serve           in a browser
  convoy review run.mcap --save run.rrd    into a file
  convoy review run.mcap --from 100 --to 160 --vehicles v3,v4 --at 120
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@rerun_option("spawn", "Show the run in Rerun", "Default.")
@time_option("--from", help_text="Show the run from this time after its start.")
@time_option("--to", help_text="Show the run up to this time after its start.")
@click.option(
    "--vehicles",
    default="",
    metavar="NAMES",
    help="Show these vehicles and the lead, such as v2,v5. Default: all.",
)
@time_option("--at", help_text="Open the viewer at this time after the start.")
def review(
    log: Path,
    *,
    rerun: str,
    from_s: float | None,
    to_s: float | None,
    vehicles: str,
    at_s: float | None,
) -> None:
    """Show a recorded run in Rerun.

    LOG is a run.mcap or its folder.
    """
    from scenarios.cli.output import wait_until_stopped
    from scenarios.results.log_summary import log_in
    from transport.picture.option import parse_rerun_option

    with clear_errors():
        option = parse_rerun_option(rerun)
        require("review", "viewer", "rerun")
        from scenarios.results.review import Excerpt
        from scenarios.results.review import review as draw_log

        names = [name.strip() for name in vehicles.split(",") if name.strip()]
        excerpt = Excerpt(from_s, to_s, names or None)
        show = progress_of("% drawn")
        count = draw_log(
            log_in(log),
            option,
            wait=wait_until_stopped,
            excerpt=excerpt,
            progress=lambda share: show(round(100 * share), 100),
            at_s=at_s,
        )
        click.echo(f"{count} messages drawn")


@click.command(
    epilog="""\b
Examples:
  convoy report runs/20260101-120000-lane_change/run.mcap
  convoy report run.mcap --html run.html    one file that needs no network
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--html",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write tables and pictures into one HTML file instead, for any browser. An existing"
    " file is replaced.",
)
@json_option("Print the summary as JSON.")
@tables_option("all")
def report(log: Path, *, html: Path | None, as_json: bool, tables: Tables) -> None:
    """Print the tables of a recorded run.

    LOG is a run.mcap or its folder. It may be incomplete, damaged, or of a run that still runs.
    """
    from rich.console import Console

    from scenarios.cli.summary_tables import print_summary
    from scenarios.results.log_summary import log_in, summary_of
    from scenarios.results.summary import to_json
    from scenarios.runs.run_folder import is_running

    with clear_errors():
        log = log_in(log)
        summary = summary_of(log, warn_of_log, running=is_running(log))
        if html is not None:
            from scenarios.results.report.page import write_report
            from scenarios.results.run_record import RunRecord

            write_report(RunRecord(log), html, summary)
            click.echo(f"written: {html}", err=as_json)
        if as_json:
            click.echo(to_json(summary), nl=False)
        elif html is None:
            print_summary(summary, log, Console(), tables)


@click.command(
    epilog="""\b
Examples:
  convoy explain runs/20260101-120000-lossy_lane_change/run.mcap --vehicle v3 --at 12.4
  convoy explain run.mcap --vehicle v3 --at 12.4 --json
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--vehicle", required=True, metavar="NAME", help="Name of the vehicle.")
@time_option("--at", required=True, help_text="Time after the start of the run.")
@json_option("Print the explanation as JSON.")
def explain(log: Path, *, vehicle: str, at_s: float, as_json: bool) -> None:
    """Explain what a vehicle knew at a time.

    LOG is a run.mcap or its folder. Lists the newest message from each source, the messages that
    are missing, and the cause of each loss.
    """
    from rich.console import Console

    from scenarios.cli.summary_tables import print_explanation
    from scenarios.results.log_summary import log_in
    from scenarios.studies import explain as explaining

    with clear_errors():
        explanation = explaining.explain(log_in(log), vehicle, at_s)
        warn_of_log(explanation.log_faults)
        if as_json:
            fields = plain(explanation) | {"sentence": explanation.sentence}
            click.echo(json_text(fields), nl=False)
        else:
            print_explanation(explanation, Console())


# ---- `convoy info`: what a log holds


COLUMNS: "Sequence[Column[ChannelInfo]]" = (
    Column("channel", lambda row: row.channel, left=True),
    Column("messages", lambda row: row.messages),
    Column("rate\nHz", lambda row: row.rate_hz, ".2f"),
    Column("longest\ngap s", lambda row: row.gap_s_max, ".3f"),
    Column("bytes", lambda row: row.bytes),
    Column("missing", lambda row: row.missing),
)


@click.command(epilog="Example: convoy info runs/20260101-120000-lane_change/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@json_option("Print the description as JSON.")
def info(log: Path, *, as_json: bool) -> None:
    """Describe a log as a file.

    LOG is a run.mcap or its folder. Lists duration, identity, damage and missing messages, and the
    messages, rates, longest gaps and bytes of each channel.
    """
    from rich.console import Console

    from scenarios.results.log_info import info_of
    from scenarios.results.log_summary import log_in

    with clear_errors():
        described = info_of(log_in(log))
        if as_json:
            click.echo(json_text(described), nl=False)
            return
        for name, text in _lines(described):
            click.echo(f"{name:<12}{text}")
        print_whole(table_of(COLUMNS, described.channels), Console())


def _lines(log: "LogInfo") -> Iterator[tuple[str, str]]:
    yield "log", f"{log.log}, {log.bytes} bytes"
    yield (
        "recorded",
        f"{log.duration_s:.2f} s, {log.messages} messages of {len(log.vehicles)} vehicles",
    )
    yield "vehicles", ", ".join(log.vehicles)
    yield "state", log.faults.removeprefix(f"{log.log}: ") or "complete"
    if log.thinned:
        yield "thinned", ", ".join(f"{topic} {rate} Hz" for topic, rate in log.thinned.items())
    for name, value in log.identity.items():
        if value not in {"", "[]", "{}"}:
            yield name, value
    yield "attached", ", ".join(f"{name} ({size} bytes)" for name, size in log.attachments.items())


# ---- `convoy recover`: a readable log from a truncated or damaged one


@click.command(epilog="Example: convoy recover run.mcap -o recovered.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="The new log.",
)
def recover(log: Path, *, output: Path) -> None:
    """Copy the readable messages of a damaged log.

    LOG is a truncated or damaged run.mcap or its folder; it is not changed.
    """
    from scenarios.results.log_info import recover_log
    from scenarios.results.log_summary import log_in
    from transport.log.reader import LogReader

    with clear_errors():
        source = log_in(log)
        warn_of_log(LogReader(source).faults)
        count = recover_log(source, output)
        click.echo(f"{output}: {count} messages")


# ---- `convoy runs`: all runs in a folder, as a table


WIDEST = 40
"""Characters of printed overrides."""


@click.command(
    epilog="""\b
Examples:
  convoy runs                                    the runs in the folder runs
  convoy runs --where outcome=failed --sort=-worst_error_m
  convoy runs --where "overrides~loss" --where "worst_error_m>0.5"

\b
Columns of --where and --sort: log, scenario, overrides, seed, clock, outcome,
ran_s, worst_error_m, worst_vehicle, events, line, faults. Signs: = != < <= >
>=, and ~ for texts that contain another.
"""
)
@click.argument("folder", default="runs", type=click.Path(path_type=Path))
@click.option(
    "--where",
    "conditions",
    multiple=True,
    metavar="CONDITION",
    help="Only runs that meet it, such as events>0. Repeatable.",
)
@click.option("--sort", default="", metavar="COLUMN", help="Sort by it; -COLUMN is descending.")
@json_option("Print the table as JSON.")
def runs(folder: Path, *, conditions: tuple[str, ...], sort: str, as_json: bool) -> None:
    """List the runs in a folder.

    FOLDER is searched for logs, in its folders too. Missing, incomplete and unreadable logs are
    listed with the reason; `convoy info` also finds damage within a complete log.
    """
    import json

    from rich.console import Console

    from scenarios.studies.run_list import as_rows, runs_in, selected

    with clear_errors():
        selected((), conditions, sort)  # refuse options before the logs are read
        listed = selected(runs_in(folder, progress_of("runs are read")), conditions, sort)
        if as_json:
            click.echo(json.dumps(as_rows(listed), indent=2))
        else:
            print_runs(listed, Console())


def print_runs(listed: "Sequence[ListedRun]", console: "Console") -> None:
    """Print a table of runs, and below it the faults by number."""
    rows = list(enumerate(listed, 1))
    columns: list[Column[tuple[int, ListedRun]]] = [
        Column("number", lambda row: row[0]),
        Column("run", lambda row: row[1].log, left=True),
        Column("scenario", lambda row: row[1].scenario, left=True),
        Column("overrides", lambda row: _shortened(" ".join(row[1].overrides)), left=True),
        Column("seed", lambda row: row[1].seed),
        Column("outcome", lambda row: row[1].outcome, left=True),
        Column("time,\ns", lambda row: row[1].ran_s, ".1f"),
        Column("worst\nerror, cm", lambda row: row[1].worst_error_m, ".1f", 100.0),
        Column("events", lambda row: row[1].events),
        Column("log", lambda row: "faulty" if row[1].faults else "ok", left=True),
    ]
    print_whole(table_of(columns, rows, style=lambda row: _style(row[1])), console)
    for number, run in rows:
        lines = [run.line] if run.outcome in {"failed", "unreadable"} else []
        if run.faults and run.faults not in lines:
            lines.append(f"log: {run.faults}")
        for line in lines:
            console.print(f"{number}: {line}", highlight=False, soft_wrap=True, markup=False)


def _style(run: "ListedRun") -> str | None:
    return "red" if run.faults or run.outcome in {"failed", "unreadable"} else None


def _shortened(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…"


# ---- `convoy export`: tables and tracks of a recorded run as files


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
    from scenarios.results.run_record import RunRecord
    from scenarios.results.table_files import export_run

    with clear_errors():
        run = RunRecord(log)
        warn_of_log(run.faults)
        folder = out or run.log.parent / "export"
        faults = run.origin["log_faults"]
        suffix = f" (log: {faults})" if faults else ""
        export_run(run, folder, formats, lambda path: click.echo(f"written: {path}{suffix}"))
