"""Layout of the picture of a convoy: entities, colours and views.

Entities are named by quantity first and vehicle last, because a view contains whole branches:

    world/                              east, north in metres, as in the messages
      plan, convoy                      frames of both plan views: north up, moving with the convoy
      road, driven, trajectory, samples, events, cars, convoy/names
    plots/<quantity>/<vehicle>[/<curve>], plots/<quantity>/events/<kind>
    links, messages/<sender>_to_<receiver>    states of each half second and of each message
    sources/<vehicle>/<source>, mode/<vehicle>, log/<vehicle>, legend

In a picture of several runs a vehicle has the name `<vehicle>_<run>`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from transport.panels import PANELS, ROWS, Panel, Row, colour_of
from transport.picture.batch import Floats, Road, RunScene
from transport.picture.rows import TIMELINE, MarkStyle

MAX_ALL_DETAILED = 12  # Largest convoy of which all vehicles are drawn in detail
DETAILED = 8  # Number of vehicles of a longer convoy that are drawn in detail
SHOWN_ABOUT = 5  # Vehicles ahead of and behind the followed one in the view of a longer convoy


def detailed(vehicles: Sequence[str]) -> tuple[str, ...]:
    """Vehicles with all their curves, lead first.

    More curves cannot be distinguished. Those of a long convoy are evenly spread over it and
    include its first and last vehicle; of the others only positions, errors and gaps are drawn.
    """
    if len(vehicles) <= MAX_ALL_DETAILED:
        return tuple(vehicles)
    last = len(vehicles) - 1
    return tuple(vehicles[round(k * last / (DETAILED - 1))] for k in range(DETAILED))


# ---- Colours and sizes


MARGIN_M = 6.0  # Margin of the moving view around the centre of a car
FEW_VEHICLES = 5  # Largest convoy whose links and modes share one view
MIN_TAG_M, TAG_PX = 4.0, 34.0  # Distance of a tag from its car, on the screen half its length
VIEW_WIDTH_PX, VIEW_HEIGHT_PX = 888.0, 260.0  # Least size of plans in 1600 × 1000
LEGEND_WIDTH, LEGEND_HEIGHT = 100.0, 7.4  # In its own unit, nearly nine pixels of 1600
WORST = (0x00, 0xB4, 0xC8)

EVENTS: dict[str, MarkStyle] = {
    "own": ((0xF0, 0x30, 0x90), "Right", 5.0),
    "overridden": ((0x8A, 0x8A, 0x50), "Circle", 5.0),
    "overspeed": ((0x00, 0x82, 0x64), "Up", 5.0),
    "hard_braking": ((0xB4, 0x64, 0x00), "Down", 6.0),
    "falls_behind": ((0xA0, 0x50, 0xC8), "Right", 6.0),
    "stranded": ((0xC8, 0x96, 0x00), "Cross", 7.0),
    "distrust": ((0x69, 0x00, 0xF0), "Plus", 6.0),
    "slide": ((0x00, 0xC3, 0xFF), "Down", 5.0),
    "stop": ((0xC3, 0x00, 0x4B), "Cross", 6.0),
    "path_lost": ((0x00, 0xD2, 0x00), "Square", 4.0),
    "lane_departure": ((0xFF, 0x00, 0xFF), "Up", 7.0),
    "near_miss": ((0xFF, 0x96, 0x69), "Diamond", 7.0),
    "collision": ((0xFF, 0x00, 0x00), "Asterisk", 10.0),
}
"""Colours of events, readable on dark and light backgrounds and unlike those of the cars, and their
shapes and sizes in the plots; the worst comes last and so above the others."""
MARKS: dict[str, MarkStyle] = {"change": ((0x00, 0x3C, 0xFF), "Circle", 5.0), **EVENTS}


class Reach(NamedTuple):
    """Range (m) of the moving view around the vehicle that it follows."""

    behind: float
    ahead: float
    lateral: float

    @classmethod
    def of(cls, scene: RunScene) -> "Reach":
        """Return the range for the vehicles of a scene, or some of a long convoy."""
        count = len(scene.vehicles)
        shown = count if count <= MAX_ALL_DETAILED else 2 * SHOWN_ABOUT + 1
        ahead = shown // 2 * scene.spacing_m
        behind = (shown - 1) * scene.spacing_m - ahead
        lateral = 8.0 if _is_flat(scene.path) else min(max(8.0, 0.5 * (ahead + behind)), 25.0)
        return cls(behind + 12.0, ahead + 20.0, lateral)

    @property
    def tag_m(self) -> float:
        """Distance of name tags from their cars (m)."""
        width, height = self.behind + self.ahead, 2.0 * self.lateral
        return max(MIN_TAG_M, TAG_PX * max(width / VIEW_WIDTH_PX, height / VIEW_HEIGHT_PX))

    def zooms_for(self, ahead: Floats, left: Floats) -> Floats:
        """Factors by which the range has to grow to contain points (m), at least 1."""
        along = np.maximum(ahead / (self.ahead - MARGIN_M), -ahead / (self.behind - MARGIN_M))
        across = np.abs(left) / (self.lateral - 0.5 * MARGIN_M)
        return np.maximum(np.maximum(along, across), 1.0)

    @property
    def bounds(self) -> rrb.VisualBounds2D:
        return rrb.VisualBounds2D(
            x_range=[-self.behind, self.ahead], y_range=[-self.lateral, self.lateral]
        )


def plan_tag_m(road: Road) -> float:
    """Distance of the lead's name tag from its dot in the plan (m)."""
    return 1.2 * TAG_PX * max(_size(road)) / VIEW_WIDTH_PX


def bounds_of(road: Road, margin_ratio: float) -> rrb.VisualBounds2D:
    """Bounds of the road with a margin; the second axis of a picture points down."""
    (east, north), margin = road, margin_ratio * max(_size(road))
    return rrb.VisualBounds2D(
        x_range=[min(east) - margin, max(east) + margin],
        y_range=[-max(north) - margin, -min(north) + margin],
    )


def _size(road: Road) -> tuple[float, float]:
    """Width and height of a road (m)."""
    east, north = road
    return max(east) - min(east), max(north) - min(north)


def _is_flat(road: Road) -> bool:
    """Whether a road is at least four times as wide as high, so that a low view suffices."""
    width, height = _size(road)
    return width >= 4.0 * height


# ---- Blueprint of one run


@dataclass(frozen=True, slots=True)
class RunExtent:
    """Duration of a run (s), its vehicles with problems, the worst first, and its worst links."""

    duration_s: float
    vehicles: Sequence[str] = ()
    links: Sequence[str] = ()
    has_other_links: bool = True


def blueprint(scene: RunScene, extent: RunExtent) -> rrb.Blueprint:
    """Layout for the vehicles of a scene."""
    shares = [4, 2, 0.72, 3] if _is_flat(scene.path) else [3, 3.5, 0.72, 2.5]
    rows = [(row, tabs) for row in ROWS if (tabs := _tabs(row, scene, extent))]
    views = [_convoy_view(scene), _plan_view(scene), _legend_view(), _log_view()]
    left = rrb.Vertical(*views, row_shares=shares)
    right = rrb.Vertical(*(tabs for _, tabs in rows), row_shares=[row.share for row, _ in rows])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[5, 4]),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    )


def _convoy_view(scene: RunScene) -> rrb.Spatial2DView:
    """Follow the middle of the convoy, the direction of travel to the right."""
    dots = [f"- /world/cars/{name}/dot" for name in scene.vehicles]
    return rrb.Spatial2DView(
        name="Convoy (driving to the right)",
        origin="world/convoy",
        contents=["/world/**", *dots, f"- /world/cars/{scene.vehicles[0]}/plan_name"],
        visual_bounds=Reach.of(scene).bounds,
        overrides=_all_until_now(scene.vehicles),
    )


def _plan_view(scene: RunScene) -> rrb.Spatial2DView:
    """Show the convoy on the road, as dots where cars would be too small."""
    small = scene.spacing_m < 0.04 * max(_size(scene.path))
    hidden = [f"- /world/cars/{name}/worst/name" for name in scene.vehicles]
    hidden += [f"- /world/cars/{name}/dot" for name in scene.vehicles if not small]
    hidden += [f"- /world/events/{kind}/name" for kind in MARKS]
    hidden += [f"- /world/{branch}" for branch in ("road/marks", "samples/**", "convoy/**")]
    return rrb.Spatial2DView(
        name="Plan (north up)",
        origin="world/plan",
        contents=["/world/**", *hidden],
        visual_bounds=bounds_of(scene.path, 0.04 if small else 0.12),
        overrides=_all_until_now(scene.vehicles),
    )


def _legend_view() -> rrb.Spatial2DView:
    """Colours of vehicles, curves and marks, in a strip of its own."""
    return rrb.Spatial2DView(
        name="Legend",
        titlebar=False,
        origin="legend",
        visual_bounds=rrb.VisualBounds2D(x_range=[0.0, LEGEND_WIDTH], y_range=[0.0, LEGEND_HEIGHT]),
    )


def _log_view() -> rrb.TextLogView:
    """Log lines, which begin with their time: the viewer's own column cuts long times."""
    kinds = (encodings.TextLogColumnKind.LogLevel, encodings.TextLogColumnKind.Body)
    columns = rrb.TextLogColumns(
        timeline_columns=[encodings.TimelineColumn(TIMELINE, visible=False)],
        text_log_columns=[encodings.TextLogColumn(kind) for kind in kinds],
    )
    body = rrb.TextLogFormat(monospace_body=True)
    return rrb.TextLogView(name="Log", origin="log", format_options=body, columns=columns)


def _all_until_now(vehicles: Sequence[str]) -> dict[Any, Any]:
    """Show driven paths and events up to the time cursor."""
    start, end = rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.cursor_relative()
    ranges = [
        rr.VisibleTimeRange(timeline, start=start, end=end) for timeline in (TIMELINE, "time")
    ]
    entities = [f"world/driven/{name}" for name in vehicles]
    entities += [f"world/events/{kind}" for kind in MARKS]
    return {entity: rrb.VisibleTimeRanges(ranges) for entity in entities}


def _tabs(row: Row, scene: RunScene, extent: RunExtent) -> rrb.Tabs | None:
    """Panels of a row; None without any.

    Of panels by follower those of vehicles with problems come first, and the others share one. Of
    links those with problems come first.
    """
    tabs: list[rrb.View] = []
    joint = [PANELS[name] for name in row.joint if len(scene.vehicles) <= FEW_VEHICLES]
    for panel in row.panels:
        match panel.kind:
            case "plot":
                tabs.append(_plot(panel, extent))
            case "states":
                tabs += _strips(panel, joint, scene.vehicles[0], extent)
            case "plot_of_one":
                tabs += _plots_of_followers(panel, scene, extent)
    return rrb.Tabs(*tabs, active_tab=0) if tabs else None


def _plot(
    panel: Panel, extent: RunExtent, vehicle: str = "", **contents: Any
) -> rrb.TimeSeriesView:
    """Plot of all vehicles, or of one, without its own legend, which covers data."""
    arguments = {"name": panel.heading(vehicle), **contents}
    return rrb.TimeSeriesView(
        origin=f"plots/{panel.name}/{vehicle}".rstrip("/"),
        plot_legend=rrb.PlotLegend(visible=False),
        axis_x=_whole_run(extent.duration_s),
        **arguments,
    )


def _plots_of_followers(panel: Panel, scene: RunScene, extent: RunExtent) -> list[rrb.View]:
    names = detailed(scene.vehicles)
    followers = names[1:]
    single = [name for name in extent.vehicles if name in followers]
    single = single or [name for name in followers if name == names[len(names) // 2]]
    tabs: list[rrb.View] = [_plot(panel, extent, name) for name in single]
    others = [name for name in followers if name not in single]
    if others:
        # One curve of each vehicle in its colour; in the plot of a single one they have their own.
        curve, convoy = panel.series[-1], list(scene.convoy)
        shown = {f"plots/{panel.name}/{name}/{curve.name}": name for name in others}
        styles = {
            entity: rr.SeriesLines(colors=[colour_of(convoy.index(name))], names=[name])
            for entity, name in shown.items()
        }
        title = f"{curve.label.capitalize()} of the others ({panel.unit})"
        contents = [f"/{entity}" for entity in shown]
        tabs.append(_plot(panel, extent, name=title, contents=contents, overrides=styles))
    return tabs


def _strips(
    panel: Panel, joint: Sequence[Panel], lead: str, extent: RunExtent
) -> list[rrb.StateTimelineView]:
    """Strips of a panel, or of all of `joint` for its first one; links with problems come first."""
    panels = joint if joint and panel is joint[0] else [panel]
    first, *more = (one.heading("") for one in panels)
    further = "".join(f" and {title.lower()}" for title in more)
    if panel.name != "links" or not extent.links:
        return [_timeline(first + further, _branches(panels, lead), extent)]
    troubled = [f"/links/{link}" for link in extent.links]
    others = ["/links/**", *(f"- {link}" for link in troubled)]
    worst = troubled + _branches(panels[1:], lead)
    views = [_timeline(f"Worst links{further}", worst, extent)]
    return views + [_timeline("Other links", others, extent)] * extent.has_other_links


def _branches(panels: Sequence[Panel], lead: str) -> list[str]:
    shown = [f"/{panel.name}/**" for panel in panels]
    return shown + [f"- /{panel.name}/{lead}" for panel in panels if panel.lead == "hidden"]


def _timeline(name: str, contents: Sequence[str], extent: RunExtent) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(
        name=name, origin="/", contents=contents, time_view=_whole_run(extent.duration_s)
    )


def _whole_run(duration_s: float) -> rrb.TimeAxis:
    """Time axis of the whole run."""
    start = rr.TimeRangeBoundary.absolute(seconds=0.0)
    end = rr.TimeRangeBoundary.absolute(seconds=duration_s)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
