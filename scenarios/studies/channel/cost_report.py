"""`convoy channel figure`: plot and JSON of the last car's error over loss, bursts and latency.

Needs matplotlib.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from scenarios.results.versions import current_stamp
from scenarios.studies.channel.cost_drives import (
    BURST_LOSS_RATIO,
    FLOOR_MS,
    SCENARIO,
    SETTINGS,
    Cost,
    Plan,
    lane_margin_m,
    simulate_costs,
)
from scenarios.studies.engine.engine import study_engine
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import open_workers
from scenarios.studies.picture_style import (
    BLUE,
    GREY,
    PAGE_IN,
    RED,
    SEQUENCE,
    SMALL_PT,
    STYLE,
    ink_on,
)

SCHEMA = "convoy.channel_figure/1"
PICTURE, JSON_FILE = "channel", "channel.json"


def channel_figure(
    plan: Plan,
    out: Path,
    progress: Callable[[str], None],
    *,
    workers: int | None = None,
    picture_format: str = "png",
) -> list[Cost]:
    """Simulate `plan` and write a plot and its figures as JSON into `out`.

    Uses all cores by default. Raises ScenarioError if one of the files exists.
    """
    picture = f"{PICTURE}.{picture_format}"
    with study_engine(
        partial(open_workers, workers),
        progress,
        out=out,
        files=(picture, JSON_FILE),
        identity={"plan": asdict(plan), **asdict(current_stamp())},
    ) as engine:
        costs, margin_m = simulate_costs(plan, engine), lane_margin_m()
        write_files(
            out,
            {JSON_FILE: machine_readable(costs, margin_m), picture: draw_costs(costs, margin_m)},
        )
    return costs


def machine_readable(costs: Sequence[Cost], lane_margin_m: float) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "scenario": SCENARIO,
        "settings": list(SETTINGS),
        "lane_margin_m": lane_margin_m,
        "channels": [
            {
                **asdict(cost.channel),
                "seeds": list(range(1, len(cost.errors_m) + 1)),
                "true_error_m_max": list(cost.errors_m),
                "true_error_m_max_median": cost.median_m,
                "true_error_m_max_largest": cost.largest_m,
                "beyond_lane": cost.runs_beyond(lane_margin_m),
            }
            for cost in costs
        ],
    }


# ---- The plot

SIZE = (PAGE_IN, 5.8)
FAR_M = 5.0
"""Errors (m) are clipped here for the plot."""
TICKS_M = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, FAR_M)


@mpl.rc_context(STYLE)
def draw_costs(costs: Sequence[Cost], lane_margin_m: float) -> Figure:
    """Draw maps of loss and latency above and bursts below, a column for each gap."""
    gaps = list(dict.fromkeys(one.channel.gap_m for one in costs))
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots(2, len(gaps), squeeze=False)
    maps = [one for one in costs if one.channel.burst_messages is None]
    medians = [min(one.median_m, FAR_M) for one in maps]
    least, most = min(medians), max(*medians, 1.01 * min(medians))
    colours = LogNorm(least, most)
    for column, gap in enumerate(gaps):
        here = [one for one in costs if one.channel.gap_m == gap]
        bursts = [one for one in here if one.channel.burst_messages is not None]
        image = _map(axes[0, column], [one for one in here if one in maps], colours)
        axes[0, column].set_title(f"gap of {gap:g} m")
        _bursts(axes[1, column], bursts, lane_margin_m)
    axes[0, 0].set_ylabel("latency, ms")
    axes[1, 0].set_ylabel("largest true error of the last car, m")
    for column in axes[1, 1:]:
        column.sharey(axes[1, 0])
    bar = figure.colorbar(image, ax=list(axes[0]), pad=0.01, aspect=22)
    bar.set_label("largest true error of the last car,\nmedian of the seeds, m")
    inside = [one for one in TICKS_M if least <= one <= most]
    bar.set_ticks(inside, labels=[f"{one:g}" for one in inside])
    bar.ax.minorticks_off()
    figure.legend(*axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _map(axes: Axes, costs: Sequence[Cost], colours: LogNorm) -> AxesImage:
    """Draw the median error over loss and latency, with its number in each cell."""
    losses = sorted({one.channel.loss_ratio for one in costs})
    latencies = sorted({one.channel.latency_ms for one in costs})
    table = np.full((len(latencies), len(losses)), np.nan)
    for one in costs:
        row, column = latencies.index(one.channel.latency_ms), losses.index(one.channel.loss_ratio)
        table[row, column] = one.median_m
        ink = ink_on(mpl.colormaps[SEQUENCE](colours(one.median_m)))
        text = f"{one.median_m:.2f}" if one.median_m < 9.995 else f"{one.median_m:.0f}"
        axes.text(column, row, text, ha="center", va="center", fontsize=SMALL_PT, color=ink)
    image = axes.imshow(table, origin="lower", aspect="auto", cmap=SEQUENCE, norm=colours)
    axes.set_xticks(range(len(losses)), [f"{100.0 * loss:g}" for loss in losses])
    axes.set_yticks(range(len(latencies)), [f"{latency:g}" for latency in latencies])
    axes.set_xlabel("independent loss, %")
    axes.grid(visible=False)
    axes.tick_params(length=0.0)
    return image


def _bursts(axes: Axes, costs: Sequence[Cost], lane_margin_m: float) -> None:
    """Draw each run, and median and largest of the seeds, over the mean burst."""
    lengths = [one.channel.burst_messages or 1.0 for one in costs]
    for length, one in zip(lengths, costs, strict=True):
        errors = np.minimum(one.errors_m, FAR_M)
        xs = np.full(len(errors), length)
        axes.plot(xs, errors, "o", color=GREY, alpha=0.4, markersize=3.2, markeredgewidth=0)
    largest = [min(one.largest_m, FAR_M) for one in costs]
    axes.plot([], [], "o", color=GREY, alpha=0.6, markersize=3.2, label="one run")
    axes.plot(lengths, [one.median_m for one in costs], "-", color=BLUE, marker="o", markersize=4.0,
              label="median of the seeds")  # fmt: skip
    axes.plot(lengths, largest, "--", color=RED, label="worst seed")
    axes.axhline(lane_margin_m, color=GREY, linewidth=0.9, linestyle=":", label="edge of the lane")
    axes.set(xscale="log", yscale="log", xlim=(0.9 * min(lengths), 1.15 * max(lengths)))
    axes.set_ylim(top=1.2 * FAR_M)
    # Number of runs that left the lane, above each burst.
    counts = [f"{one.runs_beyond(lane_margin_m)}" for one in costs]
    for length, count in zip(lengths, counts, strict=True):
        axes.annotate(count, (length, 1.0), (0, 2), xycoords=("data", "axes fraction"),
                      textcoords="offset points", ha="center", color=RED,
                      fontsize=SMALL_PT)  # fmt: skip
    runs = max(len(one.errors_m) for one in costs)
    left = f"of {runs} runs left the lane:"
    axes.set_title(left, color=RED, fontsize=SMALL_PT, loc="left", pad=12)
    axes.set_xticks(lengths, [f"{length:g}" for length in lengths])
    shown = [one for one in TICKS_M if one >= 0.02]
    labels = [f"{one:g}" if one < FAR_M else f"≥ {FAR_M:g}" for one in shown]
    axes.set_yticks(shown, labels=labels)
    axes.minorticks_off()
    lost = f"{100.0 * BURST_LOSS_RATIO:g} % loss, {FLOOR_MS:g} ms"
    axes.set_xlabel(f"mean burst, messages ({lost})")
