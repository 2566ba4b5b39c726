"""Curves over time, gathered value by value and sent in batches: a tenth of the cost."""

import math

import numpy as np
import rerun as rr

from transport.colours import Colour
from transport.picture.blueprint import TIMELINE


class Curves:
    """The values of all quantities that were not sent yet.

    A curve's name is its vehicle, or begins with it and a slash; `colours` has the colour of each
    vehicle before its first value comes.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._curves: dict[str, tuple[list[int], list[float]]] = {}
        self.colours: dict[str, Colour] = {}

    def style(self, quantity: str, name: str, words: str, colour: Colour, width: float) -> None:
        """Give a curve a name, colour and width of its own, before its first value comes."""
        entity = f"plots/{quantity}/{name}"
        if entity not in self._curves:
            self._curves[entity] = ([], [])
            self._log_style(entity, words, colour, width)

    def _log_style(self, entity: str, words: str, colour: Colour, width: float) -> None:
        style = rr.SeriesLines(colors=[colour], names=[words], widths=[width])
        self._recording.log(entity, style, static=True)

    def add(self, quantity: str, name: str, at: int, value: float) -> None:
        """Gather a value at instant `at` (ns); infinity, as an age unknown, is left out."""
        if not math.isfinite(value):
            return
        entity = f"plots/{quantity}/{name}"
        curve = self._curves.get(entity)
        if curve is None:
            curve = self._curves[entity] = ([], [])
            colour = self.colours[name.partition("/")[0]]
            self._log_style(entity, name.replace("/", " "), colour, 1.5)
        curve[0].append(at)
        curve[1].append(value)

    def send(self, start: int) -> None:
        """Send what was gathered; the run began at instant `start` (ns)."""
        for entity, (times, values) in self._curves.items():
            if times:
                at = np.array(times, dtype=np.int64)
                since_start = (at - start).astype("timedelta64[ns]")
                columns = [
                    rr.TimeColumn(TIMELINE, duration=since_start),
                    rr.TimeColumn("time", timestamp=at.astype("datetime64[ns]")),
                ]
                scalars = rr.Scalars.columns(scalars=values)
                self._recording.send_columns(entity, columns, scalars)
                times.clear()
                values.clear()
