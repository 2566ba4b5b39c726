"""The laws of a link and a sample of them as a picture. Needs matplotlib."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.definition.check.link_sample import SampledChannel
from scenarios.studies.channel.comparison import QUANTILES, ComparedFigure, Comparison
from scenarios.studies.picture_style import BLUE, ORANGE, STYLE

MOST_STEPS = 2000
"""Of the drawn distribution of delays."""


def draw(found: Comparison, sample: SampledChannel, path: Path) -> None:
    """Draw bursts, delays and a radio's delivery over distance; raises OSError if it exists."""
    with mpl.rc_context(STYLE):
        count = 3 if found.distances else 2
        figure = Figure(figsize=(3.6 * count, 3.4), layout="constrained")
        axes = figure.subplots(1, count)
        figure.suptitle(f"{found.sender} → {found.receiver}, {found.messages} messages")
        _shares(axes[0], found.bursts, "messages lost in a row", "share of the bursts")
        if any(one.sample for one in found.bursts):
            axes[0].set_yscale("log")
        _delays(axes[1], found, sample)
        if found.distances:
            _shares(axes[2], found.distances, "distance", "share received")
        with path.open("xb") as target:
            figure.savefig(target, format=path.suffix.removeprefix("."))


def _shares(axes: Axes, rows: Sequence[ComparedFigure], what: str, share: str) -> None:
    places = np.arange(len(rows))
    samples = np.array([one.sample or 0.0 for one in rows])
    axes.bar(places, samples, color=BLUE, width=0.7, label="sample")
    laws = [(place, one.law) for place, one in enumerate(rows) if one.law is not None]
    if laws:
        axes.plot(*zip(*laws, strict=True), color=ORANGE, marker="o", linestyle="none", label="law")
    if rows:
        axes.set_xticks(places, [one.figure for one in rows], rotation=60, ha="right")
        axes.legend(loc="best")
    else:
        axes.text(0.5, 0.5, "none", ha="center", transform=axes.transAxes)
    axes.set_xlabel(what)
    axes.set_ylabel(share)


def _delays(axes: Axes, found: Comparison, sample: SampledChannel) -> None:
    delays = np.sort(sample.delay_ms)[:: max(1, len(sample.delay_ms) // MOST_STEPS)]
    if len(delays):
        shares = np.arange(1, len(delays) + 1) / len(delays)
        axes.step(delays, shares, where="post", color=BLUE, label="sample")
    expected = found.figures[-len(QUANTILES) :]
    laws = [
        (one.law, part)
        for one, part in zip(expected, QUANTILES, strict=True)
        if one.law is not None
    ]
    if laws:
        axes.plot(*zip(*laws, strict=True), color=ORANGE, marker="o", linestyle="none", label="law")
    axes.set_xlabel("delay (ms)")
    axes.set_ylabel("share of messages within")
    if len(delays) or laws:
        axes.legend(loc="best")
