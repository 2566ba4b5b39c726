"""Lateral errors by vehicle, for different sources of the trajectory."""

from collections.abc import Mapping, Sequence
from functools import partial

from scenarios.studies.figures.study import (
    COLLISIONS,
    FigureOptions,
    FigurePanel,
    FigurePoint,
    FigureStudy,
    point,
    value_of,
)
from scenarios.studies.many.sweeps.cell_table import SweepCell, SweepTable
from scenarios.studies.many.sweeps.plan import planned

SCENARIO, VEHICLES, SEEDS = "paper_base", 8, 4
FLOW = "information_flow.lateral"
NORMS = {"rms": "rms", "max": "largest"}


def error_along_string_study(options: FigureOptions) -> FigureStudy:
    """Plan a sweep over the sources, with the errors of all followers at equal arc length.

    The paper's base case is exact; noise of RTK is added, so that seeds differ.
    """
    axes = options.axes(f"{FLOW}=predecessor,lead,lead_and_predecessor")
    count = options.vehicles(VEHICLES)
    followers = [f"v{number}" for number in range(2, count + 1)]
    plan = planned(
        options.scenario or SCENARIO,
        vary=axes,
        seeds=options.seeds or SEEDS,
        sets=options.settings(
            f"convoy.vehicles={count}", "duration_s=20", "gnss.position_noise_m=0.02"
        ),
        figures=[
            *(f"{name}.string.lateral_error_m_{norm}" for norm in NORMS for name in followers),
            COLLISIONS,
        ],
    )
    panels = [
        FigurePanel(
            title=f"{words.capitalize()} true error",
            x_label="vehicle",
            y_label=f"{words} error, cm",
        )
        for words in NORMS.values()
    ]
    return FigureStudy(
        name="error-along-string",
        title="Errors from the path of the lead, by the vehicles that a follower steers behind",
        sweeps={"sources": plan},
        panels=panels,
        points=partial(_points, followers=followers),
        outcome=partial(_outcome, followers=followers),
    )


def _points(tables: Mapping[str, SweepTable], followers: Sequence[str]) -> list[FigurePoint]:
    (table,) = tables.values()
    return [
        point(panel, cell.values[0].replace("_", " "), number, _errors(table, cell, name, norm))
        for panel, norm in enumerate(NORMS)
        for cell in table.cells
        for number, name in enumerate(followers, 2)
    ]


def _errors(table: SweepTable, cell: SweepCell, name: str, norm: str) -> list[float | None]:
    """Errors (cm) of a follower in all runs."""
    figure = f"{name}.string.lateral_error_m_{norm}"
    values = [value_of(table, run, figure) for run in cell.runs]
    return [None if value is None else 100.0 * value for value in values]


def _outcome(points: Sequence[FigurePoint], followers: Sequence[str]) -> str:
    """State the rms error of the last follower over the first one's, by source."""
    means = {(one.series, one.x): one.mean for one in points if one.panel == 0 and one.mean}
    tail = len(followers) + 1
    parts = [
        f"{means[series, tail] / mean:.1f} behind {series}"
        for (series, x), mean in means.items()
        if x == 2 and (series, tail) in means
    ]
    return f"rms error of {followers[-1]} over that of v2: {', '.join(parts) or 'unknown'}"
