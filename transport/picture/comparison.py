"""Draws several runs into one recording: each value has a time and a distance along the path."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from transport.columns import Array
from transport.panels import PANELS, Colour, colour_of
from transport.picture.batch import Floats, RunScene
from transport.picture.layout import WORST, Reach, comparison_blueprint
from transport.picture.rows import TIMELINE, RowSender, frames_of
from transport.picture.shapes import (
    CarShape,
    car,
    draw_road,
    legend,
    points,
)

PLACE_TIMELINE = "path_m"  # Whole metres along the path of the first run
FADED = 0.45  # Brightness of the first run, of which the others differ
CAR_STEP = 2  # True poses (50 Hz) per position of a car


class Placed(NamedTuple):
    """Values (N) at places (N, 2): times (s after the start), distances along the path (m)."""

    at: Floats
    values: Any

    @classmethod
    def known(cls, at_s: Floats, station_m: Floats, values: Any) -> "Placed":
        """Values whose distances are known."""
        rows = np.isfinite(station_m)
        return cls(np.column_stack((at_s, station_m))[rows], values[rows])


class PlacedSender(RowSender):
    """Sends rows with a time and a distance."""

    def times(self, at: Array) -> list[rr.TimeColumn]:
        since_start = np.round(at[:, 0] * 1e9).astype("timedelta64[ns]")
        furthest = np.maximum.accumulate(at[:, 1])  # a car that rolls back stays there
        return [
            rr.TimeColumn(TIMELINE, duration=since_start),
            rr.TimeColumn(PLACE_TIMELINE, sequence=np.round(furthest).astype(np.int64)),
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleTrack:
    """One vehicle of the run `run` (A, B, …), at `place` in its convoy.

    `body` is its length and width (m), and the distance of its middle ahead of its pose. `path` has
    east and north in the common plane (m) of all poses, and `poses` also yaw (rad). `curves` are by
    quantity: error, gap, and from the second run on the difference from the first one. `modes`
    begin there.
    """

    run: str
    vehicle: str
    place: int
    body: tuple[float, float, float]
    path: Floats
    poses: Placed
    curves: Mapping[str, Placed]
    modes: Placed

    @property
    def label(self) -> str:
        return f"{self.vehicle} {self.run}"


def draw_tracks(
    recording: rr.RecordingStream,
    scene: RunScene,
    tracks: Sequence[VehicleTrack],
    divergence: Placed | None,
    text: str,
) -> None:
    """Draw the tracks of several runs into a recording and send its layout.

    `divergence` is the place (east, north) at which two runs first differ, `text` Markdown.
    """
    sender = PlacedSender(recording)
    runs = list(dict.fromkeys(track.run for track in tracks))
    recording.send_blueprint(comparison_blueprint(scene, len(runs)))
    tag_m = Reach.of(scene).tag_m
    draw_road(recording, scene)
    followed = scene.vehicles[len(scene.vehicles) // 2]
    items: list[tuple[str, Colour]] = []
    for track in sorted(tracks, key=lambda one: (one.place, one.run)):
        number = runs.index(track.run)
        colour = _colour(track.place, number)
        _draw_car(sender, track, colour, tag_m if number else -tag_m)
        for quantity, curve in track.curves.items():
            entity = f"plots/{quantity}/{track.vehicle}/{track.run}"
            width = 1.5 if number else 2.5
            sender.curve(entity, *curve, track.label, colour, width=width)
        if track.place:
            entity = f"mode/{track.vehicle}_{track.run}"
            sender.states(entity, *track.modes, PANELS["mode"].states)
        if track.vehicle == followed and not number:
            _draw_positions(sender, "world/convoy", track, flip=True)
        items.append((track.label, colour))
    if divergence is not None:
        _draw_divergence(sender, divergence)
        items.append(("first divergence", WORST))
    recording.log("legend", legend(items), static=True)
    document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
    recording.log("text", document, static=True)


def _colour(place: int, number: int) -> Colour:
    """The vehicle's colour, mixed with grey for the first run and lightened from the third on."""
    share = (FADED, 1.0, 0.75, 0.6)[min(number, 3)]
    grey = 0x80 if number == 0 else 0xFF
    red, green, blue = (round(share * part + (1.0 - share) * grey) for part in colour_of(place))
    return red, green, blue


def _draw_car(sender: RowSender, track: VehicleTrack, colour: Colour, tag_m: float) -> None:
    name = f"{track.run}/{track.vehicle}"
    shapes = {
        f"driven/{name}": rr.LineStrips2D(
            [track.path[::CAR_STEP]],
            colors=[colour],
            radii=rr.Radius.ui_points(1.0),
            draw_order=5,
        ),
        f"cars/{name}": car(CarShape(*track.body), colour),
        f"cars/{name}/dot": points(width=4.0, order=19, colour=colour, at=(0.0, 0.0)),
        f"names/{name}": points(order=30, colour=colour, text=track.label, at=(0.0, tag_m)),
    }
    for entity, shape in shapes.items():
        sender.style(f"world/{entity}", shape)
    for branch in ("cars", "names"):
        _draw_positions(sender, f"world/{branch}/{name}", track)


def _draw_positions(
    sender: RowSender, entity: str, track: VehicleTrack, *, flip: bool = False
) -> None:
    """Move a frame with a vehicle."""
    at, poses = (column[::CAR_STEP] for column in track.poses)
    if len(at):
        sender.send(entity, at, frames_of(poses, flip=flip))


def _draw_divergence(sender: RowSender, first: Placed) -> None:
    """Mark the first divergence in the plans and, on the zero line, in the plots of errors."""
    text = f"first divergence, {first.at[0, 1]:.0f} m"
    (east, north), *_ = first.values.tolist()
    mark = points(width=7.0, order=40, colour=WORST, text=text, at=(east, north))
    sender.style("world/divergence", mark)
    for quantity in ("error", "difference"):
        entity = f"plots/{quantity}/divergence"
        sender.zero_marks(entity, first.at, "first divergence", (WORST, "Diamond", 7.0))
