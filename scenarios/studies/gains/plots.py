"""Plots of `convoy paper gains` (paper, sections III-F, IV-B, V-A and V-B)."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from scenarios.results.figure_style import BLUE, GREEN, GREY, PAGE_IN, RED, SEQUENCE, STYLE
from scenarios.studies.gains.subject import PICTURES, Subject
from scenarios.studies.job import write_files
from vehicles.theory.gain_sets import gain_extremes, spectral_abscissa, stabilises_all
from vehicles.theory.linear_model import (
    chain_offsets,
    characteristic_polynomial,
    propagation,
    trace_propagation,
)

Array = NDArray[np.float64]

LATERAL, HEADING = "$k_e$, rad/m", r"$k_\theta$, rad/rad"
ALL_SPEEDS, ALL_LOADINGS = "#cfe3f3", "#8fbfe0"
SINE_FREQUENCY = 0.4 * np.pi
"""Frequency (rad/s) of the lead's sine: 0.2 Hz, as in a lane change of 5 s."""
SLOW_ROOTS = 10.0
"""Imaginary part (rad/s) below which a root belongs to the path, not to the steering."""


def _grid(lateral: Array, heading: Array, yaw_rate: float) -> Array:
    """Gains at one k_omega, shape (k_theta, k_e, 3) as contours take them."""
    k_e, k_theta = np.meshgrid(lateral, heading)
    return np.stack([k_e, k_theta, np.full_like(k_e, yaw_rate)], axis=-1)


def _decay(subject: Subject, speed: float, gains: Array) -> Array:
    """Decay of the slowest root (1/s); its zero is the boundary of the stabilising set."""
    return -spectral_abscissa(characteristic_polynomial(subject.parameters, gains, speed))


def _extent(subject: Subject, speeds: Sequence[float]) -> tuple[tuple[float, float], ...]:
    """Least and greatest k_e, k_theta and k_omega of the unloaded car's set."""
    extremes = gain_extremes([subject.parameters], speeds)
    return tuple((least[k], most[k]) for k, (least, most) in enumerate(extremes))


def _mark(axes: Axes, subject: Subject) -> None:
    point = (subject.gains.lateral, subject.gains.heading)
    axes.plot(*point, "*", markersize=11, color=RED, markeredgecolor="white", label="chosen gains")


def stabilising_slices(subject: Subject) -> Figure:
    """Slices of the stabilising set at several k_omega, shaded by how fast errors decay."""
    (_, k_e), (low, high), (first, last) = _extent(subject, [subject.reference])
    lateral = np.linspace(0.0, 1.05 * k_e, 90)
    heading = np.linspace(low - 0.05 * high, 1.05 * high, 90)
    cuts = np.linspace(first + 0.2 * (last - first), last - 0.12 * (last - first), 6)
    cuts[np.argmin(np.abs(cuts - subject.gains.yaw_rate))] = subject.gains.yaw_rate
    figure = Figure(figsize=(PAGE_IN, 4.8), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    decays = [
        _decay(subject, subject.reference, _grid(lateral, heading, cut)) for cut in cuts.tolist()
    ]
    levels = MaxNLocator(12).tick_values(0.0, max(0.1, *(float(d.max()) for d in decays)))
    for axes, cut, decay in zip(panels.flat, cuts.tolist(), decays, strict=True):
        shades = axes.contourf(lateral, heading, decay, levels=levels, cmap=SEQUENCE)
        axes.contour(lateral, heading, decay, levels=[0.0], colors="black", linewidths=1.2)
        chosen = cut == subject.gains.yaw_rate
        if chosen:
            _mark(axes, subject)
        axes.set_title(rf"$k_\omega$ = {cut:.3f} s", color=RED if chosen else "black")
    for axes in panels[1]:
        axes.set_xlabel(LATERAL)
    for axes in panels[:, 0]:
        axes.set_ylabel(HEADING)
    figure.colorbar(shades, ax=panels, shrink=0.8).set_label("decay of the slowest root, 1/s")
    figure.suptitle(f"Stabilising gains at {subject.reference:.4g} m/s; black: boundary")
    return figure


def intersection(subject: Subject) -> Figure:
    """The set at each speed, and what all speeds and loadings have in common."""
    (_, k_e), (low, high), _ = _extent(subject, subject.speeds)
    lateral = np.linspace(0.0, 1.25 * k_e, 260)
    heading = np.linspace(min(low, -0.3), 1.15 * high, 260)
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
    for index, speed in enumerate(subject.speeds):
        colour = mpl.colormaps[SEQUENCE](0.92 * index / max(1, len(subject.speeds) - 1))
        decay = _decay(subject, speed, gains)
        axes.contour(lateral, heading, decay, levels=[0.0], colors=[colour])
        axes.plot([], [], color=colour, label=f"{speed:.1f} m/s")
    _mark(axes, subject)
    axes.set_xlabel(LATERAL)
    axes.set_ylabel(HEADING)
    axes.set_title(rf"Gains that stabilise every case, at $k_\omega$ = {subject.gains.yaw_rate} s")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def error_propagation(subject: Subject) -> Figure:
    """|G(j w)| from car to car (section IV-B), and what the lead's data change."""
    figure = Figure(figsize=(PAGE_IN, 3.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    frequencies = np.geomspace(0.05, 60.0, 900)
    speeds = (subject.speeds[0], subject.speeds[len(subject.speeds) // 2], subject.reference)
    for index, speed in enumerate(dict.fromkeys(speeds)):
        shade = mpl.colormaps[SEQUENCE](0.4 * index)
        plain = propagation(subject.parameters, subject.gains, speed, "instantaneous")
        left.semilogx(frequencies, np.abs(plain.at(frequencies)), color=shade, linestyle=":")
        lagging = propagation(subject.parameters, subject.gains, speed)
        label = f"{speed:.1f} m/s"
        left.semilogx(frequencies, np.abs(lagging.at(frequencies)), color=shade, label=label)
    left.plot([], [], color=GREY, linestyle=":", label="without steering lag")
    left.axhline(1.0, color=GREY, linewidth=1.0)
    left.set_xlabel("frequency, rad/s")
    left.set_ylabel("|G|: error over the predecessor's")
    left.set_title("Predecessor only: errors grow if |G| > 1")
    trace = trace_propagation(subject.parameters, subject.gains, subject.reference)
    for alpha, label, style, colour in (
        (1.0, r"predecessor only ($\alpha$ = 1)", "o-", RED),
        (0.5, r"composite ($\alpha$ = 0.5)", "s-", BLUE),
        (0.0, r"lead only ($\alpha$ = 0)", "^-", GREEN),
    ):
        distance = np.abs(chain_offsets(trace, np.array([SINE_FREQUENCY]), alpha, 8))[:, 0]
        right.plot(range(1, 9), 100.0 * distance, style, color=colour, markersize=4.5, label=label)
    right.set_xlabel("follower")
    right.set_ylabel("distance from the lead's path, cm")
    right.set_title(f"Lead sine of 1 m, 0.2 Hz, {subject.reference:.4g} m/s")
    for axes in (left, right):
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="upper left")
    return figure


def roots_over_loadings(subject: Subject) -> Figure:
    """Roots of Delta(s, K) for every loading at the reference speed (paper, section V-B)."""
    figure = Figure(figsize=(PAGE_IN, 3.0), layout="constrained")
    panels = figure.subplots(1, 2)
    cars = subject.cars
    polynomials = [characteristic_polynomial(car, subject.gains, subject.reference) for car in cars]
    roots = np.array([[(root.real, root.imag) for root in np.roots(row)] for row in polynomials])
    masses = np.broadcast_to([[car.mass] for car in cars], roots.shape[:2])
    for axes in panels:
        points = (roots[..., 0], roots[..., 1])
        dots = axes.scatter(*points, c=masses, cmap=SEQUENCE, s=26, edgecolor="white", zorder=3)
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
    figure.colorbar(dots, ax=panels).set_label("mass, kg")
    figure.suptitle(f"Roots of the closed loop over loadings at {subject.reference:.4g} m/s")
    return figure


DRAWN = (stabilising_slices, intersection, error_propagation, roots_over_loadings)


def draw_all(subject: Subject, out_dir: Path, picture_format: str) -> list[str]:
    """Write all plots; returns the names of the files."""
    with mpl.rc_context(STYLE):
        figures = [draw(subject) for draw in DRAWN]
    names = [f"{name}.{picture_format}" for name in PICTURES]
    files = dict(zip(names, figures, strict=True))
    write_files(out_dir, files)
    return list(files)
