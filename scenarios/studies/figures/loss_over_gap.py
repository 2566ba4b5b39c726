"""The cost of loss and of latency over the gap: only what lies within the preview matters."""

from collections.abc import Iterator, Mapping, Sequence
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
from scenarios.studies.many.sweeps.cell_table import SweepTable
from scenarios.studies.many.sweeps.plan import planned

SCENARIO, VEHICLES, SEEDS = "lossy_lane_change", 3, 3
REACTION = ("control.degradation.reaction=extrapolate", "links.jitter_ms=0")
GAP, LOSS, LATENCY = "convoy.gap_m", "links.loss_ratio", "links.latency_ms"


def loss_over_gap_study(options: FigureOptions) -> FigureStudy:
    """Plan a sweep over gap and loss, and one over gap and latency.

    Cars drive on along the extrapolated path without data, so that the error shows what they lack.
    """
    gap, loss, latency = options.axes(
        f"{GAP}=3,6,10,20,30", f"{LOSS}=0,0.6,0.8", f"{LATENCY}=20,200,400"
    )
    count = options.vehicles(VEHICLES)
    figure = f"v{count}.cross_track_error_m_max"
    sweeps = {
        label: planned(
            options.scenario or SCENARIO,
            vary=(gap, axis),
            seeds=options.seeds or SEEDS,
            sets=options.settings(
                f"convoy.vehicles={count}", "duration_s=11", "gnss.rate_hz=10", *others
            ),
            figures=(figure, COLLISIONS),
        )
        for label, axis, others in (
            ("loss", loss, REACTION),
            ("latency", latency, (*REACTION, f"{LOSS}=0")),
        )
    }
    panels = [
        FigurePanel(
            title=f"{label.capitalize()} of messages",
            x_label="gap, m",
            y_label=f"largest error of v{count}, cm",
            is_log=True,
        )
        for label in sweeps
    ]
    return FigureStudy(
        name="loss-over-gap",
        title="What loss and latency cost over the gap",
        sweeps=sweeps,
        panels=panels,
        points=partial(_points, figure=figure),
        outcome=_outcome,
    )


UNITS = {LOSS: (100.0, "% lost"), LATENCY: (1.0, "ms")}


def _points(tables: Mapping[str, SweepTable], figure: str) -> list[FigurePoint]:
    return [
        one
        for panel, table in enumerate(tables.values())
        for one in _points_of(panel, table, figure)
    ]


def _points_of(panel: int, table: SweepTable, figure: str) -> Iterator[FigurePoint]:
    factor, unit = UNITS[table.plan.axes[1].key]
    for cell in table.cells:
        gap, value = (float(text) for text in cell.values)
        errors = [value_of(table, run, figure) for run in cell.runs]
        shown = [None if error is None else 100.0 * error for error in errors]
        yield point(panel, f"{factor * value:g} {unit}", gap, shown, is_log=True)


def _outcome(points: Sequence[FigurePoint]) -> str:
    """State the error at the smallest and the largest gap, for most loss and most latency."""
    parts = []
    for panel in dict.fromkeys(one.panel for one in points):
        of_panel = [one for one in points if one.panel == panel and one.mean is not None]
        lines = list(dict.fromkeys(one.series for one in of_panel))
        for series in lines[-1:]:
            line = sorted((one.x, one.mean or 0.0) for one in of_panel if one.series == series)
            (near, error), (far, other) = line[0], line[-1]
            parts.append(f"{series}: {error:.0f} cm at {near:g} m, {other:.0f} cm at {far:g} m")
    return "; ".join(parts)
