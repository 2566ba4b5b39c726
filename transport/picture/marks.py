"""Marks of events and changes, by place in the plans and by time in the plots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr

from transport.panels import PANELS
from transport.picture.blueprint import MARKS

ROW_RATIO = 0.75  # Distance between rows of names, in distances of name tags


@dataclass(frozen=True, slots=True)
class Mark:
    """An event or change at instant `at_ns` and place (east, north) in metres."""

    kind: str
    at_ns: int
    place: tuple[float, float]
    vehicles: tuple[str, ...]
    text: str = ""

    @property
    def label(self) -> str:
        title = self.text or self.kind.replace("_", " ")
        return f"{title} {' '.join(reversed(self.vehicles))}"

    @property
    def plots(self) -> tuple[str, ...]:
        return _marked_plots(self.vehicles[-1:])


def _marked_plots(vehicles: Sequence[str]) -> tuple[str, ...]:
    """Names of the marked plots of all vehicles, and of those of each of `vehicles`."""
    marked = [panel for panel in PANELS.values() if panel.marked]
    common = [panel.name for panel in marked if panel.kind == "plot"]
    own = [panel.name for panel in marked if panel.kind == "plot_of_one"]
    return (*common, *(f"{panel}/{name}" for panel in own for name in vehicles))


class Marks:
    """Draws marks with the colour and shape of their kind."""

    def __init__(self, recording: rr.RecordingStream, followers: Sequence[str]) -> None:
        self._recording = recording
        plots = _marked_plots(followers)
        for kind, (colour, shape, size) in MARKS.items():
            style = rr.SeriesPoints(
                colors=[colour],
                markers=[shape],
                names=[kind.replace("_", " ")],
                marker_sizes=[size],
            )
            for plot in plots:
                recording.log(f"plots/{plot}/events/{kind}", style, static=True)

    def draw(self, mark: Mark, yaw: float, tag_m: float) -> None:
        """Draw a mark at the recording's present time, on a road in direction `yaw` (rad).

        Names are to the right of the road in a row for each kind, the first at `tag_m`.
        """
        colour, _, _ = MARKS[mark.kind]
        spot = rr.Points2D(
            [mark.place], colors=[colour], radii=rr.Radius.ui_points(6.0), draw_order=40
        )
        right_m = tag_m * (1.0 + ROW_RATIO * list(MARKS).index(mark.kind))
        (east, north), right = mark.place, (math.sin(yaw), -math.cos(yaw))
        name = rr.Points2D(
            [[east + right_m * right[0], north + right_m * right[1]]],
            colors=[colour],
            radii=0.0,
            labels=[mark.label],
            show_labels=True,
            draw_order=41,
        )
        self._recording.log(f"world/events/{mark.kind}", spot)
        self._recording.log(f"world/events/{mark.kind}/name", name)
        for plot in mark.plots:  # on the zero line
            self._recording.log(f"plots/{plot}/events/{mark.kind}", rr.Scalars(0.0))
