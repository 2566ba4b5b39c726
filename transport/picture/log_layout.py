"""Layout for a log that Rerun opens without this project.

Rerun reads the standard messages of a log as poses, and all others as tables. The layout maps
poses to cars and numbers to curves:

    rerun run.mcap - < rerun.rbl
"""

import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
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
from transport.panels import PANELS, Panel, Series
from transport.picture.axes import whole_run
from transport.picture.blueprint import ROAD, middle
from transport.topics import TOPICS

TIMELINE = "message_publish_time"
"""Instant at which a message was valid; the log time is that of recording."""
HEIGHT_M = 1.5
EYE_M = (-25.0, -12.0, 22.0)
"""Position of the camera relative to the convoy."""
MIN_REACH_M = 40.0


def save_log_layout(
    path: Path,
    log: str,
    cars: Mapping[str, tuple[float, float, float]],
    *,
    spacing_m: float,
) -> None:
    """Write the layout for the log named `log` (without its ending).

    `cars` are the vehicles, the lead first, usually `spacing_m` apart: length, width, and distance
    of the middle ahead of the pose (m).
    """
    names = list(cars)
    part = path.with_name(path.name + ".part")
    rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_scene(cars, spacing_m), _text(names), row_shares=[3, 1]),
            rrb.Vertical(*_rows(names)),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    ).save(log, part)
    part.replace(path)


def _scene(cars: Mapping[str, tuple[float, float, float]], spacing_m: float) -> rrb.Spatial3DView:
    """Cars, their composite trajectories, and the lead's path."""
    tracked = list(cars)[middle(len(cars))]
    overrides: dict[Any, Any] = {"convoy/run/path": _dots(ROAD, (0.8, 0.05, 0.02))}
    for place, (name, (length, width, forward)) in enumerate(cars.items()):
        colour = colour_of(place)
        # The viewer keeps the distance that shows the whole entity that it tracks.
        reach = max(MIN_REACH_M, 0.5 * spacing_m * len(cars))
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


def _rows(names: Sequence[str]) -> Iterator[rrb.View | rrb.Tabs]:
    panels = [panel for panel in PANELS.values() if panel.plain_row and panel.applies_to(names)]
    for _, row in groupby(sorted(panels, key=_plain_row), _plain_row):
        tabs = [_plot(panel, names) for panel in row]
        yield tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs)


def _plain_row(panel: Panel) -> int:
    return panel.plain_row


def _plot(panel: Panel, names: Sequence[str]) -> rrb.TimeSeriesView:
    followers = panel.followers(names)
    overrides: dict[Any, Any] = {
        f"convoy/{name}/{panel.topic}": [_curve(series, name, place) for series in panel.single]
        for place, name in followers.items()
    }
    return rrb.TimeSeriesView(
        name=panel.heading(next(iter(followers.values()), "")),
        origin="convoy",
        contents=[f"/{entity}" for entity in overrides],
        overrides=overrides,
        axis_x=whole_run(None, 0.0),
        # The cars in the scene have the colours of their curves.
        plot_legend=rrb.PlotLegend(visible=any(series.colour for series in panel.series)),
    )


def _curve(series: Series, vehicle: str, place: int) -> Any:
    message = TOPICS[series.topic].message.__name__ if series.topic in TOPICS else "Deviation"
    line = rr.SeriesLines(
        names=[series.label_of(vehicle)],
        colors=[series.colour_at(place)],
        widths=[series.width],
    )
    mapping = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=f"convoy.{message}:message",
        selector=f".{series.field}",
    )
    return line.visualizer(mappings=[mapping])


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
    """Write a layout at low priority; the program's argument are those of the function, as JSON."""
    os.nice(19)
    arguments = json.loads(sys.argv[1])
    save_log_layout(Path(arguments.pop("path")), **arguments)


if __name__ == "__main__":
    main()
