"""Recorded and recomputed commands of a vehicle as a figure."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.results.files import write_whole
from scenarios.studies.comparison.recomputation import PLOTTED, Recomputation
from scenarios.studies.picture_style import (
    BLUE,
    GREY,
    ORANGE,
    PAGE_IN,
    STYLE,
    encoded,
    picture_format_of,
)


def draw_recomputation(result: Recomputation, path: Path) -> None:
    """Draw a figure into a new file, PNG, SVG or PDF by its extension.

    Raises FileExistsError, or ScenarioError for another extension.
    """
    content = encoded(recomputation_figure(result), picture_format_of(path))
    write_whole(path, content, new=True)


@mpl.rc_context(STYLE)
def recomputation_figure(result: Recomputation) -> Figure:
    """Draw the commands over time, on the left both and on the right their difference."""
    rows = [row for row in PLOTTED if row[0] in result.recorded]
    settings = [text.removeprefix(f"vehicle.{result.vehicle}.") for text in result.settings]
    again = "recomputed" + (f" with {', '.join(settings)}" if settings else "")
    figure = Figure(figsize=(PAGE_IN, 1.5 * len(rows) + 0.7), layout="constrained")
    axes = figure.subplots(len(rows), 2, sharex=True, squeeze=False)
    for (field, label, factor), (both, difference) in zip(rows, axes, strict=True):
        recorded, recomputed = factor * result.recorded[field], factor * result.recomputed[field]
        both.plot(result.at_s, recorded, color=GREY, linewidth=2.2, label="recorded")
        both.plot(result.at_s, recomputed, color=BLUE, linewidth=1.0, label=again)
        both.set_ylabel(label)
        difference.plot(result.at_s, recomputed - recorded, color=ORANGE, linewidth=1.0)
    axes[0, 0].set_title(f"commands of {result.vehicle}", loc="left")
    axes[0, 1].set_title("recomputed minus recorded", loc="left")
    for one in axes[-1]:
        one.set_xlabel("time, s")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure
