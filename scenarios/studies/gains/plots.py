"""Plots of stabilising gain sets (paper, sections III-F and V-A)."""

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from scenarios.results.figure_style import (
    BLUE,
    GREEN,
    GREY,
    PAGE_IN,
    RED,
    SEQUENCE,
    STYLE,
)
from scenarios.studies.gains.results import Subject
from scenarios.studies.job import write_files
from vehicles.car.parameters import Gains
from vehicles.theory.gain_sets import (
    boundary_curve,
    gain_extremes,
    spectral_abscissa,
    stabilises_all,
)
from vehicles.theory.linear_model import (
    chain_offsets,
    characteristic_polynomial,
    propagation,
    trace_propagation,
)

Array = NDArray[np.float64]

LATERAL, HEADING = "$k_e$, rad/m", r"$k_\theta$, rad/rad"

ALL_SPEEDS, ALL_LOADINGS = "#cfe3f3", "#8fbfe0"


def _grid(lateral: Array, heading: Array, yaw_rate: float) -> Array:
    """Gains at one k_omega, shape (k_theta, k_e, 3) as contours take them."""
    k_e, k_theta = np.meshgrid(lateral, heading)
    return np.stack([k_e, k_theta, np.full_like(k_e, yaw_rate)], axis=-1)


def _decay(subject: Subject, lateral: Array, heading: Array, yaw_rate: float) -> Array:
    """Decay of the slowest root (1/s) on a grid [k_theta, k_e] at the reference speed."""
    gains = _grid(lateral, heading, yaw_rate)
    return -spectral_abscissa(
        characteristic_polynomial(subject.parameters, gains, subject.reference)
    )


def _boundary(subject: Subject, speed: float, yaw_rate: float, size: Array) -> Array:
    """Boundary curve of the set at one speed and k_omega; NaN where both sides are alike.

    D-decomposition also gives curves between two unstable regions. `size` is the picture's extent
    in (k_e, k_theta); membership is tested 0.2 % of it to either side.
    """
    curve = boundary_curve(subject.parameters, speed, yaw_rate, np.geomspace(0.02, 90.0, 16_000))
    along = np.gradient(curve / size, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    sides = []
    for offset in (0.002, -0.002):
        beside = np.column_stack([curve + offset * across * size, np.full(len(curve), yaw_rate)])
        sides.append(stabilises_all([subject.parameters], [speed], beside))
    return np.where((sides[0] != sides[1])[:, None], curve, np.nan)


def _extent(subject: Subject, speeds: Sequence[float]) -> tuple[tuple[float, float], ...]:
    """Least and greatest k_e, k_theta and k_omega of the unloaded car's set."""
    extremes = gain_extremes([subject.parameters], speeds)
    return tuple((least[k], most[k]) for k, (least, most) in enumerate(extremes))


def _mark(axes: Axes, gains: Gains) -> None:
    axes.plot(
        gains.lateral,
        gains.heading,
        marker="*",
        markersize=11,
        color=RED,
        markeredgecolor="white",
        linestyle="none",
        label="chosen gains",
        zorder=5,
    )


def stabilising_slices(subject: Subject) -> Figure:
    """Slices of the stabilising set at several k_omega, shaded by how fast errors decay."""
    (_, k_e), (low, high), (first, last) = _extent(subject, [subject.reference])
    k_e, low, high = 1.05 * k_e, low - 0.05 * high, 1.05 * high
    lateral, heading = np.linspace(0.0, k_e, 90), np.linspace(low, high, 90)
    cuts = np.linspace(first + 0.2 * (last - first), last - 0.12 * (last - first), 6)
    cuts[np.argmin(np.abs(cuts - subject.gains.yaw_rate))] = subject.gains.yaw_rate
    figure = Figure(figsize=(PAGE_IN, 4.8), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    decays = [_decay(subject, lateral, heading, cut) for cut in cuts.tolist()]
    fastest = max(float(decay.max()) for decay in decays)
    levels = MaxNLocator(12).tick_values(0.0, max(fastest, 0.1))
    for axes, cut, decay in zip(panels.flat, cuts.tolist(), decays, strict=True):
        shades = axes.contourf(lateral, heading, decay, levels=levels, cmap=SEQUENCE)
        curve = _boundary(subject, subject.reference, cut, np.array([k_e, high - low]))
        axes.plot(curve[:, 0], curve[:, 1], color="black", linewidth=1.2)
        axes.axvline(0.0, color="black", linewidth=1.2)
        chosen = cut == subject.gains.yaw_rate
        if chosen:
            _mark(axes, subject.gains)
        title = rf"$k_\omega$ = {cut:.3f} s" + (" (chosen)" if chosen else "")
        axes.set_title(title, color=RED if chosen else "black")
    axes.set_xlim(-0.02 * k_e, k_e)
    axes.set_ylim(low, high)
    for axes in panels[1]:
        axes.set_xlabel(LATERAL)
    for axes in panels[:, 0]:
        axes.set_ylabel(HEADING)
    bar = figure.colorbar(shades, ax=panels, shrink=0.8)
    bar.set_label("decay of the slowest root, 1/s")
    figure.suptitle(
        f"Stabilising gains at {subject.reference:.4g} m/s; black: boundary by D-decomposition"
    )
    return figure


def intersection(subject: Subject) -> Figure:
    (_, k_e), (low, high), _ = _extent(subject, subject.speeds)
    k_e, low, high = 1.25 * k_e, min(low, -0.3), 1.15 * high
    lateral, heading = np.linspace(0.0, k_e, 260), np.linspace(low, high, 260)
    gains = _grid(lateral, heading, subject.gains.yaw_rate)
    figure = Figure(figsize=(0.75 * PAGE_IN, 3.6), layout="constrained")
    axes = figure.subplots()
    for cars, shade, label in (
        ([subject.parameters], ALL_SPEEDS, "all speeds"),
        (subject.cars, ALL_LOADINGS, "all speeds and loadings"),
    ):
        inside = stabilises_all(cars, subject.speeds, gains)
        axes.contourf(lateral, heading, inside, levels=[0.5, 1.5], colors=[shade])
        axes.fill([], [], color=shade, label=label)
    size = np.array([k_e, high - low])
    for index, speed in enumerate(subject.speeds):
        curve = _boundary(subject, speed, subject.gains.yaw_rate, size)
        colour = mpl.colormaps[SEQUENCE](0.92 * index / max(1, len(subject.speeds) - 1))
        axes.plot(curve[:, 0], curve[:, 1], color=colour, label=f"{speed:.1f} m/s")
    _mark(axes, subject.gains)
    axes.set_xlim(0.0, k_e)
    axes.set_ylim(low, high)
    axes.set_xlabel(LATERAL)
    axes.set_ylabel(HEADING)
    axes.set_title(rf"Gains that stabilise every case, at $k_\omega$ = {subject.gains.yaw_rate} s")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


# ---- Plots of the gains report: its curves, and the list of all


SINE_FREQUENCY = 0.4 * np.pi
"""Frequency (rad/s) of the lead's sine: 0.2 Hz, as in a lane change of 5 s."""

SLOW_ROOTS = 10.0
"""Imaginary part (rad/s) below which a root belongs to the path, not to the steering."""


def error_propagation(subject: Subject) -> Figure:
    """|G(j w)| from car to car, and what the lead's data change."""
    figure = Figure(figsize=(PAGE_IN, 3.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_propagation(left, subject)
    _draw_chain(right, subject)
    return figure


def _draw_propagation(axes: Axes, subject: Subject) -> None:
    """|G| over frequency at the slowest, a middle and the reference speed (section IV-B)."""
    frequencies = np.geomspace(0.05, 60.0, 900)
    speeds = (subject.speeds[0], subject.speeds[len(subject.speeds) // 2], subject.reference)
    for index, speed in enumerate(dict.fromkeys(speeds)):
        colour = mpl.colormaps[SEQUENCE](0.4 * index)
        plain = propagation(subject.parameters, subject.gains, speed, "instantaneous")
        axes.semilogx(frequencies, np.abs(plain.at(frequencies)), color=colour, linestyle=":")
        lagging = propagation(subject.parameters, subject.gains, speed)
        label = f"{speed:.1f} m/s"
        axes.semilogx(frequencies, np.abs(lagging.at(frequencies)), color=colour, label=label)
    axes.plot([], [], color=GREY, linestyle=":", label="without steering lag")
    axes.axhline(1.0, color=GREY, linewidth=1.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("frequency, rad/s")
    axes.set_ylabel("|G|: error over the predecessor's")
    axes.set_title("Predecessor only: errors grow if |G| > 1")
    axes.legend(loc="upper left")


def _draw_chain(axes: Axes, subject: Subject) -> None:
    """Distance from the lead's path along the convoy when the lead drives a sine."""
    trace = trace_propagation(subject.parameters, subject.gains, subject.reference)
    followers = np.arange(1, 9)
    for alpha, label, colour, marker in (
        (1.0, r"predecessor only ($\alpha$ = 1)", RED, "o"),
        (0.5, r"composite ($\alpha$ = 0.5)", BLUE, "s"),
        (0.0, r"lead only ($\alpha$ = 0)", GREEN, "^"),
    ):
        distance = np.abs(chain_offsets(trace, np.array([SINE_FREQUENCY]), alpha, len(followers)))[
            :, 0
        ]
        axes.plot(
            followers, 100.0 * distance, color=colour, marker=marker, markersize=4.5, label=label
        )
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("follower")
    axes.set_ylabel("distance from the lead's path, cm")
    axes.set_title(
        f"Lead sine of 1 m, {SINE_FREQUENCY / (2.0 * np.pi):.1f} Hz, {subject.reference:.4g} m/s"
    )
    axes.legend(loc="upper left")


def roots_over_loadings(subject: Subject) -> Figure:
    """Roots of Delta(s, K) for every loading at the reference speed (paper, section V-B)."""
    figure = Figure(figsize=(PAGE_IN, 3.0), layout="constrained")
    panels = figure.subplots(1, 2)
    cars = subject.cars
    polynomials = [characteristic_polynomial(car, subject.gains, subject.reference) for car in cars]
    roots = np.array([[(root.real, root.imag) for root in np.roots(row)] for row in polynomials])
    masses = np.broadcast_to([[car.mass] for car in cars], roots.shape[:2])
    for axes in panels:
        dots = axes.scatter(
            roots[..., 0],
            roots[..., 1],
            c=masses,
            cmap=SEQUENCE,
            s=26,
            edgecolor="white",
            linewidth=0.4,
            zorder=3,
        )
        axes.axvline(0.0, color=RED, linewidth=1.0)
        axes.set_xlabel("real part, 1/s")
    panels[0].set_ylabel("imaginary part, rad/s")
    panels[0].set_title("All roots")
    slow = np.abs(roots[..., 1]) < SLOW_ROOTS
    left = 1.3 * min(float(roots[..., 0].max(axis=1).min()), -0.5)
    shown = roots[slow & (roots[..., 0] > left)]
    height = 1.5 * float(np.abs(shown[:, 1]).max()) + 0.1 if len(shown) else SLOW_ROOTS
    panels[1].set_xlim(left, max(0.3, 1.2 * float(roots[..., 0].max())))
    panels[1].set_ylim(-height, height)
    panels[1].set_title("Close to the origin")
    bar = figure.colorbar(dots, ax=panels)
    bar.set_label("mass, kg")
    figure.suptitle(f"Roots of the closed loop over loadings at {subject.reference:.4g} m/s")
    return figure


FIGURES: dict[str, Callable[[Subject], Figure]] = {
    "stabilising_slices": stabilising_slices,
    "intersection": intersection,
    "propagation": error_propagation,
    "roots_over_loadings": roots_over_loadings,
}
NAMES = tuple(FIGURES)


def draw_all(subject: Subject, out_dir: Path, picture_format: str) -> tuple[str, ...]:
    """Write all plots; returns the names of the files."""
    with mpl.rc_context(STYLE):
        figures = {name: draw(subject) for name, draw in FIGURES.items()}
    files = {f"{name}.{picture_format}": figure for name, figure in figures.items()}
    write_files(out_dir, files)
    return tuple(files)
