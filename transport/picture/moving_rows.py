"""Positions of the cars and of the view, and lines, sent as columns.

Columns cost a hundredth of single values.
"""

from collections import defaultdict
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from transport.columns import Array, Integers
from transport.picture.curves import time_columns
from transport.picture.shapes import axes_of

_NUMBER = pa.field("item", pa.float32(), nullable=False)
_MATRIX = pa.list_(_NUMBER, 9)
_POINT = pa.list_(_NUMBER, 2)
_STRIP = pa.list_(pa.field("item", _POINT, nullable=False))
Frame = tuple[float, float, float, bool, float]  # East, north, yaw, flip, unit


class MovingRows:
    """Frames and lines of entities by instant (ns), until they are sent."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._frames: defaultdict[str, list[tuple[int, Frame]]] = defaultdict(list)
        self._lines: defaultdict[str, list[tuple[int, list[tuple[float, float]]]]]
        self._lines = defaultdict(list)

    def add_frame(self, entity: str, at: int, frame: Frame) -> None:
        self._frames[entity].append((at, frame))

    def add_line(self, entity: str, at: int, points: list[tuple[float, float]]) -> None:
        self._lines[entity].append((at, points))

    def send(self, start: int) -> None:
        """Send all rows since the last call; the run began at instant `start` (ns)."""
        for entity, frames in self._frames.items():
            at = np.array([at for at, _ in frames], np.int64)
            places, matrices = axes_of(np.array([frame for _, frame in frames], np.float64))
            columns = rr.Transform3D.columns(
                translation=places, mat3x3=_fixed(matrices.astype(np.float32), _MATRIX)
            )
            self._recording.send_columns(entity, time_columns(at, start), columns)
        for entity, lines in self._lines.items():
            at = np.array([at for at, _ in lines], np.int64)
            counts = np.array([len(points) for _, points in lines], np.int64)
            points = np.array([point for _, points in lines for point in points], np.float64)
            self._recording.send_columns(entity, time_columns(at, start), strips_of(counts, points))
        self._frames.clear()
        self._lines.clear()


def strips_of(counts: Integers, points: Array) -> Any:
    """Column of one line in each row, with `counts` of the joined `points` (N, 2)."""
    offsets = pa.array(np.concatenate(([0], np.cumsum(counts))), pa.int32())
    flat = _fixed(points.astype(np.float32), _POINT)
    strips = pa.ListArray.from_arrays(offsets, flat, type=_STRIP)
    return rr.LineStrips2D.columns(strips=strips)


def _fixed(numbers: Array, kind: Any) -> Any:
    return pa.FixedSizeListArray.from_arrays(pa.array(numbers.ravel(), pa.float32()), type=kind)
