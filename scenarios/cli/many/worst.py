"""`convoy worst`."""

import json
from functools import partial
from pathlib import Path

import click

from scenarios.cli.common_options import (
    json_option,
    link_option,
    output_option,
    scenario_options,
    time_option,
)
from scenarios.cli.error_lines import clear_errors
from scenarios.cli.many.study_options import (
    FIGURES,
    engine_options,
    figure_option,
    selected_workers,
)


@click.command(
    epilog="""\b
Examples:
  convoy worst lane_change --burst 1.5s --seeds 5
  convoy worst lane_change --burst 800ms --link lead:* --link v2:v3 --from 4s --to 9s
  convoy worst my.toml --burst 2s --figure true_gap_m_min -o worst.toml
"""
)
@scenario_options
@time_option("--burst", required=True, help_text="Length of the burst.")
@link_option("Lose messages of this link only. Repeatable. Default: all links.", multiple=True)
@figure_option("Figure to maximize, or to minimize if its name ends in _min")
@time_option("--from", help_text="Earliest start of the burst. Default: 1s.")
@time_option("--to", help_text="Latest start of the burst. Default: the burst ends with the run.")
@time_option("--step", default=0.5, help_text="Step of the first search grid. Default: 500ms.")
@time_option(
    "--finest", default=0.05, help_text="Last and smallest step of the search. Default: 50ms."
)
@click.option(
    "--seeds", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
    help="Simulate each time with N consecutive seeds, from --seed on, and use the mean.",
)  # fmt: skip
@engine_options
@output_option("Write the worst run to this new file, as a drill with a limit.")
@json_option("Print all simulated times and figures as JSON.")
def worst(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    burst_s: float,
    links: tuple[str, ...],
    figure: str,
    from_s: float | None,
    to_s: float | None,
    step_s: float,
    finest_s: float,
    seeds: int,
    workers: int | None,
    scheduler: str,
    output: Path | None,
    as_json: bool,
) -> None:
    """Find the most harmful time of a burst loss.

    Simulates SCENARIO with the burst at a grid of times, then at finer steps around the three worst
    times. All simulations use the same random numbers. With one seed, a time may be the worst
    because random errors are large there. Several seeds average them out.
    """
    from scenarios.studies.drills.worst import WorstSearch, base_variant, parsed_burst, search_span
    from scenarios.studies.drills.worst_files import machine_readable, write_drill
    from scenarios.studies.engine.engine import study_engine
    from scenarios.studies.engine.results import refuse_existing

    with clear_errors():
        refuse_existing(output)
        base = base_variant(scenario, overrides, seed)
        loaded = base.scenario
        burst = parsed_burst(links, burst_s, loaded)
        span = search_span(
            loaded, burst, from_s=from_s, to_s=to_s, step_s=step_s, finest_s=finest_s
        )
        report = partial(click.echo, err=True)
        with study_engine(selected_workers(workers, scheduler), report) as engine:
            changes = len(loaded.tables.change)
            search = WorstSearch(base, burst, figure, engine, changes=changes, seeds=seeds)
            found = search.run(span)
        if as_json:
            click.echo(json.dumps(machine_readable(found, burst), indent=2))
        else:
            name = next(field for field, word in FIGURES.items() if word == figure)
            of_seeds = f" (mean of {seeds} seeds {found.mean:.3f})" if seeds > 1 else ""
            click.echo(
                f"worst at {found.at_s:g} s: {name} {found.figure:.3f}{of_seeds}, "
                f"{len(found.figures)} start times simulated\nrepeat it: {found.variant.command}"
            )
        if output is not None:
            write_drill(found, output)
            click.echo(f"written: {output}", err=as_json)
