"""The shipped fusions and reactions by their names."""

from collections.abc import Mapping

from vehicles.driver.reactions import Degrade, Extrapolate, Hold, ReactionPolicy, Straight
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.fusion import BlendFusion, CompositeFusion, SourceFusion, Trajectories
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import LEAD, PREDECESSOR, Fit, SourceWindow, fit_composite

FUSION_OF: Mapping[str, SourceFusion] = {"composite": CompositeFusion(), "blend": BlendFusion()}
FUSIONS = ["predecessor", *FUSION_OF]
"""Fusions of a test follower; with "predecessor" that is its only lateral source."""
REACTION_OF: Mapping[str, ReactionPolicy] = {
    "degrade": Degrade(),
    "extrapolate": Extrapolate(),
    "hold": Hold(),
    "straight": Straight(),
}


def fuse(
    fusion: str,
    lead: Window | None,
    predecessor: Window | None,
    *,
    alpha: float,
    settings: FitSettings,
) -> Trajectories:
    return FUSION_OF[fusion].fuse(windows_of(lead, predecessor, alpha), settings)


def fit_two(
    lead: Window | None, predecessor: Window | None, *, alpha: float, settings: FitSettings
) -> Fit | None:
    return fit_composite(windows_of(lead, predecessor, alpha), settings)


def windows_of(lead: Window | None, predecessor: Window | None, alpha: float) -> list[SourceWindow]:
    of_lead = [] if lead is None else [SourceWindow(LEAD, 1.0 - alpha, lead)]
    return of_lead + (
        [] if predecessor is None else [SourceWindow(PREDECESSOR, alpha, predecessor)]
    )
