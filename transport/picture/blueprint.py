"""Layout of the picture of a convoy: entities, colours and views.

Entities are named by quantity first and vehicle last, because a view takes in whole branches:

    world/                  east, north in metres, as in the messages
      plan, convoy          frames of the two plan views: north up, and moving with the convoy
      road/…                the lead's path and its distance marks
      driven/<vehicle>      where it drove
      trajectory/<vehicle>  what it steers along
      samples/<vehicle>     the received samples this was fitted to
      events/<kind>         where something happened
      cars/<vehicle>/…      the car, with a ring if it is furthest off the lead's path
    plots/<quantity>/<vehicle>, plots/<quantity>/events/<kind>
    plots/closing/<vehicle>/<curve>    its road ahead, as far as known, and what a stop takes
    links/<vehicle>/from_<sender>      how the link was in each half second
    messages/<vehicle>/from_<sender>   what became of each message
    sources/<vehicle>/<source>         what it makes of lead and predecessor
    mode/<vehicle>, log/<vehicle>
"""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from transport.colours import Colour
from transport.picture.detail import Detail
from transport.picture.link_states import LATE, LOSSES, OK, SILENT

Shape = Literal["Asterisk", "Circle", "Cross", "Diamond", "Down", "Plus", "Square", "Up"]
Road = tuple[Sequence[float], Sequence[float]]
"""East and north of the lead's path, m."""
TIMELINE = "run_time"
"""Time since the start of the run; `time` is the instant itself."""

EDGE_M = 4.0
"""What the view that moves along shows about the centre of a car at its edge."""
LEGEND_HOLDS = 4
"""A legend of more vehicles would hide the curves; the name tags have the same colours."""
ROAD = (0x6A, 0x6A, 0x6A)

EDGE = (0x45, 0x45, 0x45)
WORST = (0x00, 0xE5, 0xFF)

CALM, WAITING, HALTED = (0x2E, 0x4A, 0x44), (0x3F, 0x44, 0x7E), (0x4F, 0x25, 0x66)
LEAST_LOSS, ALL_LOST = (0x5C, 0x4A, 0x36), (0xB0, 0x10, 0x3C)


def _shade(share: float) -> Colour:
    """Colour of a share lost, from brown to crimson."""
    red, green, blue = (
        round(least + share * (most - least))
        for least, most in zip(LEAST_LOSS, ALL_LOST, strict=True)
    )
    return red, green, blue


def hazard_in(mode: str) -> str:
    """State of a vehicle that warns those behind of itself."""
    return f"{mode}, hazard"


STATES: dict[str, dict[str, Colour]] = {
    "links": {
        OK: CALM,
        LATE: WAITING,
        **{state: _shade(k / 9.0) for k, state in enumerate(LOSSES)},
        SILENT: HALTED,
    },
    "messages": {OK: CALM, LATE: WAITING, "lost": ALL_LOST},
    "mode": {
        "path": (0x4A, 0x4A, 0x4A),
        "composite": CALM,
        "lead": (0x2A, 0x4C, 0x66),
        "predecessor": LEAST_LOSS,
        "coast": (0x8A, 0x5A, 0x10),
        "stop": ALL_LOST,
        "straight": HALTED,
    },
    "sources": {
        "unheard": HALTED,
        "fresh": CALM,
        "late": WAITING,
        "probation": (0x2A, 0x4C, 0x66),
        "distrusted": (0x8A, 0x5A, 0x10),
        "lost": ALL_LOST,
    },
}
STATES["mode"] |= {hazard_in(mode): colour for mode, colour in STATES["mode"].items()}
"""Colours of states: of a link over half a second, of its single messages, of what a vehicle steers
along, and of what it makes of its sources. They are dark, and so apart from the colours of the
cars."""
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
"""The same of all that is marked: what was done to the convoy beside what happened to it."""
MARKED_PLOTS = ("cross_track", "true_gap")
CLOSING: dict[str, tuple[str, Colour, float]] = {
    "comfortable_stop": ("stop, comfortably", (0x6F, 0x8F, 0x4F), 1.5),
    "firm_stop": ("stop, firmly", (0xD0, 0x40, 0x40), 1.5),
    "known": ("road known", (0xF2, 0xF2, 0xF2), 2.5),
}
"""Curves of one follower's road ahead: name, colour and width."""
LEAST_CLOSING_M = 40.0
PLOTS = {
    "cross_track": "True cross-track error (m, left positive)",
    "tracking": "Error as believed (m)",
    "true_gap": "True gap (m)",
    "gap": "Believed gap (m)",
    "speed": "Speed (m/s)",
    "steering": "Steering (deg)",
    "age": "Age of lead's and predecessor's newest pose (s)",
    "loss": "Lost of each half second's (%)",
    "received": "Received of the last second (%)",
    "weight": "Weight of the predecessor (%)",
}
"""What is plotted, and what a tab has room for. The true gap is that between bodies, the believed
one that between centres of mass along the path."""


def blueprint(vehicles: Sequence[str], *, gap_m: float, road: Road | None) -> rrb.Blueprint:
    """Lay out the picture of `vehicles`, lead first, that drive about `gap_m` apart on `road`."""
    flat = road is not None and _is_flat(road)
    detail = Detail(vehicles)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _convoy_view(vehicles, Reach.of(detail.shown, gap_m, road)),
                _plan_view(vehicles, gap_m, road),
                _log_view(),
                row_shares=[4, 2, 2] if flat else [3, 4, 2],
            ),
            rrb.Vertical(
                rrb.Tabs(
                    _plot("cross_track", legend=len(vehicles) <= LEGEND_HOLDS), _plot("tracking")
                ),
                *_closing(detail, gap_m),
                rrb.Tabs(_plot("true_gap"), _plot("gap"), _plot("speed"), _plot("steering")),
                rrb.Tabs(
                    _states("mode", "Steers along", hidden=vehicles[0]),
                    _states("sources", "Sources"),
                ),
                rrb.Tabs(_plot("age"), _plot("received"), _plot("weight")),
                rrb.Tabs(
                    _states("links", "Links, each half second"),
                    _plot("loss"),
                    _states("messages", "Messages (zoom in)"),
                ),
                row_shares=[6, *([6] if len(vehicles) > 1 else []), 4, 6, 4, 6],
            ),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    )


class Reach(NamedTuple):
    """How far (m) the view that moves along reaches from the vehicle that it follows."""

    behind: float
    ahead: float
    aside: float

    @classmethod
    def of(cls, count: int, gap_m: float, road: Road | None) -> "Reach":
        """Room for `count` vehicles about `gap_m` apart."""
        ahead = middle(count) * gap_m
        behind = (count - 1) * gap_m - ahead
        flat = road is not None and _is_flat(road)
        aside = 8.0 if flat else min(max(8.0, 0.5 * (ahead + behind)), 25.0)
        return cls(behind + 8.0, ahead + 25.0, aside)

    def need(self, ahead: float, left: float) -> float:
        """How much larger it had to be to show a place (m), 1 if it is shown."""
        along = ahead / (self.ahead - EDGE_M) if ahead > 0.0 else -ahead / (self.behind - EDGE_M)
        return max(along, abs(left) / (self.aside - EDGE_M), 1.0)


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


def _plan_view(vehicles: Sequence[str], gap_m: float, road: Road | None) -> rrb.Spatial2DView:
    """Show where on the road the convoy is: as dots where cars would be too small, else as cars."""
    small = road is not None and gap_m < 0.04 * _extent(road)
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
    """Show the whole road with a margin; the second axis of a picture points down."""
    east, north = road
    margin = margin_ratio * _extent(road)
    return rrb.VisualBounds2D(
        x_range=[min(east) - margin, max(east) + margin],
        y_range=[-max(north) - margin, -min(north) + margin],
    )


def _extent(road: Road) -> float:
    """Width or height of a road (m), whichever is more."""
    east, north = road
    return max(max(east) - min(east), max(north) - min(north))


def _is_flat(road: Road) -> bool:
    """Whether a road is so much wider than high, north up, that a low view is enough."""
    east, north = road
    return max(east) - min(east) >= 4.0 * (max(north) - min(north))


def _log_view() -> rrb.TextLogView:
    """Text with its time and level; the text itself names the vehicle."""
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
    """Driven paths and events are logged one by one: show all up to the time cursor."""
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


def _plot(quantity: str, *, legend: bool = False) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=PLOTS[quantity],
        origin=f"plots/{quantity}",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
    )


def _closing(detail: Detail, gap_m: float) -> list[rrb.Tabs]:
    """Show each follower's road ahead: what is known of it, and what a stop takes.

    At first that of the vehicle that the view moves along with. What a stop takes at full speed may
    be far above; it comes down as the car slows down.
    """
    most = max(3.0 * (detail.shown - 1) * gap_m, LEAST_CLOSING_M)
    views = [
        rrb.TimeSeriesView(
            name=f"Road ahead of {name} (m)",
            origin=f"plots/closing/{name}",
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=True),
            axis_y=rrb.ScalarAxis(range=(-0.2 * most, most)),
        )
        for name in detail.names[1:]
    ]
    return [rrb.Tabs(*views, active_tab=middle(len(detail.names)) - 1)] if views else []


def _states(origin: str, name: str, *, hidden: str = "") -> rrb.StateTimelineView:
    contents = [f"/{origin}/**", *([f"- /{origin}/{hidden}"] if hidden else [])]
    return rrb.StateTimelineView(name=name, origin=origin, contents=contents)
