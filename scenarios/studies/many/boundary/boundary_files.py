"""The files of `convoy bisect`: the picture, and all figures as JSON. Needs matplotlib."""

from dataclasses import asdict
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.studies.engine.results import write_files
from scenarios.studies.many.boundary.boundary_search import BoundaryQuery, BoundaryResult
from scenarios.studies.picture_style import BLUE, GREY, ORANGE, RED, STYLE

SCHEMA = "convoy.bisect/1"
PICTURE, JSON_FILE = "boundary.png", "bisect.json"
SIZE = (6.4, 3.8)


def write_boundary(query: BoundaryQuery, result: BoundaryResult, out: Path) -> list[Path]:
    whole = {
        "schema": SCHEMA,
        "scenario": query.variant.name,
        "overrides": list(query.variant.overrides),
        "key": query.key,
        "limit": str(query.limit),
        "range": [query.low, query.high],
        "precision": query.precision,
        "share": query.share,
        "seeds": list(range(1, query.seeds + 1)),
        **asdict(result),
    }
    return write_files(out, {PICTURE: drawn(query, result), JSON_FILE: whole})


@mpl.rc_context(STYLE)
def drawn(query: BoundaryQuery, result: BoundaryResult) -> Figure:
    """Draw the share of broken runs over the value, with intervals, and the bracket."""
    points = result.points
    values = [one.value for one in points]
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    confidence_low = query.low if result.confidence_low is None else result.confidence_low
    confidence_high = query.high if result.confidence_high is None else result.confidence_high
    if query.share > 0.0:
        axes.axvspan(confidence_low, confidence_high, color=ORANGE, alpha=0.15, linewidth=0,
                     label="the boundary is here, 95 %")  # fmt: skip
        axes.axhline(query.share, color=GREY, linewidth=0.9, linestyle=":")
    axes.axvspan(result.low, result.high, color=RED, alpha=0.55, linewidth=0,
                 label=f"{result.low:g} to {result.high:g}")  # fmt: skip
    below = [one.share - one.low for one in points]
    above = [one.high - one.share for one in points]
    axes.errorbar(values, [one.share for one in points], yerr=[below, above], fmt="o-",
                  color=BLUE, markersize=4.0, elinewidth=0.9, capsize=2.0, linewidth=1.0,
                  label="runs, with Wilson's interval")  # fmt: skip
    for one in points:
        axes.annotate(f"{one.broken}/{one.runs}", (one.value, one.share), xytext=(4, 5),
                      textcoords="offset points", fontsize=6.5, color=GREY)  # fmt: skip
    margin = 0.03 * (query.high - query.low)
    axes.set(ylim=(-0.03, 1.08), xlim=(query.low - margin, query.high + margin))
    axes.set_xlabel(query.key)
    axes.set_ylabel(f"share of runs that break {query.limit}")
    axes.set_title(f"{query.variant.name}, {query.seeds} seeds")
    axes.legend(loc="upper left")
    return figure
