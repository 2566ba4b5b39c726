"""Draws a recorded log: what moves message by message, the curves and trajectories by columns."""

from collections.abc import Mapping

import numpy as np

from transport.colours import colour_of, colours_of_sources
from transport.columns import Array, Columns, Integers
from transport.picture.recording_writer import SILENT_NS, SPACING_M, RecordingWriter
from transport.picture.series.curves import States
from transport.picture.series.log_series import LogSeries, due
from transport.picture.series.moving_rows import send_trajectories
from vehicles.messages import Message, TruePose
from vehicles.schedule import SECOND, Timer

SERIES = ("truth", "tracking", "command")  # Topics with curves or states


POSITIONS_NS = 20 * SECOND  # Time of positions sent together, so that a viewer starts soon


class LogRecordingWriter(RecordingWriter):
    """Draws the same rows as `RecordingWriter`, in a tenth of the time.

    `draw` takes the messages of `moving_rows`, texts and changes. `mark_furthest` is called twice a
    second, and the other methods draw the rest at any time.
    """

    def begin(self, start: int) -> None:
        """Set the start of the run (ns), before the first message."""
        self._start = start
        self._positions_timer = Timer(POSITIONS_NS)

    def moving_rows(self, at: Integers) -> Integers:
        """Numbers of the true poses of a vehicle, at instants `at` (ns), that `draw` needs.

        Those at which its car is drawn, and the last one before each time without poses.
        """
        last = np.diff(at, append=at[-1:] + 2 * SILENT_NS) > SILENT_NS // 2
        return np.union1d(due(at, self._car_ns), np.flatnonzero(last))

    def mark_furthest(self, newest_at: int, errors: Mapping[str, float]) -> None:
        """Mark the vehicle furthest off, by the errors (m) known at the newest pose (ns)."""
        self._errors = dict(errors)
        self._show_worst(newest_at)
        if self._positions_timer.is_due(newest_at):
            self.send_positions()

    def _draw_values(self, truth: TruePose) -> None:
        """Leave the curves to `draw_columns`."""

    def _send_due(self, now: int, message: Message) -> None:
        """Leave sending to the caller."""

    def send_positions(self) -> None:
        self._moving.send(self._start or 0)

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
                colours=np.array(colours_of_sources(place), np.uint8),
            )

    def errors(self, vehicle: str, at: Integers, errors: Array) -> None:
        if len(at) and vehicle in self.detail:
            self._largest_errors[vehicle] = float(np.abs(errors).max())
            self._add_curve("cross_track", vehicle, at, errors)

    def gaps(self, vehicle: str, at: Integers, gaps: Array) -> None:
        if len(at):
            self._add_curve("true_gap", vehicle, at, gaps)

    def _add_curve(self, quantity: str, vehicle: str, at: Integers, values: Array) -> None:
        self._curves.start(quantity, vehicle, vehicle, colour_of(self._place(vehicle)))
        self._curves.send_all(quantity, vehicle, at, values, start=self._start or 0)
