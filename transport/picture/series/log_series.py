"""Curves and states of a log by columns; the rows are those that `PanelSeries` draws one by one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from transport.colours import colour_of
from transport.columns import Array, Columns, Integers
from transport.panels import LATE, OK, PANELS, SLOW_CURVE_NS, Panel, Series, flagged, panels_of
from transport.picture.detail import Detail
from transport.picture.series.curves import BAND, SIGMAS, Curves, States, link_name
from transport.picture.series.link_states import (
    MARGIN_NS,
    WINDOW_NS,
    LinkWindow,
    WindowCounts,
    state_of,
    window_of,
)
from transport.topics import TOPICS
from vehicles.messages import statuses_in


def due(at: Integers, period_ns: int) -> Integers:
    """Rows at which a timer of `period_ns` that is polled at `at` (ns) fires."""
    if period_ns <= 0:
        return np.arange(len(at))
    rows: list[int] = []
    due_at = 0
    for row, now in enumerate(at.tolist()):
        if now >= due_at:
            due_at = now + period_ns
            rows.append(row)
    return np.array(rows, np.int64)


class LogSeries:
    """Draws the panels of a log whose run began at `start` (ns)."""

    def __init__(self, curves: Curves, states: States, detail: Detail, start: int) -> None:
        self._curves, self._states, self._detail = curves, states, detail
        self._start = start

    def draw(self, columns: Columns, place: int) -> None:
        """Draw the messages of one topic of the vehicle at `place` of the convoy."""
        due_rows: dict[int, Columns] = {}
        for panel in panels_of(TOPICS[columns.topic].message):
            if not (columns.vehicle in self._detail or panel.every_vehicle):
                continue
            if not place and panel.lead == "absent":
                continue
            if panel.period_ns not in due_rows:
                due_rows[panel.period_ns] = columns.of(due(columns.at_ns, panel.period_ns))
            for series in panel.series:
                rows = due_rows[panel.period_ns]
                if series.each_other:
                    self._add_others(panel, series, rows, place)
                elif series.first_follower or place > 1:
                    self._add(panel, series, rows, place, rows[series.field])

    def _add_others(self, panel: Panel, series: Series, columns: Columns, place: int) -> None:
        """Draw the values of each source that is neither lead nor predecessor."""
        columns = columns.of(columns["other_sources"] != "")
        texts = columns["other_sources"]
        for number, source in enumerate(statuses_in(texts[0]) if len(texts) else ()):
            if panel.kind == "states":
                states = {text: statuses_in(text)[source] for text in set(texts.tolist())}
                values = np.array([states[text] for text in texts], object)
            else:
                values = columns.lists[series.field].nth(number)
            self._add(panel, replace(series, name=source), columns, place, values)

    def _add(
        self, panel: Panel, series: Series, columns: Columns, place: int, values: Array
    ) -> None:
        vehicle, at = columns.vehicle, columns.at_ns
        name = f"{vehicle}/{series.name}" if series.name else vehicle
        if panel.kind == "states":
            if series.flag:
                raised = columns[series.flag]
                values = values.copy()
                values[raised] = [flagged(value, series.flag) for value in values[raised]]
            self._states.show_all(panel.name, name, values, at, self._start)
            return
        values = values * panel.factor
        known = np.isfinite(values)
        if not known.any():
            return
        label, colour = series.label_of(vehicle), series.colour_at(place)
        self._curves.start(panel.name, name, label, colour, series.width)
        self._curves.send_all(panel.name, name, at[known], values[known], start=self._start)
        if not series.deviation:
            return
        width = SIGMAS * panel.factor * columns[series.deviation]
        known &= np.isfinite(width)
        shown = np.flatnonzero(known)[due(at[known], SLOW_CURVE_NS)]
        if len(shown):
            band = vehicle + BAND
            self._curves.start_band(panel.name, band, f"{vehicle} ± {SIGMAS:.0f}σ", colour)
            self._curves.send_all(
                panel.name, band, at[shown], values[shown], start=self._start, width=width[shown]
            )

    def draw_links(self, verdicts: Columns, truth: Columns, place: int) -> None:
        """Draw the messages and the links into the vehicle at `place`.

        Windows of the links end when the true poses pass their end.
        """
        receiver = verdicts.vehicle
        if receiver not in self._detail:
            return
        looks = due(truth.at_ns, SLOW_CURVE_NS)
        looked = truth.at_ns[looks], truth.order[looks]
        states = _message_states(verdicts)
        for sender in dict.fromkeys(verdicts["sender"].tolist()):
            rows = np.flatnonzero((verdicts["sender"] == sender) & (states != ""))
            if len(rows):
                link = link_name(sender, receiver)
                at = verdicts["received_at_ns"][rows]
                self._states.show_all("messages", link, states[rows], at, self._start)
                windows = _windows(link, states[rows], at, verdicts.order[rows], looked)
                self._draw_windows(link, windows, place)

    def _draw_windows(self, link: str, windows: Sequence[LinkWindow], place: int) -> None:
        at = np.array([window.at for window in windows], np.int64)
        states = np.array([window.state for window in windows], object)
        self._states.show_all("links", link, states, at, self._start)
        ratios = np.array([window.loss_ratio for window in windows], np.float64)  # None: NaN
        known = np.isfinite(ratios)
        if known.any():
            self._curves.start("loss", link, link.replace("_to_", " → "), colour_of(place))
            percent = PANELS["loss"].factor * ratios[known]
            self._curves.send_all("loss", link, at[known], percent, start=self._start)


def _message_states(verdicts: Columns) -> Array:
    """State of each message, empty if the link did not carry it."""
    rows = zip(*(verdicts[name].tolist() for name in ("outcome", "reason", "late")), strict=True)
    known: dict[tuple[str, str, bool], str] = {}
    states = np.empty(len(verdicts), object)
    for number, row in enumerate(rows):
        state = known.get(row)
        if state is None:
            state = known[row] = state_of(*row)
        states[number] = state
    return states


def _windows(
    link: str, states: Array, at: Integers, order: Integers, looked: tuple[Integers, Integers]
) -> list[LinkWindow]:
    """Windows of a link, from its messages at instants `at` and places `order` of the log.

    `looked` are the instants and places at which the receiver evaluates the windows that have
    ended. A message that is recorded later counts in the next window.
    """
    look_at, look_order = (column[looked[1] > order[0]] for column in looked)
    start = int(at[0]) // WINDOW_NS * WINDOW_NS
    passed = int(look_at.max(initial=0)) - start - WINDOW_NS - MARGIN_NS
    starts = start + WINDOW_NS * np.arange(max(0, passed // WINDOW_NS + 1))
    newest = np.maximum.accumulate(look_at)
    evaluated = look_order[np.searchsorted(newest, starts + WINDOW_NS + MARGIN_NS)]
    window = np.maximum((at - start) // WINDOW_NS, np.searchsorted(evaluated, order))
    counts = {
        state: np.bincount(window[states == state], minlength=len(starts))
        for state in (OK, "lost", LATE)
    }
    return [
        window_of(link, begin, WindowCounts(*numbers))
        for begin, *numbers in zip(
            starts.tolist(), *(counts[state].tolist() for state in counts), strict=False
        )
    ]
