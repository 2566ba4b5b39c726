"""`convoy channel figure`: what loss, bursts and latency cost the last vehicle of a convoy.

As a picture and as JSON. Needs matplotlib.
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
from scenarios.studies.engine.stamp import current_stamp
from scenarios.studies.engine.workers import open_workers
from scenarios.studies.picture_style import BLUE, GREY, RED, SEQUENCE, STYLE

SCHEMA = "convoy.channel_figure/1"
PICTURE, JSON_FILE = "channel.png", "channel.json"


def channel_figure(
    plan: Plan, out: Path, progress: Callable[[str], None], *, workers: int | None = None
) -> list[Cost]:
    """Simulate `plan`; write the picture and its figures as JSON into `out`.

    Uses all cores by default. Raises ScenarioError if one of both files exists.
    """
    with study_engine(
        partial(open_workers, workers),
        progress,
        out=out,
        files=(PICTURE, JSON_FILE),
        identity={"plan": asdict(plan), **asdict(current_stamp())},
    ) as engine:
        costs, margin_m = simulate_costs(plan, engine), lane_margin_m()
        write_files(
            out,
            {JSON_FILE: machine_readable(costs, margin_m), PICTURE: draw_costs(costs, margin_m)},
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
                **asdict(one.channel),
                "seeds": list(range(1, len(one.errors_m) + 1)),
                "true_error_m_max": list(one.errors_m),
                "true_error_m_max_median": one.median_m,
                "true_error_m_max_largest": one.largest_m,
                "beyond_lane": one.runs_beyond(lane_margin_m),
            }
            for one in costs
        ],
    }


# ---- The picture

LEAST_M, MOST_M = 0.05, 1.0
"""Ends of the colours; what is beyond has the colour of the end."""
DARK_M = 0.3
"""Below, cells are dark, and their numbers light."""
SIZE = (8.0, 6.6)
FAR_M = 5.0
"""Larger errors are drawn here: there is no road to drive on."""


@mpl.rc_context(STYLE)
def draw_costs(costs: Sequence[Cost], lane_margin_m: float) -> Figure:
    """Draw maps of loss and latency above and bursts below, a column for each gap."""
    gaps = list(dict.fromkeys(one.channel.gap_m for one in costs))
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots(2, len(gaps), squeeze=False)
    images = []
    for column, gap in enumerate(gaps):
        here = [one for one in costs if one.channel.gap_m == gap]
        maps = [one for one in here if one.channel.burst_messages is None]
        bursts = [one for one in here if one.channel.burst_messages is not None]
        images.append(_map(axes[0, column], maps))
        axes[0, column].set_title(f"gaps of {gap:g} m")
        _bursts(axes[1, column], bursts, lane_margin_m)
    axes[0, 0].set_ylabel("latency, ms")
    axes[1, 0].set_ylabel("largest true error of the last car, m")
    seeds = max(len(one.errors_m) for one in costs if one.channel.burst_messages)
    left = f"of {seeds} drives so many left the lane:"
    axes[1, 0].text(1.16, 14.0, left, color=RED, fontsize=8.0)
    axes[1, 0].text(1.16, 1.1 * lane_margin_m, "edge of the lane", color=GREY, fontsize=7.5)
    axes[1, -1].legend(loc="upper left", bbox_to_anchor=(0.0, 0.9))
    bar = figure.colorbar(images[0], ax=list(axes[0]), extend="both", pad=0.01, aspect=22)
    bar.set_label("largest true error, m (median of seeds)")
    bar.set_ticks([0.05, 0.1, 0.2, 0.5, 1.0], labels=["0.05", "0.1", "0.2", "0.5", "1"])
    bar.ax.minorticks_off()
    return figure


def _map(axes: Axes, costs: Sequence[Cost]) -> AxesImage:
    """Draw the median error over loss and latency, with its number in each cell."""
    losses = sorted({one.channel.loss_ratio for one in costs})
    latencies = sorted({one.channel.latency_ms for one in costs})
    table = np.full((len(latencies), len(losses)), np.nan)
    for one in costs:
        row, column = latencies.index(one.channel.latency_ms), losses.index(one.channel.loss_ratio)
        table[row, column] = one.median_m
        colour = "white" if one.median_m < DARK_M else "black"
        text = f"{one.median_m:.2f}" if one.median_m < 9.995 else f"{one.median_m:.0f}"
        axes.text(column, row, text, ha="center", va="center", fontsize=7.5, color=colour)
    image = axes.imshow(
        table, origin="lower", aspect="auto", cmap=SEQUENCE, norm=LogNorm(LEAST_M, MOST_M)
    )
    axes.set_xticks(range(len(losses)), [f"{100.0 * loss:g}" for loss in losses])
    axes.set_yticks(range(len(latencies)), [f"{latency:g}" for latency in latencies])
    axes.set_xlabel("messages lost, each on its own, %")
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
        left = f"{one.runs_beyond(lane_margin_m)}"
        axes.text(length, 9.0, left, color=RED, ha="center", va="center", fontsize=8.5)
    largest = [min(one.largest_m, FAR_M) for one in costs]
    axes.plot(lengths, largest, "--", color=RED, label="worst seed")
    axes.plot(lengths, [one.median_m for one in costs], "-", color=BLUE, marker="o", markersize=4.0,
              label="median of seeds")  # fmt: skip
    axes.axhline(lane_margin_m, color=GREY, linewidth=0.9, linestyle=":")
    axes.set(xscale="log", yscale="log", xlim=(1.1, 1.12 * max(lengths)), ylim=(0.03, 13.0))
    axes.set_xticks(lengths, [f"{length:g}" for length in lengths])
    axes.set_yticks(
        [0.03, 0.1, 0.3, 1.0, 3.0, FAR_M], labels=["0.03", "0.1", "0.3", "1", "3", "5+"]
    )
    axes.minorticks_off()
    lost = f"{100.0 * BURST_LOSS_RATIO:g} % lost, {FLOOR_MS:g} ms"
    axes.set_xlabel(f"messages lost in a row, mean ({lost})")
