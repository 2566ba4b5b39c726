"""Plots of the report on the paper's experiments."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.results.drives import Trial
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
    BASE,
    BASE_SPEED,
    FIELD_WITH,
    FIELD_WITHOUT,
    LONG_WITH,
    LONG_WITHOUT,
    NO_LEAD_DATA,
    NOISE_WITH,
    NOISE_WITHOUT,
    PREVIEW_S,
    RADII,
    SHORT_PREVIEW_S,
    SIMULATIONS,
    VARIABLE_SPEED,
    A,
    B,
    C,
    D,
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
TRACKING, TRUE = "lateral_error", "cross_track"
"""Errors of a `Drive`: to the car's own trajectory, and to the lead's path."""
WORDS = {TRACKING: "off the own trajectory, cm", TRUE: "off the lead's path, cm"}


def _panels(
    rows: int, columns: int, height: float, *, share: bool = False
) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(PAGE_IN, height), layout="constrained")
    axes = figure.subplots(rows, columns, sharey=share, squeeze=False)
    return figure, list(axes.flat)


def _legend(figure: Figure, axes: Axes) -> None:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def _over_time(axes: Axes, trial: Trial, title: str, measure: str = TRACKING) -> None:
    for place, drive in enumerate(trial.drives):
        values = getattr(drive, measure)
        axes.plot(
            drive.at[: len(values)],
            100.0 * values,
            color=COLOURS[place],
            linestyle=DASHES[place],
            linewidth=1.0,
            label=drive.name,
        )
    axes.set_xlabel("time, s")
    axes.set_ylabel(WORDS[measure])
    axes.set_title(title)


def _along(axes: Axes, values: Iterable[float], colour: str, text: str, style: str = "o-") -> None:
    """Plot a figure (m) of each follower over its place."""
    lengths = 100.0 * np.array(list(values))
    cars = range(2, 2 + len(lengths))
    axes.plot(cars, lengths, style, color=colour, markersize=4.0, linewidth=1.2, label=text)
    axes.set_xlabel("car")


def _limit(axes: Axes, value: float, text: str) -> None:
    axes.axhline(value, color=RED, linewidth=0.8, linestyle=":", label=text)


def road(findings: Findings) -> Figure:
    lead = findings.trials[BASE].lead
    figure, (axes,) = _panels(1, 1, 2.4)
    axes.plot(lead.east, lead.north, color=BLUE)
    for second in (5, 10, 20, 25):
        at = int(np.searchsorted(lead.at, second))
        point = (lead.east[at], lead.north[at])
        axes.plot(*point, "o", color=RED, markersize=4)
        axes.annotate(f"{second} s", point, (0, 7), textcoords="offset points", color=RED)
    axes.set_ylim(-4.4, 1.4)
    axes.set_xlabel("along the road, m")
    axes.set_ylabel("to the left, m")
    return figure


def base(findings: Findings) -> Figure:
    figure, (axes,) = _panels(1, 1, 3.4)
    _over_time(axes, findings.trials[BASE], "30 m/s, one passenger in front, three in the rear")
    _limit(axes, -9.0, "the paper's 9 cm")
    _legend(figure, axes)
    return figure


def a_to_d(findings: Findings) -> Figure:
    titles = {
        A: "A: 10 m/s, n_f = 1, n_r = 2",
        B: "B: 10 m/s, n_f = 1, n_r = 0",
        C: "C: 20 m/s, n_f = 1, n_r = 0",
        D: "D: 30 m/s, two heavier cars before two lighter",
    }
    figure, panels = _panels(2, 2, 5.6, share=True)
    for axes, (key, title) in zip(panels, titles.items(), strict=True):
        _over_time(axes, findings.trials[key], title)
    _legend(figure, panels[0])
    return figure


def variable_speed(findings: Findings) -> Figure:
    trial = findings.trials[VARIABLE_SPEED]
    figure, (above, below) = _panels(2, 1, 4.8)
    above.plot(trial.lead.at, trial.lead.speed, color=BLUE)
    above.set_ylabel("speed, m/s")
    _over_time(below, trial, "")
    _legend(figure, below)
    return figure


def field(findings: Findings) -> Figure:
    figure, panels = _panels(1, 5, 3.4)
    for place, drive in enumerate(findings.trials[FIELD_WITH].drives):
        panels[0].plot(drive.east, drive.north, color=COLOURS[place], linestyle=DASHES[place])
    panels[0].set_aspect("equal")
    panels[0].set_title("Course")
    runs = ((FIELD_WITHOUT, "Predecessor only"), (FIELD_WITH, "With lead data"))
    shown = [(key, title, measure) for measure in WORDS for key, title in runs]
    for axes, (key, title, measure) in zip(panels[1:], shown, strict=True):
        _over_time(axes, findings.trials[key], title, measure)
    _legend(figure, panels[1])
    return figure


def lead_data(findings: Findings) -> Figure:
    """True errors without and with the lead's data, and their maxima along eight cars."""
    figure, (left, middle, right) = _panels(1, 3, 3.6)
    _over_time(left, findings.trials[NO_LEAD_DATA], "Without the lead's data", TRUE)
    _over_time(middle, findings.trials[BASE], "With the lead's data", TRUE)
    middle.sharey(left)
    for key, colour, word in ((LONG_WITHOUT, RED, "without"), (LONG_WITH, BLUE, "with")):
        trial = findings.trials[key]
        _along(right, trial.cross_track, colour, f"{word}: off the lead's path")
        _along(right, trial.tracking, colour, f"{word}: off the own trajectory", "s:")
    right.set_title("Largest errors of eight cars, cm")
    right.legend(fontsize=6.0)
    _legend(figure, left)
    return figure


def along_the_convoy(findings: Findings) -> Figure:
    """True errors of eight cars for each α, and noise with and without the lead's data."""
    figure, (left, right) = _panels(1, 2, 3.4)
    for place, alpha in enumerate(ALPHAS):
        run, colour = findings.trials[at_alpha(alpha)], COLOURS[place]
        _along(left, run.cross_track, colour, f"α = {alpha:g}")
        lead, followers = findings.trials[BASE].lead, len(run.followers)
        expected = predict_errors(lead, transfer(), alpha, followers)[1]
        _along(left, expected, colour, "", ":")
    left.set_title("Largest true error in a lane change, cm")
    for key, colour in ((NOISE_WITHOUT, RED), (NOISE_WITH, BLUE)):
        rms = rms_after(AFTER_START_S, *findings.noisy(key))
        _along(right, rms, colour, f"{key.split('/')[1]} the lead's data")
    right.set_title("Noise of receivers on a straight: rms, cm")
    left.set_ylim(0.0, 50.0)  # cars that have lost their path are beyond
    right.set_ylim(bottom=0.0)
    for axes in (left, right):
        axes.legend()
    return figure


def maxima(findings: Findings) -> Figure:
    """Largest errors: exact (bars), with the road moved (dashes), with noise (dots)."""
    cases = [key for key in (*SIMULATIONS, NO_LEAD_DATA) if findings.has(key)]
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
    panels[0].set_ylabel(WORDS[TRACKING])
    panels[1].set_ylabel(WORDS[TRUE])
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
    _limit(left, 9.0, "the paper's 9 cm")
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
    "road": ((BASE,), road),
    "errors_base": ((BASE,), base),
    "errors_a_to_d": ((A, B, C, D), a_to_d),
    "errors_variable_speed": ((VARIABLE_SPEED,), variable_speed),
    "maxima": ((BASE,), maxima),
    "lead_data": ((BASE, NO_LEAD_DATA, LONG_WITH, LONG_WITHOUT), lead_data),
    "along_the_convoy": (
        (BASE, *map(at_alpha, ALPHAS), f"{NOISE_WITH}/noise/1", f"{NOISE_WITHOUT}/noise/1"),
        along_the_convoy,
    ),
    "radius": (tuple(map(at_radius, RADII)), radius),
    "propagation": (("propagation",), measured_propagation),
    "field": ((FIELD_WITH, FIELD_WITHOUT), field),
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
    "along_the_convoy": "Eight cars: true errors for several weights α, simulated and (dotted) by "
    "linear theory, which neglects the fit; and noise of receivers on a straight.",
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
