"""Plots of the report on the paper's experiments."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.results.drives import Drive, Trial
from scenarios.results.figure_style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, PURPLE, RED
from scenarios.studies.paper.experiments import (
    ALPHAS,
    BASE,
    BASE_SPEED,
    FIELD_WITH,
    FIELD_WITHOUT,
    LONG_WITH,
    LONG_WITHOUT,
    NO_LEAD_DATA,
    NOISE_WITH,
    NOISE_WITHOUT,
    RADII,
    TRAJECTORY_NAMES,
    VARIABLE_SPEED,
    A,
    B,
    C,
    D,
    Need,
    Part,
    RunKey,
    Variant,
    at_alpha,
    at_radius,
)
from scenarios.studies.paper.findings import (
    PREVIEW_S,
    SHORT_PREVIEW_S,
    Findings,
    predict_errors,
    transfer,
)
from scenarios.studies.paper.information import noise_rms
from transport.columns import Floats
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.linear_model import propagation, trace_propagation

COLOURS = (GREY, BLUE, ORANGE, GREEN, PURPLE)
DASHES = ("-", "-", "--", "-.", ":")
"""The lead first; colour and dashes distinguish the cars."""

MARKS = ("o", "s", "^")
PLACES = range(3)
"""The followers of the main cases."""

Draw = Callable[[Findings], Figure]


def _draw(axes: Axes, drives: Sequence[tuple[Drive, Floats]], first: int, width: float) -> None:
    """Plot values (m) of each drive over time, from place `first` in the convoy on."""
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
    axes.set_xlabel("time, s")


def _errors(axes: Axes, trial: Trial, width: float = 1.2) -> None:
    """Plot the lateral error of all cars against the own trajectory."""
    _draw(axes, [(drive, drive.lateral_error) for drive in trial.drives], 0, width)
    axes.set_ylabel("lateral error, cm")


def _true_errors(axes: Axes, trial: Trial, width: float = 1.2) -> None:
    _draw(axes, [(drive, drive.cross_track) for drive in trial.followers], 1, width)
    axes.set_ylabel("beside the lead's path, cm")


def road(findings: Findings) -> Figure:
    lead = findings.trials[BASE].lead
    figure = Figure(figsize=(PAGE_IN, 2.4), layout="constrained")
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
    axes.set_xlabel("along the road, m")
    axes.set_ylabel("to the left, m")
    axes.set_title("The lead's path: arcs of 500 m radius, lanes of 3.6 m (height exaggerated)")
    return figure


def base(findings: Findings) -> Figure:
    figure = Figure(figsize=(PAGE_IN, 3.4), layout="constrained")
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
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def a_to_d(findings: Findings) -> Figure:
    titles = {
        A: "A: 10 m/s, n_f = 1, n_r = 2",
        B: "B: 10 m/s, n_f = 1, n_r = 0",
        C: "C: 20 m/s, n_f = 1, n_r = 0",
        D: "D: 30 m/s, two heavier cars before two lighter",
    }
    figure = Figure(figsize=(PAGE_IN, 5.6), layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    for axes, (key, title) in zip(panels.flat, titles.items(), strict=True):
        _errors(axes, findings.trials[key])
        axes.set_title(title)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def variable_speed(findings: Findings) -> Figure:
    trial = findings.trials[VARIABLE_SPEED]
    figure = Figure(figsize=(PAGE_IN, 4.8), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.7))
    lead = trial.lead
    above.plot(lead.at, lead.speed, color=BLUE)
    above.set_ylabel("speed, m/s", color=BLUE)
    beside = above.twinx()
    beside.grid(visible=False)
    acceleration = np.diff(lead.speed) / np.diff(lead.at)
    beside.plot(lead.at[:-1], acceleration, color=ORANGE, linestyle="--", linewidth=1.0)
    beside.set_ylabel("acceleration, m/s²", color=ORANGE)
    beside.spines["right"].set_visible(True)
    above.set_title("Variable speed")
    _errors(below, trial)
    figure.legend(*below.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def field(findings: Findings) -> Figure:
    with_data, without = findings.trials[FIELD_WITH], findings.trials[FIELD_WITHOUT]
    figure = Figure(figsize=(PAGE_IN, 5.4), layout="constrained")
    panels = figure.subplot_mosaic(
        [["course", "off without", "true without"], ["course", "off with", "true with"]],
        width_ratios=(0.9, 1.0, 1.0),
    )
    _course(panels["course"], with_data)
    for word, trial in (("without", without), ("with", with_data)):
        _errors(panels[f"off {word}"], trial, 0.7)
        _true_errors(panels[f"true {word}"], trial, 0.9)
        for kind in ("off", "true"):
            panels[f"{kind} {word}"].set_title(f"{word.capitalize()} the lead's data")
            panels[f"{kind} {word}"].sharey(panels[f"{kind} without"])
    cars = panels["course"].get_legend_handles_labels()
    figure.legend(*cars, loc="outside lower center", ncols=4)
    return figure


def _course(axes: Axes, trial: Trial) -> None:
    for place, drive in enumerate(trial.drives):
        label = f"{drive.name} (lead)" if drive is trial.lead else drive.name
        axes.plot(
            drive.east, drive.north, color=COLOURS[place], linestyle=DASHES[place], label=label
        )
    axes.set_aspect("equal")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.set_title("Course")


def lead_data(findings: Findings) -> Figure:
    """Draw true errors without and with the lead's data, and their maxima along eight cars."""
    figure = Figure(figsize=(PAGE_IN, 3.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.2, 1.2, 1.0))
    _true_errors(left, findings.trials[NO_LEAD_DATA])
    _true_errors(middle, findings.trials[BASE])
    left.set_title("Without the lead's data")
    middle.set_title("With the lead's data")
    middle.sharey(left)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=4)
    for key, colour in ((LONG_WITHOUT, RED), (LONG_WITH, BLUE)):
        trial = findings.trials[key]
        cars = np.arange(2, 2 + len(trial.followers))
        for values, line, name in (
            (trial.cross_track, "o-", "off the lead's path"),
            (trial.tracking, "s:", "off the own trajectory"),
        ):
            right.plot(
                cars,
                100.0 * np.array(values),
                line,
                color=colour,
                markersize=4.0,
                linewidth=1.2,
                label=f"{key.variant}: {name}",
            )
    right.set_ylim(bottom=0.0)
    right.set_xlabel("car")
    right.set_ylabel("largest error, cm")
    right.set_title("Eight cars")
    figure.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=2)
    return figure


def along_the_convoy(findings: Findings) -> Figure:
    """Draw true errors of eight cars for each α, and noise with and without the lead's data."""
    figure = Figure(figsize=(PAGE_IN, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for place, alpha in enumerate(ALPHAS):
        run = findings.trials[at_alpha(alpha)]
        cars = np.arange(2, 2 + len(run.followers))
        style: dict[str, Any] = {"color": COLOURS[place], "linewidth": 1.2}
        left.plot(
            cars,
            100.0 * np.array(run.cross_track),
            marker="o",
            markersize=4.0,
            label=f"α = {alpha:g}",
            **style,
        )
        expected = predict_errors(findings.trials[BASE].lead, transfer(BASE), alpha, len(cars))[1]
        left.plot(cars, 100.0 * np.array(expected), linestyle=":", **style)
    left.set_ylabel("largest error off the lead's path, cm")
    left.set_title("A lane change")
    left.set_ylim(top=50.0)  # cars that have lost their path are beyond
    for key, colour in ((NOISE_WITHOUT, RED), (NOISE_WITH, BLUE)):
        rms = noise_rms(findings.noisy(key))
        label = f"{key.variant} the lead's data"
        right.plot(range(2, 2 + len(rms)), 100.0 * np.array(rms), "o-", color=colour, label=label)
    right.set_ylabel("rms error off the lead's path, cm")
    right.set_title("Noise of receivers on a straight")
    for axes in (left, right):
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("car")
        axes.legend()
    return figure


def maxima(findings: Findings) -> Figure:
    """Draw largest errors: exact (bars), with the road moved (dashes), with noise (dots)."""
    known = (BASE, NO_LEAD_DATA, A, B, C, D, VARIABLE_SPEED)
    cases = [key for key in known if findings.has(key)]
    figure = Figure(figsize=(PAGE_IN, 5.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for axes, measure in ((above, "tracking"), (below, "cross_track")):
        for column, key in enumerate(cases):
            for place, value in enumerate(getattr(findings.trials[key], measure)):
                x = column + 0.25 * (place - 1)
                axes.bar(x, 100.0 * value, width=0.22, color=COLOURS[place + 1], alpha=0.85)
                noisy = [100.0 * getattr(run, measure)[place] for run in findings.noisy(key)]
                axes.plot([x] * len(noisy), noisy, "o", color="black", markersize=2.2)
                moved = [100.0 * getattr(run, measure)[place] for run in findings.moved(key)]
                axes.plot([x] * len(moved), moved, "_", color="black", markersize=7.0)
        axes.set_ylabel("largest error, cm")
    for place in PLACES:
        above.bar(0.0, 0.0, color=COLOURS[place + 1], label=f"follower {place + 1}")
    above.plot([], [], "_", color="black", markersize=7.0, label="the road moved")
    above.plot([], [], "o", color="black", markersize=2.2, label="a run with noise")
    marks = above.get_legend_handles_labels()
    figure.legend(*marks, loc="outside lower center", ncols=5)
    above.set_title("Off the own trajectory (what the paper shows)")
    below.set_title("Off the lead's driven path")
    below.set_xticks(range(len(cases)), [key.label for key in cases])
    return figure


def radius(findings: Findings) -> Figure:
    figure = Figure(figsize=(PAGE_IN, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    _followers_over_radius(left, findings)
    styles: tuple[tuple[Variant | None, str, str, str], ...] = (
        ("no_lead_data", RED, "o", "without the lead's data"),
        (None, BLUE, "s", "with them"),
        ("slip_compensated", GREEN, "^", "with them, slip compensated"),
    )
    for variant, colour, mark, label in styles:
        keys = [RunKey("radius", variant, value=r) for r in RADII]
        values = [findings.trials[key].cross_track[-1] for key in keys]
        right.plot(
            RADII, 100.0 * np.array(values), color=colour, marker=mark, markersize=4, label=label
        )
    right.set_ylabel("off the lead's path, cm")
    right.set_title("The third follower")
    for axes in (left, right):
        axes.legend()
        axes.set_xlabel("radius of the bends, m")
        axes.set_ylim(bottom=0.0)
    return figure


def _followers_over_radius(axes: Axes, findings: Findings) -> None:
    for place in PLACES:
        style: dict[str, Any] = {"color": COLOURS[place + 1], "marker": MARKS[place]}
        values = [findings.trials[at_radius(r)].tracking[place] for r in RADII]
        label = f"follower {place + 1}"
        axes.plot(RADII, 100.0 * np.array(values), markersize=4.0, label=label, **style)
        for r in RADII:
            noisy = [100.0 * run.tracking[place] for run in findings.noisy(at_radius(r))]
            axes.plot([r] * len(noisy), noisy, linestyle="", markersize=2.5, alpha=0.6, **style)
    axes.axhline(9.0, color=RED, linestyle=":", linewidth=1.0)
    axes.annotate(
        "the paper's 9 cm",
        (RADII[-1], 9.0),
        (0, 3),
        textcoords="offset points",
        ha="right",
        color=RED,
        fontsize=8.0,
    )
    axes.set_ylabel("off the own trajectory, cm")
    axes.set_title("With the lead's data (small: with noise)")


def measured_propagation(findings: Findings) -> Figure:
    fine = np.geomspace(0.3, 30.0, 600)
    figure = Figure(figsize=(PAGE_IN, 4.2), layout="constrained")
    axes = figure.subplots()
    paper = propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_SPEED)
    trace = trace_propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_SPEED)
    label = "G(jω), the paper's: steering by the difference of states"
    axes.semilogx(fine, np.abs(paper.at(fine)), color=RED, label=label)
    label = "F(jω): steering along the path left behind"
    axes.plot(fine, np.abs(trace.at(fine)), color=BLUE, linestyle="--", label=label)
    driven, ratios = findings.ratios(PREVIEW_S)
    for place in range(ratios.shape[1]):
        label = f"measured in the convoy, car {place + 2} over car {place + 1}"
        axes.plot(driven, ratios[:, place], MARKS[place], color=GREEN, markersize=4.5, label=label)
    axes.plot(driven, ratios.prod(axis=1) ** (1.0 / ratios.shape[1]), color=GREEN, linewidth=1.0)
    driven, ratios = findings.ratios(SHORT_PREVIEW_S)
    label = f"the same with a preview of {SHORT_PREVIEW_S:g} s, all cars"
    axes.plot(driven, ratios.mean(axis=1), "D", color=PURPLE, mfc="white", ms=4.5, label=label)
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("frequency, rad/s")
    axes.set_ylabel("amplitude over that of the car ahead")
    axes.set_title("Propagation with the predecessor's data only, 30 m/s")
    axes.legend(loc="upper left")
    return figure


def recipe(findings: Mapping[Trajectory, Findings]) -> Figure:
    figure = Figure(figsize=(PAGE_IN, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    for (trajectory, results), colour, mark in zip(
        findings.items(), (BLUE, RED), ("o", "s"), strict=True
    ):
        exact = [max(results.trials[at_radius(r)].tracking) for r in RADII]
        label = TRAJECTORY_NAMES[trajectory]
        left.loglog(RADII, 100.0 * np.array(exact), color=colour, marker=mark, label=label)
        noisy = [max(max(run.tracking) for run in results.noisy(at_radius(r))) for r in RADII]
        label = f"{label}, 2 cm of noise"
        left.plot(
            RADII, 100.0 * np.array(noisy), mark, ls=":", mfc="white", color=colour, label=label
        )
    left.axhline(9.0, color=GREY, linestyle=":", linewidth=1.0)
    left.set_xticks([200, 300, 400, 500, 700, 1000], ["200", "300", "400", "500", "700", "1000"])
    left.minorticks_off()
    left.set_xlabel("radius of the bends, m")
    left.set_ylabel("largest error off the own trajectory, cm")
    left.set_title("A lane change at 30 m/s (dotted: the paper's 9 cm)")
    left.legend()
    fitted, paper = findings["fitted"], findings["paper"]
    bars = {
        "fitted": [fitted.trials[BASE]],
        "fitted,\nnoise": fitted.noisy(BASE),
        "the\npaper's": [paper.trials[BASE]],
        "the paper's,\nnoise": paper.noisy(BASE),
        "prefix\nrule": [paper.trials[BASE.with_variant("paper_prefix")]],
    }
    for column, runs in enumerate(bars.values()):
        for place in PLACES:
            worst = max(run.tracking[place] for run in runs)
            x = column + 0.25 * (place - 1)
            right.bar(x, 100.0 * worst, width=0.22, color=COLOURS[place + 1])
    right.set_yscale("log")
    right.axhline(9.0, color=GREY, linestyle=":", linewidth=1.0)
    right.set_xticks(range(len(bars)), list(bars))
    right.set_title("Base case, followers 1 to 3 (500 m)")
    return figure


PICTURES: dict[str, tuple[tuple[Need, ...], Draw]] = {
    "road": ((BASE,), road),
    "errors_base": ((BASE,), base),
    "errors_a_to_d": ((A, B, C, D), a_to_d),
    "errors_variable_speed": ((VARIABLE_SPEED,), variable_speed),
    "maxima": ((BASE,), maxima),
    "lead_data": ((BASE, NO_LEAD_DATA, LONG_WITH, LONG_WITHOUT), lead_data),
    "along_the_convoy": (
        (BASE, *map(at_alpha, ALPHAS), NOISE_WITH.noisy(1), NOISE_WITHOUT.noisy(1)),
        along_the_convoy,
    ),
    "radius": (tuple(at_radius(r) for r in RADII), radius),
    "propagation": ((Part.PROPAGATION,), measured_propagation),
    "field": ((Part.FIELD,), field),
}
"""Needs of each picture, and the function that draws it."""

BOTH: dict[str, tuple[tuple[Need, ...], Callable[[Mapping[Trajectory, Findings]], Figure]]] = {
    "paper_recipe": (
        (BASE, BASE.with_variant("paper_prefix"), *(at_radius(r) for r in RADII)),
        recipe,
    ),
}
"""The same for pictures that show both trajectories."""
