"""The shipped fusions and reactions by their names."""

from collections.abc import Mapping

from vehicles.driver.reactions import Degrade, Extrapolate, Hold, ReactionPolicy, Straight
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.fusion import (
    BlendFusion,
    CompositeFusion,
    PredecessorFusion,
    SourceFusion,
    Trajectories,
)
from vehicles.preview.received.samples import Window

FUSION_OF: Mapping[str, SourceFusion] = {
    "composite": CompositeFusion(),
    "predecessor": PredecessorFusion(),
    "blend": BlendFusion(),
}
FUSIONS = list(FUSION_OF)
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
    return FUSION_OF[fusion].fuse(lead, predecessor, alpha, settings)
