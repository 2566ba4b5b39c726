"""The command that searches for the instant at which a burst does most harm."""

from functools import partial
from pathlib import Path

import click

from scenarios.cli.common_options import TimeSpan, scenario_options
from scenarios.cli.error_lines import clear_errors
from scenarios.cli.guide import completion
from scenarios.cli.many.study_options import engine_options, selected_fleet
from scenarios.definition.schema.limit_rows import WORDS

FIGURES = [word for word, row in WORDS.items() if row.figure]


@click.command(
    epilog="""\b
Examples:
  convoy worst lane_change --burst 1.5s --seeds 5
  convoy worst lane_change --burst 800ms --link lead:* --link v2:v3 --from 4s --to 9s
  convoy worst my.toml --burst 2s --figure gap_m --write worst.toml
"""
)
@scenario_options
@click.option("--burst", type=TimeSpan(), required=True, metavar="TIME", help="How long it lasts.")
@click.option(
    "--link", "links", multiple=True, metavar="SENDER:RECEIVER", shell_complete=completion.links,
    help="What it hits: names, lead, predecessor, follower or *; by default all. May be repeated.",
)  # fmt: skip
@click.option(
    "--figure", type=click.Choice(FIGURES), default="error_m", show_default=True,
    help="What to make worst: the largest true error, or the smallest true gap.",
)  # fmt: skip
@click.option("--from", "from_s", type=TimeSpan(), metavar="TIME", help="Not earlier; 1 s.")
@click.option(
    "--to", "to_s", type=TimeSpan(), metavar="TIME", help="Not later; where it ends with the run."
)
@click.option(
    "--step", "step_s", type=TimeSpan(), default=0.5, show_default="500ms", metavar="TIME",
    help="Distance of the instants tried first.",
)  # fmt: skip
@click.option(
    "--finest", "finest_s", type=TimeSpan(), default=0.05, show_default="50ms", metavar="TIME",
    help="Distance of those tried last; messages are 50 ms apart.",
)  # fmt: skip
@click.option(
    "--seeds", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
    help="Drive each instant with N seeds; the worst has the worst mean.",
)  # fmt: skip
@engine_options
@click.option(
    "--write", "file", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="Write the worst run as a drill, with a limit.",
)  # fmt: skip
@click.option(
    "--json", "json_file", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="Write all instants tried, with their figures.",
)  # fmt: skip
def worst(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    burst: float,
    links: tuple[str, ...],
    figure: str,
    from_s: float | None,
    to_s: float | None,
    step_s: float,
    finest_s: float,
    seeds: int,
    workers: int | None,
    scheduler: str,
    file: Path | None,
    json_file: Path | None,
) -> None:
    """Find the instant at which a burst of losses does most harm in SCENARIO.

    It is put at a grid of instants, then closer and closer around the three worst. All have the
    same seed or seeds, which is the same noise. With one seed the worst instant may be one at which
    that noise is large; with several it is the road's.
    """
    from scenarios.studies.drills.worst import WorstSearch, base_of, burst_of, span_of
    from scenarios.studies.drills.worst_files import machine_readable, write_drill
    from scenarios.studies.engine.engine import study_engine
    from scenarios.studies.engine.results import refuse_existing, write_file

    with clear_errors():
        refuse_existing(file, json_file)
        base = base_of(scenario, overrides, seed)
        loaded = base.scenario
        sought = burst_of(links, burst, loaded)
        span = span_of(loaded, sought, from_s=from_s, to_s=to_s, step_s=step_s, finest_s=finest_s)
        report = partial(click.echo, err=True)
        with study_engine(selected_fleet(workers, scheduler), report) as engine:
            changes = len(loaded.tables.change)
            search = WorstSearch(base, sought, figure, engine, changes=changes, seeds=seeds)
            found = search.look(span)
        of_seeds = f" (mean of {seeds} seeds {found.mean:.3f})" if seeds > 1 else ""
        click.echo(
            f"worst at {found.at_s:g} s: {figure} {found.figure:.3f}{of_seeds}, "
            f"of {len(found.figures)} instants\n{found.variant.command}"
        )
        if file is not None:
            write_drill(found, file)
            click.echo(f"written: {file}")
        if json_file is not None:
            write_file(json_file, machine_readable(found, sought))
            click.echo(f"written: {json_file}")
