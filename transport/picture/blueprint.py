"""Layout of the picture of a convoy: entities, colours and views.

Entities are named by quantity first and vehicle last, because a view contains whole branches:

    world/                  east, north in metres, as in the messages
      plan, convoy          frames of the two plan views: north up, and moving with the convoy
      road/…                the lead's path and its distance marks
      driven/<vehicle>      the path driven
      trajectory/<vehicle>  the composite trajectory
      samples/<vehicle>     the received samples to which it was fitted
      events/<kind>         the places of events
      cars/<vehicle>/…      the car, with a ring if it is furthest off the lead's path
    plots/<quantity>/<vehicle>, plots/<quantity>/events/<kind>
    plots/closing/<vehicle>/<curve>    the known road ahead, and braking distances
    links/<vehicle>/from_<sender>      state of the link in each half second
    messages/<vehicle>/from_<sender>   verdict on each message
    sources/<vehicle>/<source>         status of lead and predecessor
    mode/<vehicle>, log/<vehicle>
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from transport.colours import Colour
from transport.panels import ROWS, Panel, Row
from transport.picture.detail import Detail

Shape = Literal["Asterisk", "Circle", "Cross", "Diamond", "Down", "Plus", "Square", "Up"]
Road = tuple[Sequence[float], Sequence[float]]
"""East and north of the lead's path, m."""
TIMELINE = "run_time"
"""Time since the start of the run; the timeline `time` has Unix time."""

MARGIN_M = 4.0
"""Margin of the view that moves along, about the centre of a car."""
MAX_LEGEND = 4
"""A legend of more vehicles would hide the curves; the name tags have the same colours."""
ROAD = (0x6A, 0x6A, 0x6A)

LANE_EDGE = (0x45, 0x45, 0x45)
WORST = (0x00, 0xE5, 0xFF)

EVENTS: dict[str, tuple[Colour, Shape, float]] = {
    "distrust": ((0xFF, 0xFF, 0x99), "Plus", 6.0),
    "slide": ((0x00, 0xFF, 0xFF), "Down", 5.0),
    "stop": ((0xFF, 0xCC, 0xCC), "Cross", 6.0),
    "path_lost": ((0x00, 0xFF, 0x00), "Square", 4.0),
    "lane_departure": ((0xFF, 0x00, 0xFF), "Up", 7.0),
    "near_miss": ((0xFF, 0xFF, 0x00), "Diamond", 7.0),
    "collision": ((0xFF, 0x00, 0x00), "Asterisk", 10.0),
}
"""Colours of events, brighter than those of the cars, and their shapes and sizes in the plots; the
worst comes last and so above the others."""
MARKS = {"change": ((0xFF, 0xFF, 0xFF), "Circle", 5.0), **EVENTS}
"""The same of all marks: changes to the convoy, and events."""
MIN_RANGE_M = 40.0


def blueprint(vehicles: Sequence[str], *, spacing_m: float, road: Road | None) -> rrb.Blueprint:
    """Layout for `vehicles`, lead first, that drive about `spacing_m` apart on `road`."""
    flat = road is not None and _is_flat(road)
    detail = Detail(vehicles)
    rows = [(row, tabs) for row in ROWS if (tabs := _tabs(row, vehicles, detail, spacing_m))]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _convoy_view(vehicles, Reach.of(detail.shown, spacing_m, road)),
                _plan_view(vehicles, spacing_m, road),
                _log_view(),
                row_shares=[4, 2, 2] if flat else [3, 4, 2],
            ),
            rrb.Vertical(*(tabs for _, tabs in rows), row_shares=[row.share for row, _ in rows]),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    )


class Reach(NamedTuple):
    """Range (m) of the view that moves along, about the vehicle that it follows."""

    behind: float
    ahead: float
    aside: float

    @classmethod
    def of(cls, count: int, spacing_m: float, road: Road | None) -> "Reach":
        """Room for `count` vehicles about `spacing_m` apart."""
        ahead = middle(count) * spacing_m
        behind = (count - 1) * spacing_m - ahead
        flat = road is not None and _is_flat(road)
        aside = 8.0 if flat else min(max(8.0, 0.5 * (ahead + behind)), 25.0)
        return cls(behind + 8.0, ahead + 25.0, aside)

    def zoom_for(self, ahead: float, left: float) -> float:
        """Factor by which it has to grow to show a place (m), at least 1."""
        along = (
            ahead / (self.ahead - MARGIN_M) if ahead > 0.0 else -ahead / (self.behind - MARGIN_M)
        )
        return max(along, abs(left) / (self.aside - MARGIN_M), 1.0)


def _convoy_view(vehicles: Sequence[str], reach: Reach) -> rrb.Spatial2DView:
    """Follow the middle of the convoy, the direction of travel to the right."""
    return rrb.Spatial2DView(
        name="Convoy (driving to the right)",
        origin="world/convoy",
        contents=["/world/**", *(f"- /world/cars/{name}/dot" for name in vehicles)],
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-reach.behind, reach.ahead], y_range=[-reach.aside, reach.aside]
        ),
        overrides=_all_until_now(vehicles),
    )


def _plan_view(vehicles: Sequence[str], spacing_m: float, road: Road | None) -> rrb.Spatial2DView:
    """The convoy on the road, as dots where cars would be too small."""
    small = road is not None and spacing_m < 0.04 * _extent(road)
    hidden = (
        [f"- /world/cars/{name}/name" for name in vehicles[1:]]
        if small
        else [f"- /world/cars/{name}/dot" for name in vehicles]
    )
    hidden += [f"- /world/cars/{name}/worst/name" for name in vehicles]
    hidden += [f"- /world/events/{kind}/name" for kind in MARKS]
    return rrb.Spatial2DView(
        name="Plan (north up)",
        origin="world/plan",
        contents=["/world/**", "- /world/road/marks", "- /world/samples/**", *hidden],
        visual_bounds=_bounds(road, 0.04 if small else 0.12) if road else None,
        overrides=_all_until_now(vehicles),
    )


def _bounds(road: Road, margin_ratio: float) -> rrb.VisualBounds2D:
    """The whole road with a margin; the second axis of a picture points down."""
    east, north = road
    margin = margin_ratio * _extent(road)
    return rrb.VisualBounds2D(
        x_range=[min(east) - margin, max(east) + margin],
        y_range=[-max(north) - margin, -min(north) + margin],
    )


def _extent(road: Road) -> float:
    """Width or height of a road (m), the larger."""
    east, north = road
    return max(max(east) - min(east), max(north) - min(north))


def _is_flat(road: Road) -> bool:
    """Whether a road is so much wider than high, north up, that a low view suffices."""
    east, north = road
    return max(east) - min(east) >= 4.0 * (max(north) - min(north))


def _log_view() -> rrb.TextLogView:
    return rrb.TextLogView(
        name="Log",
        origin="log",
        columns=rrb.TextLogColumns(
            timeline_columns=[encodings.TimelineColumn(TIMELINE)],
            text_log_columns=[
                encodings.TextLogColumn(encodings.TextLogColumnKind.LogLevel),
                encodings.TextLogColumn(encodings.TextLogColumnKind.Body),
            ],
        ),
    )


def _all_until_now(vehicles: Sequence[str]) -> dict[Any, Any]:
    """Show all pieces of driven paths and all events up to the time cursor."""
    ranges = [
        rr.VisibleTimeRange(
            timeline,
            start=rr.TimeRangeBoundary.infinite(),
            end=rr.TimeRangeBoundary.cursor_relative(),
        )
        for timeline in (TIMELINE, "time")
    ]
    entities = [f"world/driven/{name}" for name in vehicles]
    entities += [f"world/events/{kind}" for kind in MARKS]
    return {entity: rrb.VisibleTimeRanges(ranges) for entity in entities}


def middle(count: int) -> int:
    """Place in the convoy of the vehicle that the view follows."""
    return count // 2


def _tabs(row: Row, vehicles: Sequence[str], detail: Detail, spacing_m: float) -> rrb.Tabs | None:
    """Panels of a row; None without any. Of plots by follower that of the followed one is open."""
    tabs: list[rrb.View] = []
    active = None
    for panel in row.panels:
        match panel.kind:
            case "plot":
                tabs.append(_plot(panel, legend=len(vehicles) <= MAX_LEGEND))
            case "states":
                tabs.append(_states(panel, lead=vehicles[0]))
            case "plot_of_one":
                active = len(tabs) + middle(len(detail.names)) - 1
                most = max(panel.range_spacings * (detail.shown - 1) * spacing_m, MIN_RANGE_M)
                tabs += [_plot_of_one(panel, name, most) for name in detail.names[1:]]
    return rrb.Tabs(*tabs, active_tab=active) if tabs else None


def _plot(panel: Panel, *, legend: bool) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=panel.heading(""),
        origin=f"plots/{panel.name}",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=panel.legend and legend),
    )


def _plot_of_one(panel: Panel, vehicle: str, most: float) -> rrb.TimeSeriesView:
    """Plot of one follower, up to `most` if the panel has a range."""
    return rrb.TimeSeriesView(
        name=panel.heading(vehicle),
        origin=f"plots/{panel.name}/{vehicle}",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=panel.legend),
        axis_y=rrb.ScalarAxis(range=(-0.2 * most, most)) if panel.range_spacings else None,
    )


def _states(panel: Panel, *, lead: str) -> rrb.StateTimelineView:
    hidden = [f"- /{panel.name}/{lead}"] if panel.lead == "hidden" else []
    return rrb.StateTimelineView(
        name=panel.heading(""), origin=panel.name, contents=[f"/{panel.name}/**", *hidden]
    )
