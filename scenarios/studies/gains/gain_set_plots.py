"""Plots of stabilising gain sets (paper, sections III-F and V-A). Needs matplotlib."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from scenarios.studies.gains.results import Subject
from scenarios.studies.picture_style import PAGE_IN, RED, SEQUENCE
from vehicles.car.parameters import Gains
from vehicles.theory.gain_sets import boundary_curve, gain_extremes, stabilises_all
from vehicles.theory.linear_model import affine_coefficients
from vehicles.theory.polynomials import spectral_abscissa

Array = NDArray[np.float64]

LATERAL, HEADING = "$k_e$, rad/m", r"$k_\theta$, rad/rad"

ALL_SPEEDS, ALL_LOADINGS = "#cfe3f3", "#8fbfe0"


def _grid(lateral: Array, heading: Array, yaw_rate: float) -> Array:
    """Gains at one k_omega, shape (k_theta, k_e, 3) as contours take them."""
    k_e, k_theta = np.meshgrid(lateral, heading)
    return np.stack([k_e, k_theta, np.full_like(k_e, yaw_rate)], axis=-1)


def _decay(subject: Subject, lateral: Array, heading: Array, yaw_rate: float) -> Array:
    """Decay of the slowest root (1/s) on a grid [k_theta, k_e] at the reference speed."""
    constant, slopes = affine_coefficients(subject.parameters, subject.reference)
    gains = _grid(lateral, heading, yaw_rate)
    return -spectral_abscissa(constant + np.einsum("ijk,nk->ijn", gains, slopes))


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
