"""Fusion of the sources of a follower: interface, and the shipped classes."""

from collections.abc import Sequence
from typing import ClassVar, Protocol

from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.received.samples import Window
from vehicles.preview.trajectory import Fit, fit_composite

Trajectories = Sequence[tuple[float, Fit]]
"""Trajectories to steer along, each with its share of the command; empty without one."""


class SourceFusion(Protocol):
    """Interface of a fusion, which makes trajectories from received poses (Section III-A).

    Each follower has its own instance, constructed as `Class()`, with its `settings` if it has any.
    A first follower, which has one source, always fits a composite trajectory. `fuse` is called
    after new poses, and at least every 50 ms. It must not use a clock or draw random numbers.

    A class may set `uses_lead = False` to be given the predecessor only, and `separate = True` if
    it returns a trajectory for each source, whose errors are then followed up separately.
    """

    uses_lead: ClassVar[bool]
    separate: ClassVar[bool]

    def fuse(
        self,
        lead: Window | None,
        predecessor: Window | None,
        alpha: float,
        settings: FitSettings,
    ) -> Trajectories:
        """Trajectories as a list of (share, fit), the shares adding up to 1; empty without one.

        A `Window` has the received positions around the car in order of travel, as arrays `east`,
        `north` and `station` (m, along the path, from the car); None without a source. `alpha` is
        the weight of the predecessor, `control.alpha_ratio`, unless a source is on probation.
        `fit_composite` of `vehicles.preview.trajectory` returns a fit.
        """
        ...


class CompositeFusion:
    """One trajectory through the poses of lead and predecessor (Section III-A)."""

    uses_lead: ClassVar[bool] = True
    separate: ClassVar[bool] = False

    def fuse(
        self,
        lead: Window | None,
        predecessor: Window | None,
        alpha: float,
        settings: FitSettings,
    ) -> Trajectories:
        fit = fit_composite(lead, predecessor, alpha=alpha, settings=settings)
        return () if fit is None else ((1.0, fit),)


class PredecessorFusion:
    """One trajectory without lead data (Section V-D.1)."""

    uses_lead: ClassVar[bool] = False
    separate: ClassVar[bool] = False

    def fuse(
        self,
        lead: Window | None,  # noqa: ARG002 - every fusion is called alike
        predecessor: Window | None,
        alpha: float,
        settings: FitSettings,
    ) -> Trajectories:
        return CompositeFusion().fuse(None, predecessor, alpha, settings)


class BlendFusion:
    """A trajectory for each source, whose steering commands are blended by the weights."""

    uses_lead: ClassVar[bool] = True
    separate: ClassVar[bool] = True

    def fuse(
        self,
        lead: Window | None,
        predecessor: Window | None,
        alpha: float,
        settings: FitSettings,
    ) -> Trajectories:
        of_lead = fit_composite(lead, None, alpha=alpha, settings=settings)
        of_predecessor = fit_composite(None, predecessor, alpha=alpha, settings=settings)
        if of_lead is None or of_predecessor is None:
            return tuple((1.0, fit) for fit in (of_lead, of_predecessor) if fit is not None)
        shares = ((1.0 - alpha, of_lead), (alpha, of_predecessor))
        return tuple((share, fit) for share, fit in shares if share > 0.0)
