"""Plots of several curves over time, one below the other."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from transport.colours import Colour
from transport.picture.blueprint import TIMELINE
from transport.picture.comparison.tracks import Floats

Plot = tuple[str, Mapping[str, Floats]]
"""Heading with the unit, and values (N) by the name of their curve."""


def draw_plots(
    recording: rr.RecordingStream,
    at_s: Floats,
    plots: Mapping[str, Plot],
    colours: Sequence[Colour],
) -> None:
    """Draw curves over the time `at_s` (N) from the start, with one colour per curve of a plot.

    `plots` are by entity. Sends the layout too.
    """
    times = [rr.TimeColumn(TIMELINE, duration=np.round(at_s * 1e9).astype("timedelta64[ns]"))]
    for entity, (_, curves) in plots.items():
        for (name, values), colour in zip(curves.items(), colours, strict=False):
            path = f"plots/{entity}/{name}"
            style = rr.SeriesLines(colors=[colour], names=[name])
            recording.log(path, style, static=True)
            recording.send_columns(path, times, rr.Scalars.columns(scalars=values))
    views = [
        rrb.TimeSeriesView(name=heading, origin=f"plots/{entity}")
        for entity, (heading, _) in plots.items()
    ]
    recording.send_blueprint(
        rrb.Blueprint(
            rrb.Vertical(*views),
            rrb.TimePanel(timeline=TIMELINE, expanded=False),
            rrb.SelectionPanel(expanded=False),
            rrb.BlueprintPanel(expanded=False),
            auto_layout=False,
            auto_views=False,
        )
    )
