"""Layout of the picture of several runs.

Entities: `world/…` as in the picture of one run, with the runs' labels below `cars` and `driven`;
`plots/<quantity>/<vehicle>/<run>`, `plots/<quantity>/divergence`, `mode/<vehicle>_<run>`.
"""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from transport.picture.blueprint import TIMELINE, Reach, Road, legend_view

PLACE_TIMELINE = "path_m"  # Whole metres along the path of the first run
PLOTS = {
    "error": "Error from the lead's path (m, left positive)",
    "difference": "Offset minus that of A at the same place (m)",
    "gap": "Gap to the vehicle ahead (m)",
}


def comparison_blueprint(
    vehicles: Sequence[str], *, spacing_m: float, road: Road, runs: int
) -> rrb.Blueprint:
    """Layout for runs of `vehicles`, lead first, that drive about `spacing_m` apart on `road`."""
    reach = Reach.of(len(vehicles), spacing_m, road)
    east, north = road
    margin = 0.04 * max(max(east) - min(east), max(north) - min(north))
    followers = max(len(vehicles) - 1, 1)
    # On another timeline a fixed range would be one of nanoseconds.
    whole = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    time_axis = rrb.TimeAxis(view_range=whole)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial2DView(
                    name="Convoys (driving to the right, A is faded)",
                    origin="world/convoy",
                    contents=["/world/**", "- /world/divergence/name"],
                    visual_bounds=rrb.VisualBounds2D(
                        x_range=[-reach.behind, reach.ahead],
                        y_range=[-reach.lateral, reach.lateral],
                    ),
                ),
                rrb.Spatial2DView(
                    name="Plan (north up)",
                    origin="world/plan",
                    contents=["/world/**", "- /world/names/**"],
                    visual_bounds=rrb.VisualBounds2D(
                        x_range=[min(east) - margin, max(east) + margin],
                        y_range=[-max(north) - margin, -min(north) + margin],
                    ),
                ),
                legend_view(),
                rrb.TextDocumentView(name="Runs", origin="text"),
                row_shares=[3, 3, 0.72, 3],
            ),
            rrb.Vertical(
                *(
                    rrb.TimeSeriesView(
                        name=heading,
                        origin=f"plots/{quantity}",
                        plot_legend=rrb.PlotLegend(visible=False),
                        axis_x=time_axis,
                    )
                    for quantity, heading in PLOTS.items()
                ),
                rrb.StateTimelineView(name="Modes", origin="mode", time_view=time_axis),
                row_shares=[4, 4, 3, min(2.0 + 0.6 * followers * runs, 9.0)],
            ),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    )
