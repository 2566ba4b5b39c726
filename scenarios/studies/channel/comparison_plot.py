"""Plot of a link's laws against a sample. Needs matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.definition.check.link_forecast import SampledChannel
from scenarios.results.files import write_whole
from scenarios.studies.channel.comparison import QUANTILES, ComparedFigure, Comparison
from scenarios.studies.picture_style import (
    BLUE,
    ORANGE,
    PAGE_IN,
    SMALL_PT,
    STYLE,
    encoded,
    picture_format_of,
)

MOST_STEPS = 2000
"""Steps of the distribution of delays."""
HEIGHT_IN = 2.7
MARK: Any = {"color": ORANGE, "marker": "o", "markersize": 4.0, "linestyle": "none", "label": "law"}


def draw(found: Comparison, sample: SampledChannel, path: Path) -> None:
    """Draw bursts, delays and a radio's delivery over distance into a new file.

    PNG, SVG or PDF by its extension. Raises FileExistsError, or ScenarioError for another one.
    """
    picture_format = picture_format_of(path)
    write_whole(path, encoded(comparison_figure(found, sample), picture_format), new=True)


@mpl.rc_context(STYLE)
def comparison_figure(found: Comparison, sample: SampledChannel) -> Figure:
    count = 3 if found.distances else 2
    figure = Figure(figsize=(PAGE_IN * count / 3 + 0.3, HEIGHT_IN), layout="constrained")
    axes = figure.subplots(1, count)
    figure.suptitle(f"Link {found.sender} → {found.receiver}: law and {found.messages} messages")
    _shares(axes[0], found.bursts, "messages lost in a row", "share of the bursts, %")
    if any(one.sample for one in found.bursts):
        axes[0].set_yscale("log")
        axes[0].yaxis.set_major_formatter("{x:g}")
    _delays(axes[1], found, sample)
    if found.distances:
        _shares(axes[2], found.distances, "distance", "messages received, %")
        axes[2].set_ylim(0.0, 105.0)
    return figure


def _shares(axes: Axes, rows: Sequence[ComparedFigure], what: str, share: str) -> None:
    places = np.arange(len(rows))
    samples = 100.0 * np.array([one.sample or 0.0 for one in rows])
    axes.bar(places, samples, color=BLUE, width=0.7, label="sample")
    laws = [(place, 100.0 * one.law) for place, one in enumerate(rows) if one.law is not None]
    if laws:
        axes.plot(*zip(*laws, strict=True), **MARK)
    if rows:
        names = [one.figure for one in rows]
        axes.set_xticks(places, names, rotation=60, ha="right", rotation_mode="anchor")
        axes.tick_params(axis="x", labelsize=SMALL_PT)
        axes.legend(loc="best")
    else:
        axes.text(0.5, 0.5, "none", ha="center", transform=axes.transAxes)
        axes.set_xticks([])
    axes.grid(visible=False, axis="x")
    axes.set_xlabel(what)
    axes.set_ylabel(share)


def _delays(axes: Axes, found: Comparison, sample: SampledChannel) -> None:
    delays = np.sort(sample.delay_ms)[:: max(1, len(sample.delay_ms) // MOST_STEPS)]
    if len(delays):
        shares = 100.0 * np.arange(1, len(delays) + 1) / len(delays)
        axes.step(delays, shares, where="post", color=BLUE, label="sample")
    expected = found.figures[-len(QUANTILES) :]
    laws = [
        (one.law, 100.0 * part)
        for one, part in zip(expected, QUANTILES, strict=True)
        if one.law is not None
    ]
    if laws:
        axes.plot(*zip(*laws, strict=True), **MARK)
    if len(delays) and np.ptp(delays) < 1.0:
        axes.set_xlim(delays[0] - 5.0, delays[-1] + 5.0)
    axes.set_xlabel("delay, ms")
    axes.set_ylabel("messages within, %")
    if len(delays) or laws:
        axes.legend(loc="best")
