"""Curves and strips of states from tables, by the table of panels."""

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import rerun as rr

from transport.columns import Array, Columns, Integers
from transport.panels import (
    LATE,
    LOSSES,
    OK,
    PANELS,
    SILENT,
    SLOW_CURVE_NS,
    Panel,
    Series,
    colour_of,
    flagged,
)
from transport.picture.batch import BATCH_NS, Batch
from transport.picture.rows import RowSender
from transport.topics import counts_as_loss
from vehicles.messages import statuses_in
from vehicles.schedule import MILLISECOND

# ---- State of a directed link in each half second of run time


MARGIN_NS = 100 * MILLISECOND
"""Age of the receiver's pose from which a window is complete: verdicts and poses of a vehicle
arrive on different topics. A slow recorder or reader does not make a link look silent."""
LOST = "lost"
CARRIED = (OK, LOST, LATE)
TROUBLE = {SILENT: 1.0, LATE: 0.1}  # Of half a second on a link; else it is the loss ratio


def message_states(verdicts: Columns) -> Array:
    """State of each message (N): "ok", "lost", "late", or "" if the link did not carry it."""
    outcomes, reasons = verdicts["outcome"].tolist(), verdicts["reason"].tolist()
    dropped = {reason: LOST if counts_as_loss(reason) else "" for reason in set(reasons)}
    states = [
        dropped[reason] if outcome == "dropped" else LATE if late else OK
        for outcome, reason, late in zip(outcomes, reasons, verdicts["late"].tolist(), strict=True)
    ]
    return np.array(states, object)


def window_state(ok: int, lost: int, late: int) -> tuple[str, float]:
    """State of a link by the messages of half a second, and its loss ratio, NaN without any."""
    if not ok + lost + late:
        return SILENT, math.nan
    share = lost / (ok + lost + late)
    if lost:
        tenths = 10 if share == 1.0 else min(max(round(10.0 * share), 1), 9)
        return LOSSES[tenths - 1], share
    return LATE if late else OK, 0.0


# ---- Curves and states


SIGMAS = 3.0  # Half-width of a band in standard deviations
BAND_ALPHA = 70  # Opacity (of 255) of a band's line; bands overlap


class PanelSeries:
    """Draws the fields of tables into the panels that show them."""

    def __init__(
        self, sender: RowSender, detailed: Sequence[str], place_of: Callable[[str], int]
    ) -> None:
        """Draw `detailed` vehicles; `place_of` returns the position of a vehicle in the convoy."""
        self._sender = sender
        self._detailed = detailed
        self._place_of = place_of
        self._judged = Counter[tuple[str, str, int, str]]()
        self._following: dict[tuple[str, str], int] = {}  # next half second of each link
        self.link_troubles: defaultdict[str, float] = defaultdict(float)
        """Half seconds without messages on each link; those of a loss count by its ratio."""

    def draw(self, batch: Batch) -> None:
        for (vehicle, topic), columns in batch.tables.items():
            for panel in PANELS.values() if len(columns) else ():
                if panel.topic != topic or (not self._place_of(vehicle) and panel.lead == "absent"):
                    continue
                if vehicle in self._detailed or panel.every_vehicle:
                    self._draw_panel(panel, columns)
        for panel_name, figures in (("cross_track", batch.errors), ("true_gap", batch.gaps)):
            for vehicle, figure in figures.items():
                entity, colour = f"plots/{panel_name}/{vehicle}", colour_of(self._place_of(vehicle))
                self._sender.curve(entity, *figure, vehicle, colour)
        for verdicts in batch.of_topic("verdict"):
            if verdicts.vehicle in self._detailed:
                self._count(verdicts)
        for truth in batch.of_topic("truth"):
            self._draw_windows(truth.vehicle, int(truth.at_ns.max()))

    def _draw_panel(self, panel: Panel, columns: Columns) -> None:
        vehicle = columns.vehicle
        rows = self._sender.due(vehicle, panel.name, columns.at_ns, panel.period_ns)
        drawn = columns.of(rows) if len(rows) < len(columns) else columns
        for series in panel.series:
            if series.each_other:
                for source, at, values in _by_source(drawn, series.field):
                    self._draw_series(panel, replace(series, name=source), vehicle, at, values)
            elif series.first_follower or self._place_of(vehicle) > 1:
                values = drawn[series.field]
                if series.flag:
                    raised = [flagged(value, series.flag) for value in values.tolist()]
                    values = np.where(drawn[series.flag], np.array(raised, object), values)
                self._draw_series(panel, series, vehicle, drawn.at_ns, values)
            if series.deviation:
                self._draw_band(panel, series, drawn)

    def _draw_series(
        self, panel: Panel, series: Series, vehicle: str, at: Integers, values: Array
    ) -> None:
        name = f"{vehicle}/{series.name}" if series.name else vehicle
        if panel.kind == "states":
            self._sender.states(f"{panel.name}/{name}", at, values, panel.states)
            return
        label, colour = series.label_of(vehicle), series.colour_at(self._place_of(vehicle))
        entity, drawn = f"plots/{panel.name}/{name}", values * panel.factor
        self._sender.curve(entity, at, drawn, label, colour, width=series.width)

    def _draw_band(self, panel: Panel, series: Series, columns: Columns) -> None:
        """Draw a band of some standard deviations around a value."""
        vehicle, entity = columns.vehicle, f"plots/{panel.name}/{columns.vehicle}/band"
        values = panel.factor * columns[series.field]
        width = SIGMAS * panel.factor * columns[series.deviation]
        known = np.flatnonzero(np.isfinite(values) & np.isfinite(width))
        rows = known[self._sender.due(vehicle, "band", columns.at_ns[known], SLOW_CURVE_NS)]
        if rows.size:
            colours = [(*series.colour_at(self._place_of(vehicle)), BAND_ALPHA)]
            names = [f"{vehicle} ± {SIGMAS:.0f}σ"]
            style = rr.Measurements.from_fields(colors=colours, names=names, widths=[0.5])
            self._sender.style(entity, style)
            # The viewer draws one standard deviation.
            band = rr.Measurements.columns(values=values[rows], variances=width[rows] ** 2)
            self._sender.send(entity, columns.at_ns[rows], band)

    # ---- Links

    def _count(self, verdicts: Columns) -> None:
        """Draw the messages to a receiver, and count them by link and half second."""
        receiver, states = verdicts.vehicle, message_states(verdicts)
        senders = verdicts["sender"]
        for sender in dict.fromkeys(senders.tolist()):
            rows = np.flatnonzero((senders == sender) & (states != ""))
            at = verdicts.at_ns[rows]
            windows = ((at - self._sender.start) // BATCH_NS).tolist()
            if windows:
                self._following.setdefault((sender, receiver), windows[0])
            self._judged.update(
                (sender, receiver, *judged)
                for judged in zip(windows, states[rows].tolist(), strict=True)
            )
            name, title = _link(sender, receiver)
            colours = PANELS["messages"].states
            self._sender.states(f"messages/{name}", at, states[rows], colours, title)

    def _draw_windows(self, receiver: str, newest: int) -> None:
        """Draw the links to a receiver in each half second before its newest pose (ns)."""
        end = (newest - self._sender.start - MARGIN_NS) // BATCH_NS
        for sender in [one for one, to in self._following if to == receiver]:
            numbers = range(self._following[sender, receiver], end)
            if not numbers:
                continue
            self._following[sender, receiver] = end
            at = self._sender.start + BATCH_NS * np.array(numbers, np.int64)
            windows = [
                window_state(*(self._judged.pop((sender, receiver, k, one), 0) for one in CARRIED))
                for k in numbers
            ]
            states = np.array([state for state, _ in windows], object)
            losses = PANELS["loss"].factor * np.array([loss for _, loss in windows])
            name, title = _link(sender, receiver)
            self.link_troubles[name] += sum(TROUBLE.get(state, loss) for state, loss in windows)
            self._sender.states(f"links/{name}", at, states, PANELS["links"].states, title)
            colour = colour_of(self._place_of(receiver))
            self._sender.curve(f"plots/loss/{name}", at, losses, title, colour)


def _link(sender: str, receiver: str) -> tuple[str, str]:
    """Name of a link in an entity's path, where the viewer escapes an arrow, and its title."""
    return f"{sender}_to_{receiver}", f"{sender} → {receiver}"


def _by_source(tracking: Columns, name: str) -> Iterator[tuple[str, Integers, Array]]:
    """Yield instants and values of each source that is neither lead nor predecessor.

    Values are those of the field `name`, or the statuses for `other_sources`.
    """
    texts = tracking["other_sources"]
    parts: defaultdict[str, list[tuple[Integers, Array]]] = defaultdict(list)
    for text in dict.fromkeys(texts.tolist()):
        rows = np.flatnonzero(texts == text)
        for number, (source, status) in enumerate(statuses_in(text).items()):
            if name == "other_sources":
                values = np.full(rows.size, status, object)
            else:
                lists = tracking.lists[name]
                values = lists.values[lists.offsets[rows] + number]
            parts[source].append((rows, values))
    for source, found in parts.items():
        rows, values = map(np.concatenate, zip(*found, strict=True))
        order = np.argsort(rows)
        yield source, tracking.at_ns[rows[order]], values[order]
