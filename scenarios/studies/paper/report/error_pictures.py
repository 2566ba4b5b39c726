"""Pictures of errors over time, in the paper's layout. Needs matplotlib: import when drawing."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.results.drives import Array, Drive, Trial
from scenarios.studies.paper.field_runs import FieldRuns
from scenarios.studies.paper.findings import Findings
from scenarios.studies.paper.keys import BASE, VARIABLE_SPEED, A, B, C, D
from scenarios.studies.picture_style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED

COLOURS = (GREY, BLUE, ORANGE, GREEN, PURPLE)
DASHES = ("-", "-", "--", "-.", ":")
"""The lead first; colour and dashes tell the cars apart."""


def _draw(axes: Axes, drives: Sequence[tuple[Drive, Array]], first: int, width: float) -> None:
    """Values (m) of each drive over time, from place `first` in the convoy on."""
    for place, (drive, values) in enumerate(drives, start=first):
        axes.plot(
            drive.at[: len(values)],
            100.0 * values,
            color=COLOURS[place],
            linestyle=DASHES[place],
            linewidth=width,
            label=drive.name if place else f"{drive.name} (lead)",
        )
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.set_xlabel("time (s)")


def _errors(axes: Axes, trial: Trial, width: float = 1.2) -> None:
    """Lateral error against the own trajectory, all cars."""
    _draw(axes, [(drive, drive.lateral_error) for drive in trial.drives], 0, width)
    axes.set_ylabel("lateral error (cm)")


def true_errors(axes: Axes, trial: Trial, width: float = 1.2) -> None:
    """Draw the followers' places beside the lead's driven path over time."""
    _draw(axes, [(drive, drive.cross_track) for drive in trial.followers], 1, width)
    axes.set_ylabel("beside the lead's path (cm)")


def road(findings: Findings) -> Figure:
    """Draw the lead's path, as in the paper's figure of the target trajectory."""
    lead = findings.trials[BASE].lead
    figure = Figure(figsize=(7.6, 2.4), layout="constrained")
    axes = figure.subplots()
    axes.plot(lead.east, lead.north, color=BLUE)
    for second in (5, 10, 20, 25):
        k = int(np.searchsorted(lead.at, second))
        axes.plot(lead.east[k], lead.north[k], "o", color=RED, markersize=4)
        axes.annotate(
            f"{second} s",
            (lead.east[k], lead.north[k]),
            (0, 7),
            textcoords="offset points",
            ha="center",
            color=RED,
            fontsize=8.0,
        )
    axes.set_ylim(-4.4, 1.4)
    axes.set_xlabel("along the road (m)")
    axes.set_ylabel("to the left (m)")
    axes.set_title("The lead's path: arcs of 500 m radius, lanes of 3.6 m (height exaggerated)")
    return figure


def base(findings: Findings) -> Figure:
    """Draw the lateral errors of the base case."""
    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    axes = figure.subplots()
    _errors(axes, findings.trials[BASE])
    for limit in (-9.0, 9.0):
        axes.axhline(limit, color=RED, linewidth=0.8, linestyle=":")
    axes.annotate(
        "the paper's 9 cm",
        (0.3, 9.0),
        (0, -10),
        textcoords="offset points",
        color=RED,
        fontsize=8.0,
    )
    axes.set_title("Base case: 30 m/s, one passenger in front, three in the rear")
    axes.legend(ncols=4, loc="upper right", bbox_to_anchor=(1.0, 0.93))
    return figure


def a_to_d(findings: Findings) -> Figure:
    """Draw the lateral errors of scenarios A to D, in the paper's layout."""
    titles = {
        A: "A: 10 m/s, n_f = 1, n_r = 2",
        B: "B: 10 m/s, n_f = 1, n_r = 0",
        C: "C: 20 m/s, n_f = 1, n_r = 0",
        D: "D: 30 m/s, two heavier cars before two lighter",
    }
    figure = Figure(figsize=(9.6, 5.6), layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    for axes, (key, title) in zip(panels.flat, titles.items(), strict=True):
        _errors(axes, findings.trials[key])
        axes.set_title(title)
    panels[0, 0].legend(ncols=2, loc="lower center")
    return figure


def variable_speed(findings: Findings) -> Figure:
    """Draw speed, acceleration and lateral errors under the profile."""
    trial = findings.trials[VARIABLE_SPEED]
    figure = Figure(figsize=(7.6, 4.8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.7))
    lead = trial.lead
    above.plot(lead.at, lead.speed, color=BLUE)
    above.set_ylabel("speed (m/s)", color=BLUE)
    beside = above.twinx()
    beside.grid(visible=False)
    acceleration = np.diff(lead.speed) / np.diff(lead.at)
    beside.plot(lead.at[:-1], acceleration, color=ORANGE, linestyle="--", linewidth=1.0)
    beside.set_ylabel("acceleration (m/s²)", color=ORANGE)
    beside.spines["right"].set_visible(True)
    above.set_title("Variable speed")
    _errors(below, trial)
    below.legend(ncols=4, loc="lower right")
    return figure


def field(findings: Findings) -> Figure:
    """Draw course and errors of the field experiment."""
    runs = findings.field
    if runs is None:
        raise ValueError("the field experiment was not run")
    figure = Figure(figsize=(10.4, 5.4), layout="constrained")
    panels = figure.subplot_mosaic(
        [["course", "off without", "true without"], ["course", "off with", "true with"]],
        width_ratios=(0.9, 1.0, 1.0),
    )
    _course(panels["course"], runs)
    for word, trial in (("without", runs.without_lead_data), ("with", runs.with_lead_data)):
        _errors(panels[f"off {word}"], trial, 0.7)
        true_errors(panels[f"true {word}"], trial, 0.9)
        for kind, height in (("off", 10.0), ("true", 15.0)):
            panels[f"{kind} {word}"].set_title(f"{word.capitalize()} the lead's data")
            panels[f"{kind} {word}"].set_ylim(-height, height)
    return figure


def _course(axes: Axes, runs: FieldRuns) -> None:
    lead = runs.with_lead_data.lead
    for place, drive in enumerate(runs.with_lead_data.drives):
        label = f"{drive.name} (lead)" if drive is lead else drive.name
        axes.plot(
            drive.east, drive.north, color=COLOURS[place], linestyle=DASHES[place], label=label
        )
    axes.set_aspect("equal")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.set_title("Course")
    axes.legend(loc="center")
