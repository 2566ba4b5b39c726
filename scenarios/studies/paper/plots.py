"""Plots of the report on the paper's experiments."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.results.figure_style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, PURPLE, RED, STYLE
from scenarios.studies.paper.measures import (
    AFTER_START_S,
    EMPTY,
    Findings,
    predict_errors,
    rms_after,
    transfer,
)
from scenarios.studies.paper.runs import (
    ALPHAS,
    BASE_SPEED,
    PREVIEW_S,
    RADII,
    SHORT_PREVIEW_S,
    SIMULATIONS,
    at_alpha,
    at_radius,
    label,
)
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.linear_model import propagation

COLOURS = (GREY, BLUE, ORANGE, GREEN, PURPLE)
DASHES = ("-", "-", "--", "-.", ":")
"""The lead first; colour and dashes distinguish the cars."""
TRACKING, TRUE, SPEED, COURSE = "lateral_error", "cross_track", "speed", "north"
QUANTITIES = {
    TRACKING: (100.0, "off the own trajectory, cm"),
    TRUE: (100.0, "off the lead's path, cm"),
    SPEED: (1.0, "speed, m/s"),
    COURSE: (1.0, "north, m"),
}
"""Arrays of a `Drive` to plot over time (the course over east), with factor and label."""


class PaperPanel(NamedTuple):
    key: str
    quantity: str
    title: str = ""


PANELS: Mapping[str, tuple[PaperPanel, ...]] = {
    "road": (PaperPanel("base", COURSE, "Arcs of 500 m radius, lanes of 3.6 m"),),
    "errors_base": (
        PaperPanel("base", TRACKING, "Base case: 30 m/s, n_f = 1, n_r = 3 (the paper: 9 cm)"),
    ),
    "errors_a_to_d": (
        PaperPanel("a", TRACKING, "A: 10 m/s, n_f = 1, n_r = 2"),
        PaperPanel("b", TRACKING, "B: 10 m/s, n_f = 1, n_r = 0"),
        PaperPanel("c", TRACKING, "C: 20 m/s, n_f = 1, n_r = 0"),
        PaperPanel("d", TRACKING, "D: 30 m/s, two heavier cars, two lighter"),
    ),
    "errors_variable_speed": (
        PaperPanel("variable_speed", SPEED),
        PaperPanel("variable_speed", TRACKING),
    ),
    "lead_data": (
        PaperPanel("no_lead_data", TRUE, "Without the lead's data"),
        PaperPanel("base", TRUE, "With the lead's data"),
    ),
    "field": (
        PaperPanel("field/without", TRACKING, "Without the lead's data"),
        PaperPanel("field/with", TRACKING, "With the lead's data"),
        PaperPanel("field/without", TRUE),
        PaperPanel("field/with", TRUE),
        PaperPanel("field/with", COURSE),
    ),
}
"""Pictures of quantities of all cars over time."""


def _panels(rows: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(PAGE_IN, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def over_time(panels: Sequence[PaperPanel], findings: Findings) -> Figure:
    """Draw the panels, two in a row."""
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure, places = _panels(rows, columns, 0.8 + 2.4 * rows)
    for place in places[len(panels) :]:
        place.set_axis_off()
    for axes, panel in zip(places, panels, strict=False):
        factor, label = QUANTITIES[panel.quantity]
        is_course = panel.quantity == COURSE
        for drive, colour, line in zip(
            findings.trials[panel.key].drives, COLOURS, DASHES, strict=False
        ):
            values = factor * getattr(drive, panel.quantity)
            along = drive.east if is_course else drive.at
            style: dict[str, Any] = {"color": colour, "linestyle": line}
            axes.plot(along[: len(values)], values, label=drive.name, linewidth=1.0, **style)
        axes.set_xlabel("east, m" if is_course else "time, s")
        axes.set_ylabel(label)
        axes.set_title(panel.title)
    figure.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _along(axes: Axes, values: Iterable[float], colour: str, text: str, style: str = "o-") -> None:
    """Plot a figure (m) of each follower over its place."""
    lengths = 100.0 * np.array(list(values))
    cars = range(2, 2 + len(lengths))
    axes.plot(cars, lengths, style, color=colour, markersize=4.0, linewidth=1.2, label=text)
    axes.set_xlabel("car")


def along_the_convoy(findings: Findings) -> Figure:
    """Eight cars: both errors, true errors for each α, and noise, with and without lead data."""
    figure, places = _panels(1, 3, 3.4)
    both, weights, noise = places
    for with_data, without, colour in (
        ("long/with", "noise_along/with", BLUE),
        ("long/without", "noise_along/without", RED),
    ):
        trial, word = findings.trials[with_data], with_data.split("/")[1]
        _along(both, trial.cross_track, colour, f"{word}: off the lead's path")
        _along(both, trial.tracking, colour, f"{word}: off the own trajectory", "s:")
        rms = rms_after(AFTER_START_S, *findings.noisy(without))
        _along(noise, rms, colour, f"{word} the lead's data")
    for place, alpha in enumerate(ALPHAS):
        run, colour = findings.trials[at_alpha(alpha)], COLOURS[place]
        _along(weights, run.cross_track, colour, f"α = {alpha:g}")
        lead, followers = findings.trials["base"].lead, len(run.followers)
        _along(weights, predict_errors(lead, transfer(), alpha, followers)[1], colour, "", ":")
    titles = ("Largest errors, cm", "Largest true error, cm", "Noise on a straight: rms, cm")
    for axes, title, top in zip(places, titles, (None, 50.0, None), strict=True):
        axes.set_title(title)
        axes.set_ylim(0.0, top)  # cars that have lost their path are beyond
        axes.legend(fontsize=6.0)
    return figure


def maxima(findings: Findings) -> Figure:
    """Largest errors: exact (bars), with the road moved (dashes), with noise (dots)."""
    cases = [key for key in (*SIMULATIONS, "no_lead_data") if findings.has(key)]
    figure, panels = _panels(2, 1, 5.2)
    for axes, measure in zip(panels, ("tracking", "cross_track"), strict=True):
        for column, key in enumerate(cases):
            for place, value in enumerate(getattr(findings.trials[key], measure)):
                x = column + 0.25 * (place - 1)
                axes.bar(x, 100.0 * value, width=0.22, color=COLOURS[place + 1], alpha=0.85)
                for runs, mark in ((findings.noisy(key), "."), (findings.moved(key), "_")):
                    values = [100.0 * getattr(run, measure)[place] for run in runs]
                    axes.plot([x] * len(values), values, mark, color="black")
        axes.set_xticks(range(len(cases)), list(map(label, cases)))
    panels[0].set_ylabel(QUANTITIES[TRACKING][1])
    panels[1].set_ylabel(QUANTITIES[TRUE][1])
    return figure


def radius(findings: Findings) -> Figure:
    figure, (left, right) = _panels(1, 2, 3.8)
    keys = list(map(at_radius, RADII))
    for place in range(3):
        style: dict[str, Any] = {"color": COLOURS[place + 1], "marker": "os^"[place]}
        values = [100.0 * findings.trials[key].tracking[place] for key in keys]
        left.loglog(RADII, values, label=f"follower {place + 1}", markersize=4.0, **style)
        noisy = [
            (r, 100.0 * run.tracking[place])
            for r, key in zip(RADII, keys, strict=True)
            for run in findings.noisy(key)
        ]
        left.plot(*np.transpose(noisy), linestyle="", markersize=2.5, alpha=0.6, **style)
    left.axhline(9.0, color=RED, linewidth=0.8, linestyle=":", label="the paper's 9 cm")
    left.set_title("Off the own trajectory, cm (small: with noise)")
    for suffix, colour, text in (
        ("/no_lead_data", RED, "without the lead's data"),
        ("", BLUE, "with them"),
        ("/slip_compensated", GREEN, "with them, slip compensated"),
    ):
        values = [100.0 * findings.trials[key + suffix].cross_track[-1] for key in keys]
        right.plot(RADII, values, "o-", color=colour, markersize=4, label=text)
    right.set_title("Third follower off the lead's path, cm")
    for axes in (left, right):
        axes.legend()
        axes.set_xlabel("radius of the curves, m")
    return figure


def measured_propagation(findings: Findings) -> Figure:
    fine = np.geomspace(0.3, 30.0, 600)
    figure, (axes,) = _panels(1, 1, 4.2)
    paper = propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_SPEED)
    text = "G(jω), the paper's: steering by the difference of states"
    axes.semilogx(fine, np.abs(paper.at(fine)), color=RED, label=text)
    text = "F(jω): steering along the predecessor's path"
    axes.plot(fine, np.abs(EMPTY.at(fine)), color=BLUE, linestyle="--", label=text)
    for preview, colour in ((PREVIEW_S, GREEN), (SHORT_PREVIEW_S, PURPLE)):
        frequencies, ratios = findings.ratios(preview)
        text = f"measured in the convoy, preview of {preview:g} s, all cars"
        axes.plot(frequencies, ratios, "o", color=colour, markersize=4.0)
        axes.plot(frequencies, ratios.mean(axis=1), color=colour, linewidth=1.0, label=text)
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("frequency, rad/s")
    axes.set_ylabel("amplitude over that of the car ahead")
    axes.legend(loc="upper left")
    return figure


Draw = Callable[[Findings], Figure]

PICTURES: Mapping[str, tuple[Sequence[str], Draw]] = {
    **{
        name: ([panel.key for panel in panels], partial(over_time, panels))
        for name, panels in PANELS.items()
    },
    "maxima": (("base",), maxima),
    "along_the_convoy": (
        ("base", *map(at_alpha, ALPHAS), "noise_along/with/noise/1", "noise_along/without/noise/1"),
        along_the_convoy,
    ),
    "radius": (tuple(map(at_radius, RADII)), radius),
    "propagation": (("propagation",), measured_propagation),
}
"""Needs of each picture, and the function that draws it."""

CAPTIONS = {
    "road": "The road of the main cases, which the paper does not specify (height exaggerated).",
    "errors_base": "Tracking errors in the base case.",
    "errors_a_to_d": "Tracking errors in scenarios A to D.",
    "errors_variable_speed": "Tracking errors while the speed changes in both lane changes.",
    "maxima": "Largest errors: exact (bars), on shifted roads (dashes), and with receiver noise "
    "(dots). Noisy runs of some cases cover the first lane change only.",
    "lead_data": "With the predecessor's data only, true errors grow from car to car, which "
    "tracking errors hardly show. With the lead's data, true errors level off.",
    "along_the_convoy": "Eight cars: errors with and without the lead's data, true errors for "
    "several weights α, simulated and (dotted) by linear theory, which neglects the fit; and noise "
    "of receivers on a straight.",
    "radius": "Largest errors over the radius of the curves, first lane change.",
    "propagation": "The paper's G(jω) and F(jω) in closed form, and measured ratios of the convoy, "
    "which follow F at low frequencies. At high frequencies the fit smooths the path (at 7 rad/s a "
    "wavelength is 27 m); a shorter preview smooths less.",
    "field": "Field experiment: PL2 follows PL1, PL3 follows both or PL2 only.",
}


def draw_all(findings: Mapping[Trajectory, Findings], picture_format: str) -> dict[str, Figure]:
    """Draw every picture for which there are results, by file name."""
    with mpl.rc_context(STYLE):
        return {
            f"{name}_{kind}.{picture_format}": draw(results)
            for name, (needs, draw) in PICTURES.items()
            for kind, results in findings.items()
            if results.has(*needs)
        }
