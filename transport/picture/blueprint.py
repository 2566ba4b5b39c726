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
    links/<sender>_to_<receiver>       state of the link in each half second
    messages/<sender>_to_<receiver>    verdict on each message
    sources/<vehicle>/<source>         status of lead, predecessor and other sources by name
    mode/<vehicle>, log/<vehicle>
    legend                             colours of vehicles, curves and marks
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from transport.panels import PANELS, ROWS, Colour, Panel, Row

# ---- Level of detail of a long convoy: all data of a few vehicles, and the positions of the others
#
# More curves cannot be distinguished, and drawing them all would be slower than real time.


MAX_ALL_DETAILED = 12  # Largest convoy of which all vehicles are drawn in detail
DETAILED = 8  # Number of vehicles of a longer convoy that are drawn in detail
SHOWN_ABOUT = 5  # Vehicles shown ahead of and behind the followed one


class Detail:
    """Vehicles of a convoy that are drawn in detail, lead first.

    `names` are evenly spread over the convoy and include its first and last vehicle. The moving
    view follows `followed`.
    """

    def __init__(self, vehicles: Sequence[str]) -> None:
        last = len(vehicles) - 1
        self.is_all = len(vehicles) <= MAX_ALL_DETAILED
        places = [round(k * last / (DETAILED - 1)) for k in range(DETAILED)]
        self.names = tuple(vehicles) if self.is_all else tuple(vehicles[place] for place in places)
        self.followed = self.names[len(self.names) // 2]
        self._vehicles = tuple(vehicles)
        self._named = frozenset(self.names)
        self._period_factor = 1.0 if self.is_all else len(vehicles) / DETAILED

    def __contains__(self, vehicle: str) -> bool:
        return self.is_all or vehicle in self._named

    @property
    def shown(self) -> int:
        return len(self._vehicles) if self.is_all else 2 * SHOWN_ABOUT + 1

    def shows(self, place: int, followed: int) -> bool:
        return self.is_all or abs(place - followed) <= SHOWN_ABOUT

    def period(self, period_ns: int) -> int:
        return round(period_ns * self._period_factor)  # ns


# ---- Blueprint


Shape = Literal["Asterisk", "Circle", "Cross", "Diamond", "Down", "Plus", "Right", "Square", "Up"]
Road = tuple[Sequence[float], Sequence[float]]  # East and north of the lead's path, m
TIMELINE = "run_time"  # Time since the start of the run; the timeline `time` has Unix time
MARGIN_M = 4.0  # Margin of the moving view around the centre of a car
FEW_VEHICLES = 5  # Largest convoy whose links and modes share one view
MIN_TAG_M, TAG_PX = 4.0, 34.0  # Distance of a tag from its car, on the screen half its length
VIEW_WIDTH_PX, VIEW_HEIGHT_PX = 888.0, 260.0  # Least size of plans in 1600 × 1000
LEGEND_WIDTH, LEGEND_HEIGHT = 100.0, 7.4  # In its own unit, nearly nine pixels of 1600
ROAD = (0x6A, 0x6A, 0x6A)

LANE_EDGE = (0x58, 0x58, 0x58)
WORST = (0x00, 0xB4, 0xC8)

EVENTS: dict[str, tuple[Colour, Shape, float]] = {
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
MARKS = {"change": ((0x00, 0x3C, 0xFF), "Circle", 5.0), **EVENTS}


@dataclass(frozen=True, slots=True)
class RunExtent:
    """Duration of a run (s), and the vehicle whose own plots come first; as far as known."""

    duration_s: float | None = None
    worst: str = ""


def blueprint(
    vehicles: Sequence[str], *, spacing_m: float, road: Road | None, extent: RunExtent = RunExtent()
) -> rrb.Blueprint:
    """Layout for `vehicles`, lead first, that drive about `spacing_m` apart on `road`."""
    flat = road is not None and _is_flat(road)
    detail = Detail(vehicles)
    rows = [(row, tabs) for row in ROWS if (tabs := _tabs(row, vehicles, detail, extent))]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _convoy_view(vehicles, Reach.of(detail.shown, spacing_m, road)),
                _plan_view(vehicles, spacing_m, road),
                legend_view(),
                _log_view(),
                row_shares=[4, 2, 0.72, 3] if flat else [3, 3.5, 0.72, 2.5],
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
    """Range (m) of the moving view around the vehicle that it follows."""

    behind: float
    ahead: float
    lateral: float

    @classmethod
    def of(cls, count: int, spacing_m: float, road: Road | None) -> "Reach":
        """Return the range for `count` vehicles about `spacing_m` apart."""
        ahead = middle(count) * spacing_m
        behind = (count - 1) * spacing_m - ahead
        flat = road is not None and _is_flat(road)
        lateral = 8.0 if flat else min(max(8.0, 0.5 * (ahead + behind)), 25.0)
        return cls(behind + 8.0, ahead + 25.0, lateral)

    @property
    def tag_m(self) -> float:
        """Distance of name tags from their cars (m)."""
        width, height = self.behind + self.ahead, 2.0 * self.lateral
        return max(MIN_TAG_M, TAG_PX * max(width / VIEW_WIDTH_PX, height / VIEW_HEIGHT_PX))

    def zoom_for(self, ahead: float, left: float) -> float:
        """Factor by which the range has to grow to contain a point (m), at least 1."""
        along = (
            ahead / (self.ahead - MARGIN_M) if ahead > 0.0 else -ahead / (self.behind - MARGIN_M)
        )
        return max(along, abs(left) / (self.lateral - MARGIN_M), 1.0)


def _convoy_view(vehicles: Sequence[str], reach: Reach) -> rrb.Spatial2DView:
    """Follow the middle of the convoy, the direction of travel to the right."""
    return rrb.Spatial2DView(
        name="Convoy (driving to the right)",
        origin="world/convoy",
        contents=[
            "/world/**",
            *(f"- /world/cars/{name}/dot" for name in vehicles),
            f"- /world/cars/{vehicles[0]}/plan_name",
        ],
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-reach.behind, reach.ahead], y_range=[-reach.lateral, reach.lateral]
        ),
        overrides=_all_until_now(vehicles),
    )


def _plan_view(vehicles: Sequence[str], spacing_m: float, road: Road | None) -> rrb.Spatial2DView:
    """Show the convoy on the road, as dots where cars would be too small."""
    small = is_small(road, spacing_m)
    hidden = [f"- /world/cars/{name}/{'name' if small else 'dot'}" for name in vehicles]
    hidden += [f"- /world/cars/{name}/worst/name" for name in vehicles]
    hidden += [f"- /world/events/{kind}/name" for kind in MARKS]
    return rrb.Spatial2DView(
        name="Plan (north up)",
        origin="world/plan",
        contents=["/world/**", "- /world/road/marks", "- /world/samples/**", *hidden],
        visual_bounds=_bounds(road, 0.04 if small else 0.12) if road else None,
        overrides=_all_until_now(vehicles),
    )


def is_small(road: Road | None, spacing_m: float) -> bool:
    """Whether cars are too small to be seen in the plan of a road."""
    return road is not None and spacing_m < 0.04 * _extent(road)


def plan_tag_m(road: Road) -> float:
    """Distance of the lead's name tag from its dot in the plan (m)."""
    return 1.2 * TAG_PX * _extent(road) / VIEW_WIDTH_PX


def _bounds(road: Road, margin_ratio: float) -> rrb.VisualBounds2D:
    """Bounds of the road with a margin; the second axis of a picture points down."""
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
    """Whether a road is at least four times as wide as high, so that a low view suffices."""
    east, north = road
    return max(east) - min(east) >= 4.0 * (max(north) - min(north))


def legend_view() -> rrb.Spatial2DView:
    """Colours of vehicles, curves and marks, in a strip of its own."""
    return rrb.Spatial2DView(
        name="Legend",
        titlebar=False,
        origin="legend",
        visual_bounds=rrb.VisualBounds2D(x_range=[0.0, LEGEND_WIDTH], y_range=[0.0, LEGEND_HEIGHT]),
    )


def _log_view() -> rrb.TextLogView:
    """Log lines, which begin with their time: the viewer's own column cuts long times."""
    return rrb.TextLogView(
        name="Log",
        origin="log",
        format_options=rrb.TextLogFormat(monospace_body=True),
        columns=rrb.TextLogColumns(
            timeline_columns=[encodings.TimelineColumn(TIMELINE, visible=False)],
            text_log_columns=[
                encodings.TextLogColumn(encodings.TextLogColumnKind.LogLevel),
                encodings.TextLogColumn(encodings.TextLogColumnKind.Body),
            ],
        ),
    )


def _all_until_now(vehicles: Sequence[str]) -> dict[Any, Any]:
    """Show driven paths and events up to the time cursor."""
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
    """Position in the convoy of the vehicle that the view follows."""
    return count // 2


def _tabs(row: Row, vehicles: Sequence[str], detail: Detail, extent: RunExtent) -> rrb.Tabs | None:
    """Panels of a row; None without any.

    Of panels by follower that of the worst vehicle comes first, and those of the others last.
    """
    tabs: list[rrb.View] = []
    others: list[rrb.View] = []
    followers = list(detail.names[1:])
    if len(vehicles) <= FEW_VEHICLES and row.joint:
        tabs.append(_states([PANELS[name] for name in row.joint], vehicles[0], extent))
    for panel in row.panels:
        match panel.kind:
            case "plot":
                tabs.append(_plot(panel, "", extent))
            case "states":
                tabs.append(_states([panel], vehicles[0], extent))
            case "plot_of_one" if followers:
                usual = followers[middle(len(detail.names)) - 1]
                worst = extent.worst if extent.worst in followers else usual
                tabs.append(_plot(panel, worst, extent))
                others += [_plot(panel, name, extent) for name in followers if name != worst]
    return rrb.Tabs(*tabs, *others, active_tab=0) if tabs else None


def _plot(panel: Panel, vehicle: str, extent: RunExtent) -> rrb.TimeSeriesView:
    """Plot of all vehicles, or of one. The legend view replaces its legend, which covers data."""
    return rrb.TimeSeriesView(
        name=panel.heading(vehicle),
        origin=f"plots/{panel.name}/{vehicle}".rstrip("/"),
        plot_legend=rrb.PlotLegend(visible=False),
        axis_x=_whole_run(extent.duration_s),
    )


def _states(panels: Sequence[Panel], lead: str, extent: RunExtent) -> rrb.StateTimelineView:
    shown = [f"/{panel.name}/**" for panel in panels]
    hidden = [f"- /{panel.name}/{lead}" for panel in panels if panel.lead == "hidden"]
    first, *others = (panel.heading("") for panel in panels)
    return rrb.StateTimelineView(
        name=" and ".join([first, *(title.lower() for title in others)]),
        origin=panels[0].name if len(panels) == 1 else "/",
        contents=[*shown, *hidden],
        time_view=_whole_run(extent.duration_s),
    )


def _whole_run(duration_s: float | None) -> rrb.TimeAxis:
    """Time axis of the whole run; of all data if no duration is known."""
    if duration_s is None:
        start, end = rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.infinite()
    else:
        start = rr.TimeRangeBoundary.absolute(seconds=0.0)
        end = rr.TimeRangeBoundary.absolute(seconds=duration_s)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
