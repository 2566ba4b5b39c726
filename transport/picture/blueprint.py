"""Layout of the picture of a convoy: entities, colours and views.

Entities are named by quantity first and vehicle last, because a view takes in whole branches:

    world/                  east, north in metres, as in the messages
      plan, convoy          frames of the two plan views: north up, and moving with the convoy
      road/…                the lead's path and its distance marks
      driven/<vehicle>      where it drove
      trajectory/<vehicle>  what it steers along
      samples/<vehicle>     the received samples this was fitted to
      cars/<vehicle>/…      the car
    plots/<quantity>/<vehicle>
    links/<vehicle>/from_<sender>      how the link was in each half second
    messages/<vehicle>/from_<sender>   what became of each message
    mode/<vehicle>, log/<vehicle>
"""

from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint import encodings

from transport.picture.link_states import LATE, LOSSES, OK, SILENT

Colour = tuple[int, int, int]
Road = tuple[Sequence[float], Sequence[float]]
"""East and north of the lead's path, m."""
TIMELINE = "run_time"
"""Time since the start of the run; `time` is the instant itself."""

COLOURS = (
    (0xE4, 0x57, 0x2E),
    (0x56, 0xB4, 0xE9),
    (0x1F, 0xA9, 0x7F),
    (0xE6, 0x9F, 0x00),
    (0xCC, 0x79, 0xA7),
    (0x7D, 0x8C, 0xFF),
    (0xC9, 0xBB, 0x1E),
    (0x9A, 0x9A, 0x9A),
)
"""Of the lead and those behind it (after Okabe and Ito): told apart with any colour vision, and
seen on Rerun's dark as on its light background."""
LEGEND_HOLDS = 6
"""A legend of more vehicles would hide the curves; the name tags have the same colours."""
ROAD = (0x6A, 0x6A, 0x6A)

EDGE = (0x45, 0x45, 0x45)
MARK = (0xFF, 0xFF, 0xFF, 0x60)

CALM, WAITING, HALTED = (0x2E, 0x4A, 0x44), (0x3F, 0x44, 0x7E), (0x4F, 0x25, 0x66)
LEAST_LOSS, ALL_LOST = (0x5C, 0x4A, 0x36), (0xB0, 0x10, 0x3C)


def _shade(share: float) -> Colour:
    """Colour of a share lost, from brown to crimson."""
    red, green, blue = (
        round(least + share * (most - least))
        for least, most in zip(LEAST_LOSS, ALL_LOST, strict=True)
    )
    return red, green, blue


STATES = {
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
        "coast": ALL_LOST,
        "straight": HALTED,
    },
}
"""Colours of states: of a link over half a second, of its single messages, and of what a vehicle
steers along. They are dark, and so apart from the colours of the cars."""
PLOTS = {
    "cross_track": "Cross-track error to the lead's path (m, left positive)",
    "tracking": "Error as the vehicle believes (m)",
    "steering": "Steering (deg, left positive)",
    "speed": "Speed (m/s)",
    "gap": "Gap to the vehicle ahead, as it believes (m)",
    "age": "Age of lead's and predecessor's newest pose (s)",
    "loss": "Lost of the messages in each half second (%)",
}


def colour_of(place: int) -> Colour:
    """Colour of the vehicle at `place` of the convoy; after eight they come again, darker."""
    if place == 0:
        return COLOURS[0]
    round_, place = divmod(place - 1, len(COLOURS) - 1)
    red, green, blue = COLOURS[1 + place]
    shade = (1.0, 0.6, 0.8)[round_ % 3]
    return round(shade * red), round(shade * green), round(shade * blue)


def blueprint(vehicles: Sequence[str], *, gap_m: float, road: Road | None) -> rrb.Blueprint:
    """Lay out the picture of `vehicles`, lead first, that drive about `gap_m` apart on `road`."""
    flat = road is not None and _is_flat(road)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _convoy_view(vehicles, gap_m, flat=flat),
                _plan_view(vehicles, gap_m, road),
                _log_view(),
                row_shares=[4, 2, 2] if flat else [3, 4, 2],
            ),
            rrb.Vertical(
                rrb.Tabs(
                    _plot("cross_track", legend=len(vehicles) <= LEGEND_HOLDS), _plot("tracking")
                ),
                rrb.Tabs(_plot("gap"), _plot("speed"), _plot("steering")),
                _states("mode", "Steers along"),
                _plot("age"),
                rrb.Tabs(
                    _states("links", "Links, each half second"),
                    _plot("loss"),
                    _states("messages", "Messages (zoom in)"),
                ),
                row_shares=[6, 4, 7, 4, 8],
            ),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    )


def _convoy_view(vehicles: Sequence[str], gap_m: float, *, flat: bool) -> rrb.Spatial2DView:
    """Follow the middle of the convoy, the direction of travel to the right."""
    ahead = middle(len(vehicles)) * gap_m
    behind = (len(vehicles) - 1) * gap_m - ahead
    aside = 8.0 if flat else min(max(8.0, 0.5 * (ahead + behind)), 25.0)
    return rrb.Spatial2DView(
        name="Convoy (driving to the right)",
        origin="world/convoy",
        contents=["/world/**", *(f"- /world/cars/{name}/dot" for name in vehicles)],
        visual_bounds=rrb.VisualBounds2D(
            x_range=[-behind - 8, ahead + 25], y_range=[-aside, aside]
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
    """Driven paths are logged piece by piece: show all pieces up to the time cursor."""
    ranges = [
        rr.VisibleTimeRange(
            timeline,
            start=rr.TimeRangeBoundary.infinite(),
            end=rr.TimeRangeBoundary.cursor_relative(),
        )
        for timeline in (TIMELINE, "time")
    ]
    return {f"world/driven/{name}": rrb.VisibleTimeRanges(ranges) for name in vehicles}


def middle(count: int) -> int:
    """Place in the convoy of the vehicle that the view follows."""
    return count // 2


def _plot(quantity: str, *, legend: bool = False) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=PLOTS[quantity],
        origin=f"plots/{quantity}",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=legend),
    )


def _states(origin: str, name: str) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(name=name, origin=origin)
