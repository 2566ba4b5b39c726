"""Layout for a log that Rerun opens by itself, without this project.

Rerun reads the standard messages of a log as poses, and all others as tables. The layout says
which of them are cars, and which numbers are curves:

    rerun run.mcap - < rerun.rbl
"""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import (
    ComponentSourceKind,
    TextLogColumn,
    TextLogColumnKind,
    TimelineColumn,
    VisualizerComponentMapping,
)

from transport.colours import Colour, colour_of
from transport.picture.blueprint import CLOSING, ROAD, middle

TIMELINE = "message_publish_time"
"""When a message was valid; the log time is when it was recorded."""
HEIGHT_M = 1.5
EYE_M = (-25.0, -12.0, 22.0)
"""The direction from which the scene is looked at."""
LEAST_REACH_M = 40.0
PLOTS = (
    ("True cross-track error (m)", "deviation", "convoy.Deviation", "cross_track_error_m"),
    ("Error as believed (m)", "tracking", "convoy.Tracking", "lateral_error_m"),
    ("True gap (m)", "deviation", "convoy.Deviation", "true_gap_m"),
    ("Believed gap (m)", "tracking", "convoy.Tracking", "gap_m"),
)
"""Title, topic, message and field of what is plotted of each vehicle."""


def save_log_layout(
    path: Path,
    log: str,
    cars: Mapping[str, tuple[float, float, float]],
    *,
    gap_m: float,
) -> None:
    """Write the layout for the log named `log` (without its ending).

    `cars` are the vehicles, the lead first, usually `gap_m` apart: length, width, and how far their
    middles lie ahead of their poses (m).
    """
    names = list(cars)
    beside = path.with_name(path.name + ".part")
    errors, believed, gaps, believed_gaps = (_plot(names, *row) for row in PLOTS)
    ahead = [_road_ahead(names[middle(len(names))])] if len(names) > 1 else []
    rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_scene(cars, gap_m), _text(names), row_shares=[3, 1]),
            rrb.Vertical(errors, believed, *ahead, rrb.Tabs(gaps, believed_gaps)),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    ).save(log, beside)
    beside.replace(path)


def _scene(cars: Mapping[str, tuple[float, float, float]], gap_m: float) -> rrb.Spatial3DView:
    """Show cars, the path that each steers along, and the lead's path."""
    tracked = list(cars)[middle(len(cars))]
    overrides: dict[Any, Any] = {"convoy/run/path": _dots(ROAD, (0.8, 0.05, 0.02))}
    for place, (name, (length, width, forward)) in enumerate(cars.items()):
        colour = colour_of(place)
        # The viewer keeps as far away as shows all of the entity that it tracks.
        reach = max(LEAST_REACH_M, 0.5 * gap_m * len(cars))
        room = [[-reach, 0.0, 0.0], [reach, 0.0, 0.0]] if name == tracked else []
        body = rr.Boxes3D(
            centers=[[forward, 0.0, 0.5 * HEIGHT_M], *room],
            half_sizes=[[0.5 * length, 0.5 * width, 0.5 * HEIGHT_M], *([[0.0] * 3] * len(room))],
            colors=[colour],
            labels=[name, *([""] * len(room))],
            fill_mode="solid",
        )
        overrides[f"convoy/{name}/pose"] = [body.visualizer()]
        if place:
            overrides[f"convoy/{name}/preview"] = _dots(colour, (0.3, 0.1, 0.05))
    return rrb.Spatial3DView(
        name="Convoy",
        origin="convoy",
        contents=[f"/{entity}" for entity in overrides],
        overrides=overrides,
        eye_controls=rrb.EyeControls3D(
            position=EYE_M,
            look_target=[0.0, 0.0, 0.0],
            eye_up=[0.0, 0.0, 1.0],
            tracking_entity=f"/convoy/{tracked}/pose",
        ),
    )


def _dots(colour: Colour, half_size: tuple[float, float, float]) -> list[Any]:
    dot = rr.Boxes3D(half_sizes=[half_size], colors=[colour], fill_mode="solid")
    return [dot.visualizer()]


def _plot(
    names: Sequence[str], title: str, topic: str, message: str, field: str
) -> rrb.TimeSeriesView:
    """Plot a field of the messages of all followers; nothing is known of the lead's."""
    overrides: dict[Any, Any] = {}
    for place, name in enumerate(names[1:], start=1):
        overrides[f"convoy/{name}/{topic}"] = [_curve(name, colour_of(place), 1.5, message, field)]
    return rrb.TimeSeriesView(
        name=title,
        origin="convoy",
        contents=[f"/{entity}" for entity in overrides],
        overrides=overrides,
    )


def _curve(label: str, colour: Colour, width: float, message: str, field: str) -> Any:
    """One field of a message as a curve."""
    line = rr.SeriesLines(names=[label], colors=[colour], widths=[width])
    mapping = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=f"{message}:message",
        selector=f".{field}",
    )
    return line.visualizer(mappings=[mapping])


def _road_ahead(name: str) -> rrb.TimeSeriesView:
    """Plot how far the road ahead of one follower is known, and what a stop takes."""
    curves = [
        _curve(words, colour, width, "convoy.Tracking", f"{curve}_m")
        for curve, (words, colour, width) in CLOSING.items()
    ]
    return rrb.TimeSeriesView(
        name=f"Road ahead of {name} (m)",
        origin="convoy",
        contents=[f"/convoy/{name}/tracking"],
        overrides={f"convoy/{name}/tracking": curves},
    )


def _text(names: Sequence[str]) -> rrb.TextLogView:
    return rrb.TextLogView(
        name="Log",
        origin="convoy",
        contents=[f"/convoy/{name}/text" for name in (*names, "run")],
        columns=rrb.TextLogColumns(
            timeline_columns=[TimelineColumn(TIMELINE)],
            text_log_columns=[
                TextLogColumn(TextLogColumnKind.EntityPath),
                TextLogColumn(TextLogColumnKind.LogLevel),
                TextLogColumn(TextLogColumnKind.Body),
            ],
        ),
    )


def main() -> None:
    """Write the layout that the argument asks for, in JSON, when nothing else is to be done."""
    os.nice(19)
    asked = json.loads(sys.argv[1])
    save_log_layout(Path(asked.pop("path")), **asked)


if __name__ == "__main__":
    main()
