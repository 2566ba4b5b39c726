"""`convoy drill`, and its table."""

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scenarios.cli.common_options import override_options
from scenarios.cli.output import clear_errors, table_of
from scenarios.cli.study_commands import engine_options, selected_workers
from scenarios.results.summary_columns import Column

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from scenarios.studies.drill import DrillRow


@click.command(
    epilog="""\b
Examples:
  convoy drill                                   all shipped drills
  convoy drill lead_lost tunnel --seeds 20
  convoy drill mine.toml --junit drills.xml --out drills
  convoy drill lead_lost --set control.degradation.reaction=hold

\b
In real time, with a process for each vehicle: convoy run lead_lost
"""
)
@click.argument("names", nargs=-1, metavar="[NAME|FILE]…")
@override_options
@click.option(
    "--seeds", type=click.IntRange(1, 100_000), metavar="N",
    help="Run each drill with the seeds 1 to N and report the worst value of each limit."
    " Default: its own seed.",
)  # fmt: skip
@engine_options
@click.option(
    "--junit", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="Write JUnit XML with one test case per limit.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path),
    help="Folder for drills.json.",
)  # fmt: skip
def drill(
    *,
    names: tuple[str, ...],
    overrides: tuple[str, ...],
    seeds: int | None,
    workers: int | None,
    scheduler: str,
    junit: Path | None,
    out: Path | None,
) -> None:
    """Run failure drills.

    A drill is a scenario in which something fails, with limits that must hold. By default all
    shipped drills run; `convoy list` has their names. The exit code is 1 if a limit is broken.
    """
    from rich.console import Console

    from scenarios.definition.scenario import drills
    from scenarios.runs.stop import EXIT_FAILED
    from scenarios.studies.drill import (
        JSON_FILE,
        drill_rows,
        drill_variants,
        machine_readable,
        run_drills,
        write_junit,
    )
    from scenarios.studies.engine import study_engine
    from scenarios.studies.job import refuse_existing, require_place, write_files

    with clear_errors():
        refuse_existing(junit)
        chosen = range(1, seeds + 1) if seeds else ()
        variants = [
            variant
            for name in dict.fromkeys(names or drills())
            for variant in drill_variants(name, overrides, chosen)
        ]
        if out is not None:
            require_place(out, (JSON_FILE,))
        fleet = selected_workers(workers, scheduler)
        plug_ins = {name for variant in variants for name in variant.scenario.plug_ins}
        with study_engine(fleet, partial(click.echo, err=True), plug_ins=plug_ins) as engine:
            runs = run_drills(variants, engine)
            rows = drill_rows(runs)
            print_drills(rows, Console(), several_seeds=bool(seeds))
            if out is not None:
                (file,) = write_files(out, {JSON_FILE: machine_readable(rows, runs)})
                click.echo(f"written: {file}")
            if junit is not None:
                write_junit(rows, runs, junit)
                click.echo(f"written: {junit}")
        sys.exit(0 if all(row.passed for row in rows) else EXIT_FAILED)


def _columns(*, several_seeds: bool) -> "Sequence[Column[tuple[DrillRow, str]]]":
    """Columns of limits; only the first row of a drill has its name."""
    from rich.text import Text

    def vehicle(row: "tuple[DrillRow, str]") -> str:
        seed = f"seed {row[0].seed}" if several_seeds else ""
        return ", ".join(filter(None, (row[0].vehicle, seed)))

    return (
        Column("drill", lambda row: row[1], left=True, wraps=True),
        Column("limit", lambda row: row[0].label, left=True, wraps=True),
        Column("value", lambda row: row[0].value, ".3g"),
        Column("margin\n%", lambda row: row[0].margin_ratio, ".0f", 100.0),
        Column("vehicle", vehicle, left=True, wraps=True),
        Column(
            "",
            lambda row: Text("pass") if row[0].passed else Text("FAIL", "bold red"),
            left=True,
            wraps=True,
        ),
    )


def print_drills(
    rows: "Sequence[DrillRow]", console: "Console", *, several_seeds: bool = False
) -> None:
    from rich.text import Text

    firsts = [k for k, row in enumerate(rows) if not k or rows[k - 1].drill != row.drill]
    named = [(row, Path(row.drill).stem if k in firsts else "") for k, row in enumerate(rows)]
    console.print(table_of(_columns(several_seeds=several_seeds), named))
    broken = [row for row in rows if not row.passed]
    for row in broken:
        text = Text.assemble((row.drill, "bold red"), f": {row.message}\n    {row.command}")
        console.print(text, highlight=False, soft_wrap=True)
    names = {row.drill for row in rows}
    failed = {row.drill for row in broken}
    console.print(
        f"{len(names) - len(failed)} of {len(names)} drills passed, "
        f"{len(rows) - len(broken)} of {len(rows)} limits kept",
        highlight=False,
    )
