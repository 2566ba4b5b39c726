"""Lateral errors by vehicle, for different sources of the trajectory."""

from collections.abc import Mapping, Sequence
from functools import partial

from scenarios.studies.figures.study import (
    FigureOptions,
    FigurePanel,
    FigurePoint,
    FigureStudy,
    point,
    value_of,
)
from scenarios.studies.many.sweeps.cell_table import SweepTable
from scenarios.studies.many.sweeps.plan import planned

SCENARIO, VEHICLES, SEEDS = "lane_change", 8, 5
SOURCES: Mapping[str, tuple[str, ...]] = {
    "predecessor alone": ("control.fusion=predecessor",),
    "lead and predecessor, one trajectory": ("control.fusion=composite",),
    "lead and predecessor, blended commands": ("control.fusion=blend",),
}
"""Settings by label."""
NORMS = {"rms": "rms", "max": "largest"}


def error_along_string_study(options: FigureOptions) -> FigureStudy:
    """Plan a sweep for each source, with the errors of all followers at equal arc length."""
    options.axes()
    count = options.vehicles or VEHICLES
    followers = [f"v{number}" for number in range(2, count + 1)]
    sweeps = {
        label: planned(
            options.scenario or SCENARIO,
            vary=(),
            seeds=options.seeds or SEEDS,
            sets=options.settings(f"convoy.vehicles={count}", "duration_s=20", *source),
            figures=[
                f"{name}.string.lateral_error_m_{norm}" for norm in NORMS for name in followers
            ],
        )
        for label, source in SOURCES.items()
    }
    panels = [
        FigurePanel(
            title=f"{words.capitalize()} true error on the path that all drove",
            x_label="vehicle",
            y_label=f"{words} error, cm",
        )
        for words in NORMS.values()
    ]
    return FigureStudy(
        name="error-along-string",
        title="Errors from the path of the lead along the string",
        sweeps=sweeps,
        panels=panels,
        points=partial(_points, followers=followers),
        outcome=partial(_outcome, followers=followers),
    )


def _points(tables: Mapping[str, SweepTable], followers: Sequence[str]) -> list[FigurePoint]:
    points = []
    for panel, norm in enumerate(NORMS):
        for label, table in tables.items():
            for number, name in enumerate(followers, 2):
                figure = f"{name}.string.lateral_error_m_{norm}"
                values = [value_of(table, run, figure) for cell in table.cells for run in cell.runs]
                shown = [None if value is None else 100.0 * value for value in values]
                points.append(point(panel, label, number, shown))
    return points


def _outcome(points: Sequence[FigurePoint], followers: Sequence[str]) -> str:
    """State the rms error of the last follower over the first one's, by source."""
    of_ends = {
        (one.series, one.x): one.mean for one in points if one.panel == 0 and one.mean is not None
    }
    tail = float(len(followers) + 1)
    parts = [
        f"{of_ends[series, tail] / of_ends[series, 2.0]:.1f} with {series}"
        for series in SOURCES
        if (series, tail) in of_ends and of_ends.get((series, 2.0))
    ]
    return f"rms error of {followers[-1]} over that of v2: {', '.join(parts) or 'unknown'}"
