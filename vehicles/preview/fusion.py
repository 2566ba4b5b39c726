"""Fusion of the sources of a follower: interface, and the shipped classes."""

from collections.abc import Sequence
from typing import ClassVar, Final, Protocol

from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.trajectory import Fit, SourceWindow, fit_composite

Trajectories = Sequence[tuple[float, Fit]]  # With shares of the command; empty without one


class SourceFusion(Protocol):
    """Interface of a fusion, which makes trajectories from received poses (Section III-A).

    Each follower has its own instance, constructed as `Class()`, with its parameters.
    A follower with one lateral source always fits a composite trajectory. `fuse` is called after
    new poses, and at least every 50 ms. It must not use a clock.

    A class may set `separate = True` if it returns a trajectory for each source, whose errors are
    then followed up separately.
    """

    def fuse(self, sources: Sequence[SourceWindow], settings: FitSettings) -> Trajectories:
        """Trajectories as a list of (share, fit), the shares adding up to 1; empty without one.

        `sources` are the lateral ones of [information_flow] that are received, from front to back.
        Each has its `place` (0 the lead, k the k-th vehicle ahead, 1 the predecessor), its `weight`
        (by `control.alpha_ratio`, less while a source is late or has just returned) and its
        `window`: the received positions around the car in order of travel, as arrays `east`,
        `north` and `station` (m, along the path, from the car). `fit_composite` of
        `vehicles.preview.trajectory` returns a fit.
        """
        ...


class CompositeFusion:
    """One trajectory through the poses of all sources (Section III-A)."""

    separate: ClassVar[bool] = False

    def fuse(self, sources: Sequence[SourceWindow], settings: FitSettings) -> Trajectories:
        fit = fit_composite(sources, settings)
        return () if fit is None else ((1.0, fit),)


class BlendFusion:
    """A trajectory for each source, whose steering commands are blended by the weights."""

    separate: ClassVar[bool] = True

    def fuse(self, sources: Sequence[SourceWindow], settings: FitSettings) -> Trajectories:
        fits = [(source.weight, fit_composite([source], settings)) for source in sources]
        found = [(weight, fit) for weight, fit in fits if fit is not None]
        if len(found) == 1:
            return ((1.0, found[0][1]),)
        total = sum([weight for weight, _ in found])
        return tuple([(weight / total, fit) for weight, fit in found if weight > 0.0])


BEND_RATIO: Final = 1.5
BEND_MARGIN: Final = 1.5
"""A fit follows noise if its lateral acceleration exceeds that of the measured bends by this ratio
and margin (m/s²)."""


def fused(
    fusion: SourceFusion,
    sources: Sequence[SourceWindow],
    settings: FitSettings,
    bend: float,
    speed: float,
) -> tuple[tuple[float, Fit], ...]:
    """Trajectories of Section III-A, straight lines if others would follow noise.

    `bend` (1/m) is the largest recent curvature by the yaw rates of the sources. A few samples far
    apart may lie on a much narrower arc, on which the car would slide at its `speed` (m/s).
    """
    found = tuple(fusion.fuse(sources, settings))
    curvatures = [abs(piece.curvature) for _, fit in found for piece in fit.spline.pieces]
    most = BEND_RATIO * bend + BEND_MARGIN / max(speed, 1.0) ** 2
    if settings.trajectory != "fitted" or max(curvatures, default=0.0) <= most:
        return found
    return tuple(fusion.fuse(sources, settings.beside_bridge(0)))
