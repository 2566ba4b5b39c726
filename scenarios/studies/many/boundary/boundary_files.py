"""The files of `convoy bisect`: the plot, and all figures as JSON. Needs matplotlib."""

from dataclasses import asdict
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.studies.axis_labels import axis_label
from scenarios.studies.engine.results import write_files
from scenarios.studies.many.boundary.boundary_search import BoundaryQuery, BoundaryResult
from scenarios.studies.picture_style import BLUE, COLUMN_IN, GREY, ORANGE, RED, STYLE

SCHEMA = "convoy.bisect/1"
PICTURE, JSON_FILE = "boundary", "bisect.json"
SIZE = (COLUMN_IN, 3.4)


def write_boundary(
    query: BoundaryQuery, result: BoundaryResult, out: Path, picture_format: str = "png"
) -> list[Path]:
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
    picture = f"{PICTURE}.{picture_format}"
    return write_files(out, {picture: drawn(query, result), JSON_FILE: whole})


@mpl.rc_context(STYLE)
def drawn(query: BoundaryQuery, result: BoundaryResult) -> Figure:
    """Draw the share of broken runs over the value, with intervals, and the bracket."""
    points = result.points
    label = axis_label(query.key)
    values = [label.factor * one.value for one in points]
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    confidence_low = query.low if result.confidence_low is None else result.confidence_low
    confidence_high = query.high if result.confidence_high is None else result.confidence_high
    if query.share > 0.0:
        ends = label.factor * confidence_low, label.factor * confidence_high
        axes.axvspan(*ends, color=ORANGE, alpha=0.15, linewidth=0,
                     label="boundary at 95 % confidence")  # fmt: skip
        axes.axhline(100.0 * query.share, color=GREY, linewidth=0.9, linestyle=":")
    low, high = label.factor * result.low, label.factor * result.high
    axes.axvspan(low, high, color=RED, alpha=0.55, linewidth=0,
                 label=f"boundary of these seeds: {low:g} to {high:g}")  # fmt: skip
    shares = [100.0 * one.share for one in points]
    below = [100.0 * (one.share - one.low) for one in points]
    above = [100.0 * (one.high - one.share) for one in points]
    axes.errorbar(values, shares, yerr=[below, above], fmt="o-", color=BLUE, markersize=3.5,
                  elinewidth=0.9, capsize=2.0, linewidth=1.0,
                  label="share of the runs, 95 % interval")  # fmt: skip
    margin = 0.03 * (query.high - query.low)
    ends = (label.factor * (query.low - margin), label.factor * (query.high + margin))
    axes.set(ylim=(-3.0, 103.0), xlim=ends, xlabel=label.text)
    axes.set_ylabel(f"runs that break {query.limit}, %")
    axes.set_title(query.variant.name)
    figure.legend(loc="outside lower center")
    return figure
