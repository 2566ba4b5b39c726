"""Draws a recorded log: what moves message by message, the curves and trajectories by columns."""

from collections.abc import Mapping

import numpy as np

from transport.colours import colour_of
from transport.columns import Array, Columns, Integers
from transport.picture.recording_writer import SPACING_M, RecordingWriter
from transport.picture.series.curves import States
from transport.picture.series.log_series import LogSeries, due
from transport.picture.series.moving_rows import send_trajectories
from vehicles.messages import Message, TruePose

SERIES = ("truth", "tracking", "command")
"""Topics with curves or states."""


class LogRecordingWriter(RecordingWriter):
    """Draws the same rows as `RecordingWriter`, in a tenth of the time.

    `draw` takes messages of the topics `DRAWN` only, and `send` is called for the others, twice a
    second. `draw_columns` draws the rest.
    """

    def begin(self, start: int) -> None:
        """Set the start of the run (ns), before the first message."""
        self._start = start

    def _draw_values(self, truth: TruePose) -> None:
        """Leave the curves to `draw_columns`."""

    def _send_due(self, now: int, message: Message) -> None:
        """Leave sending to the caller."""

    def draw_columns(self, columns: Mapping[tuple[str, str], Columns]) -> None:
        """Draw the curves, states, links and trajectories of messages by (vehicle, topic)."""
        start = self._start or 0
        series = LogSeries(
            self._curves, States(self._recording, self._set_time), self.detail, start
        )
        for (vehicle, topic), rows in columns.items():
            if topic in SERIES and len(rows):
                series.draw(rows, self._place(vehicle))
            elif topic == "trajectory" and vehicle in self.detail:
                self._draw_trajectories(rows)
            elif topic == "verdict" and (vehicle, "truth") in columns:
                series.draw_links(rows, columns[vehicle, "truth"], self._place(vehicle))

    def _draw_trajectories(self, trajectories: Columns) -> None:
        rows = due(trajectories.at_ns, self._trajectory_ns)
        if len(rows):
            place = self._place(trajectories.vehicle)
            send_trajectories(
                self._recording,
                trajectories,
                rows,
                start=self._start or 0,
                spacing_m=SPACING_M,
                colours=np.array([colour_of(0), colour_of(max(place - 1, 0))], np.uint8),
            )

    def gaps(self, vehicle: str, at: Integers, gaps: Array) -> None:
        """Draw the true gaps (m) of a vehicle at instants `at` (ns)."""
        if len(at):
            self._curves.start("true_gap", vehicle, vehicle, colour_of(self._place(vehicle)))
            self._curves.send_all("true_gap", vehicle, at, gaps, start=self._start or 0)
