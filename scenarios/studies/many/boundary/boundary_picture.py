"""The plot of `convoy bisect`: shares of broken runs over the value. Needs Matplotlib."""

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.studies.axis_labels import axis_label
from scenarios.studies.many.boundary.boundary_search import (
    BoundaryQuery,
    BoundaryResult,
    grouped,
)
from scenarios.studies.many.statistics import agresti_coull
from scenarios.studies.picture_style import BLUE, COLUMN_IN, GREY, ORANGE, RED, STYLE

SIZE = (COLUMN_IN, 3.4)
MOST_GROUPS = 16


@mpl.rc_context(STYLE)
def drawn(query: BoundaryQuery, result: BoundaryResult) -> Figure:
    """Draw the shares of groups of runs, the fitted curve, and the interval of the boundary."""
    label = axis_label(query.key)
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    if result.boundary is not None:
        ends = (
            query.low if result.low is None else result.low,
            query.high if result.high is None else result.high,
        )
        axes.axvspan(*(label.factor * end for end in ends), color=ORANGE, alpha=0.3, linewidth=0,
                     label="boundary, 95 % interval")  # fmt: skip
        axes.axvline(label.factor * result.boundary, color=RED, linewidth=0.9)
        axes.plot([label.factor * one.low for one in result.points],
                  [100.0 * one.fitted for one in result.points],
                  color=BLUE, linewidth=1.0, label="fitted share")  # fmt: skip
    axes.axhline(100.0 * query.share, color=GREY, linewidth=0.9, linestyle=":")
    groups = grouped(result.points, MOST_GROUPS)
    intervals = [agresti_coull(one.broken, one.runs) for one in groups]
    axes.errorbar(
        [0.5 * label.factor * (one.low + one.high) for one in groups],
        [100.0 * one.share for one in groups],
        xerr=[0.5 * label.factor * (one.high - one.low) for one in groups],
        yerr=[
            [100.0 * (one.share - low) for one, (low, _) in zip(groups, intervals, strict=True)],
            [100.0 * (high - one.share) for one, (_, high) in zip(groups, intervals, strict=True)],
        ],
        fmt="o", color=BLUE, markersize=3.5, elinewidth=0.9, capsize=2.0,
        label="share of the runs, 95 % interval",
    )  # fmt: skip
    margin = 0.03 * (query.high - query.low)
    ends = (label.factor * (query.low - margin), label.factor * (query.high + margin))
    axes.set(ylim=(-3.0, 103.0), xlim=ends, xlabel=label.text)
    axes.set_ylabel(f"runs that break {query.limit}, %")
    axes.set_title(query.variant.name)
    figure.legend(loc="outside lower center")
    return figure
