"""Arrays as columns of a recording, which cost a hundredth of single values."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import rerun as rr

from transport.columns import Array, Integers
from transport.panels import Colour
from transport.picture.batch import Floats

Shape = Literal["Asterisk", "Circle", "Cross", "Diamond", "Down", "Plus", "Right", "Square", "Up"]
MarkStyle = tuple[Colour, Shape, float]  # The size is that in the plots
TIMELINE = "run_time"  # Time since the start of the run; the timeline `time` has Unix time

_NUMBER = pa.field("item", pa.float32(), nullable=False)
_POINT = pa.list_(_NUMBER, 2)
_STRIP = pa.list_(pa.field("item", _POINT, nullable=False))


def frames_of(poses: Floats, zoom: Floats | float = 1.0, *, flip: bool = False) -> Any:
    """Column of frames at poses with rows of east, north (m) and yaw (rad), see `axes_of`."""
    rows = axes_of(poses, zoom, flip).swapaxes(1, 2).reshape(-1, 9)  # Rerun takes them by rows
    places = np.column_stack((poses[:, :2], np.zeros(len(poses))))
    return rr.Transform3D.columns(translation=places, mat3x3=rows)


def axes_of(poses: Floats, zoom: Floats | float, flip: bool) -> Floats:
    """Axes (N, 3, 3) of frames: `axes[n, k]` is axis k of frame n in the world, `zoom` long.

    With `flip` the second axis points to the right instead of the left: a picture's second axis
    points down, so that left turns turn left.
    """
    c, s, zero = zoom * np.cos(poses[:, 2]), zoom * np.sin(poses[:, 2]), np.zeros(len(poses))
    left = -1.0 if flip else 1.0
    axes = [[c, s, zero], [-s * left, c * left, zero], [zero, zero, zero + zoom]]
    return np.moveaxis(np.array(axes), 2, 0)


def strips_of(counts: Integers, points: Floats) -> Any:
    """Column of one line in each row, with `counts` of the joined `points` (N, 2)."""
    offsets = pa.array(np.concatenate(([0], np.cumsum(counts))), pa.int32())
    numbers = pa.array(points.astype(np.float32).ravel())
    flat = pa.FixedSizeListArray.from_arrays(numbers, type=_POINT)
    return rr.LineStrips2D.columns(strips=pa.ListArray.from_arrays(offsets, flat, type=_STRIP))


def packed(colours: list[Colour]) -> Array:
    """Opaque colours as 32-bit numbers."""
    parts = np.array(colours, np.uint32).reshape(-1, 3)
    return (parts[:, 0] << 24) | (parts[:, 1] << 16) | (parts[:, 2] << 8) | np.uint32(255)


class RowSender:
    """Sends rows, curves and states to a recording of a run that began at `start` (ns)."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self.recording = recording
        self.start = 0
        self._styled: set[str] = set()
        self._periods: dict[tuple[str, str], int] = {}
        self._states: dict[str, str] = {}

    def times(self, at: Array) -> list[rr.TimeColumn]:
        """Both timelines at instants (ns)."""
        return [
            rr.TimeColumn(TIMELINE, duration=(at - self.start).astype("timedelta64[ns]")),
            rr.TimeColumn("time", timestamp=at.astype("datetime64[ns]")),
        ]

    def send(self, entity: str, at: Array, columns: rr.ComponentColumnList) -> None:
        """Send rows with their instants."""
        self.recording.send_columns(entity, self.times(at), columns)

    def style(self, entity: str, style: rr.AsComponents) -> None:
        """Set the style of an entity once."""
        if entity not in self._styled:
            self._styled.add(entity)
            self.recording.log(entity, style, static=True)

    def curve(
        self,
        entity: str,
        at: Array,
        values: Floats,
        label: str,
        colour: Colour,
        *,
        width: float = 1.5,
    ) -> None:
        """Draw the values of a curve; unknown ones are left out."""
        known = np.isfinite(values)
        if known.any():
            self.style(entity, rr.SeriesLines(colors=[colour], names=[label], widths=[width]))
            self.send(entity, at[known], rr.Scalars.columns(scalars=values[known]))

    def zero_marks(self, entity: str, at: Array, label: str, style: MarkStyle) -> None:
        """Draw marks on the zero line of a plot."""
        colour, shape, size = style
        point = rr.SeriesPoints(
            colors=[colour], markers=[shape], names=[label], marker_sizes=[size]
        )
        self.style(entity, point)
        self.send(entity, at, rr.Scalars.columns(scalars=np.zeros(len(at))))

    def states(
        self, entity: str, at: Array, states: Array, colours: Mapping[str, Colour], title: str = ""
    ) -> None:
        """Draw the changes of a state; `title` follows the state's name in the strip."""
        if not len(states):
            return
        known = list(colours)
        labels = [f"{state} · {title}" if title else state for state in known]
        style = rr.StateConfiguration(values=known, labels=labels, colors=list(colours.values()))
        self.style(entity, style)
        before = np.concatenate((np.array([self._states.get(entity)], object), states[:-1]))
        rows = np.flatnonzero(states != before)
        self._states[entity] = states[-1]
        if rows.size:
            self.send(entity, at[rows], rr.StateChange.columns(state=states[rows].tolist()))

    def due(self, vehicle: str, entity: str, at: Integers, period: int) -> Integers:
        """First row of each period (ns) of rows that come in several batches; 0 picks all."""
        if not period or not len(at):
            return np.arange(len(at))
        number = np.maximum.accumulate((at - self.start) // period)
        latest = self._periods.get((vehicle, entity), int(number[0]) - 1)
        before = np.maximum(np.concatenate(([latest], number[:-1])), latest)
        self._periods[vehicle, entity] = max(latest, int(number[-1]))
        return np.flatnonzero(number > before)
