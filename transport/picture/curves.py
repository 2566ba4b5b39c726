"""Curves and states over time, by the table of panels."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from transport.columns import Array
from transport.panels import (
    LATE,
    LOSSES,
    OK,
    PANELS,
    SILENT,
    SLOW_CURVE_NS,
    Colour,
    Panel,
    Series,
    colour_of,
    flagged,
    panels_of,
)
from transport.picture.blueprint import TIMELINE, Detail
from transport.topics import counts_as_loss, valid_at
from vehicles.messages import LinkVerdict, Message, Tracking
from vehicles.schedule import MILLISECOND, SECOND, Timer

# ---- State of a directed link in each half second, by the instants of the verdicts
#
# A window ends when the receiver's own messages pass its end, so a slow recorder or reader does not
# make a link look silent.


WINDOW_NS = SECOND // 2
MARGIN_NS = 100 * MILLISECOND
"""Delay after the end of a window before it is evaluated: verdicts and poses of a vehicle arrive on
different topics."""


def message_state(verdict: LinkVerdict) -> str:
    """State of a message: "ok", "lost", "late", or "" if the link did not carry it."""
    if verdict.outcome == "dropped":
        return "lost" if counts_as_loss(verdict.reason) else ""
    return LATE if verdict.late else OK


class LinkWindow(NamedTuple):
    """State of a link in the half second that begins at `at` (ns), and its loss ratio.

    The ratio is None if the link carried no message.
    """

    link: str
    at: int
    state: str
    loss_ratio: float | None


@dataclass(slots=True)
class WindowCounts:
    ok: int = 0
    lost: int = 0
    late: int = 0


@dataclass(slots=True)
class _Link:
    """The next window of a link, and counts by window."""

    start: int
    counts: dict[int, WindowCounts] = field(default_factory=dict)


@dataclass(slots=True)
class LinkStates:
    """All links, by receiver."""

    receivers: dict[str, dict[str, _Link]] = field(default_factory=dict)

    def count(self, link: str, verdict: LinkVerdict) -> None:
        """Count a verdict in the window of the tick at which it was made."""
        state = message_state(verdict)
        if not state:
            return
        start = verdict.received_at_ns // WINDOW_NS * WINDOW_NS
        links = self.receivers.setdefault(verdict.vehicle, {})
        entry = links.setdefault(link, _Link(start))
        counts = entry.counts.setdefault(max(start, entry.start), WindowCounts())
        setattr(counts, state, getattr(counts, state) + 1)

    def passed(self, receiver: str, now: int) -> Iterator[LinkWindow]:
        """Yield the windows into `receiver` that have ended at its instant `now` (ns)."""
        for link, entry in self.receivers.get(receiver, {}).items():
            while entry.start + WINDOW_NS + MARGIN_NS <= now:
                counts = entry.counts.pop(entry.start, WindowCounts())
                yield window_of(link, entry.start, counts)
                entry.start += WINDOW_NS


def window_of(link: str, at: int, counts: WindowCounts) -> LinkWindow:
    """State of the window of a link that begins at instant `at` (ns)."""
    carried = counts.ok + counts.lost + counts.late
    if not carried:
        return LinkWindow(link, at, SILENT, None)
    share = counts.lost / carried
    if counts.lost:
        tenths = 10 if share == 1.0 else min(max(round(10.0 * share), 1), 9)
        return LinkWindow(link, at, LOSSES[tenths - 1], share)
    return LinkWindow(link, at, LATE if counts.late else OK, 0.0)


# ---- Curves


SIGMAS = 3.0  # Half-width of a band in standard deviations
BAND_ALPHA = 70  # Opacity (of 255) of a band's line; bands overlap
BAND = "/band"  # Suffix of the name of a band


def time_columns(at: Array, start: int) -> list[rr.TimeColumn]:
    """Instants (ns) on both timelines; the run began at `start`."""
    return [
        rr.TimeColumn(TIMELINE, duration=(at - start).astype("timedelta64[ns]")),
        rr.TimeColumn("time", timestamp=at.astype("datetime64[ns]")),
    ]


class Curves:
    """Curves, sent in batches at a tenth of the cost of single values.

    A curve's name is its vehicle or link, or begins with the vehicle and a slash.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._curves: dict[str, tuple[list[int], list[float]]] = {}
        self._variances: dict[str, list[float]] = {}

    def has(self, quantity: str, name: str) -> bool:
        return f"plots/{quantity}/{name}" in self._curves

    def start(
        self, quantity: str, name: str, label: str, colour: Colour, width: float = 1.5
    ) -> None:
        """Set label, colour and width of a curve, before its first value."""
        entity = f"plots/{quantity}/{name}"
        self._curves[entity] = ([], [])
        style = rr.SeriesLines(colors=[colour], names=[label], widths=[width])
        self._recording.log(entity, style, static=True)

    def start_band(self, quantity: str, name: str, label: str, colour: Colour) -> None:
        """Set label and colour of a band around a curve, before its first value."""
        entity = f"plots/{quantity}/{name}"
        self._curves[entity], self._variances[entity] = ([], []), []
        style = rr.Measurements.from_fields(
            colors=[(*colour, BAND_ALPHA)], names=[label], widths=[0.5]
        )
        self._recording.log(entity, style, static=True)

    def add_band(self, quantity: str, name: str, at: int, value: float, width: float) -> None:
        """Add a value and the half-width of its band."""
        self.add(quantity, name, at, value)
        # The viewer draws one standard deviation.
        self._variances[f"plots/{quantity}/{name}"].append(width * width)

    def add(self, quantity: str, name: str, at: int, value: float) -> None:
        times, values = self._curves[f"plots/{quantity}/{name}"]
        times.append(at)
        values.append(value)

    def send(self, start: int) -> None:
        """Send the values since the last call; the run began at instant `start` (ns)."""
        for entity, (times, values) in self._curves.items():
            if times:
                variances = self._variances.get(entity)
                self._send(
                    entity,
                    np.array(times, np.int64),
                    np.array(values),
                    None if variances is None else np.array(variances),
                    start,
                )
                times.clear()
                values.clear()
                if variances:
                    variances.clear()

    def _send(
        self, entity: str, at: Array, values: Array, variances: Array | None, start: int
    ) -> None:
        if variances is None:
            columns = rr.Scalars.columns(scalars=values)
        else:
            columns = rr.Measurements.columns(values=values, variances=variances)
        self._recording.send_columns(entity, time_columns(at, start), columns)


class States:
    """Strips of states, logged when they change."""

    def __init__(self, recording: rr.RecordingStream, set_time: Callable[[int], None]) -> None:
        """`set_time` moves the recording to an instant (ns)."""
        self._recording = recording
        self._set_time = set_time
        self._states: dict[str, str] = {}

    def show(self, panel: str, name: str, state: str, at: int) -> None:
        """Show a state of `panel` from instant `at` (ns) on."""
        entity = f"{panel}/{name}"
        before = self._states.get(entity)
        if before == state:
            return
        if before is None:
            self._log_style(entity, PANELS[panel])
        self._states[entity] = state
        self._set_time(at)
        self._recording.log(entity, rr.StateChange(state=state))

    def _log_style(self, entity: str, panel: Panel) -> None:
        names, colours = list(panel.states), list(panel.states.values())
        style = rr.StateConfiguration(values=names, labels=names, colors=colours)
        self._recording.log(entity, style, static=True)


class PanelSeries:
    """Draws the fields of messages into the panels that show them."""

    def __init__(self, curves: Curves, states: States, detail: Detail) -> None:
        self._curves = curves
        self._states = states
        self._detail = detail
        self._links = LinkStates()
        self._panels: dict[type[Message], tuple[Panel, ...]] = {}
        self._timers: dict[tuple[str, str], Timer] = {}

    def draw(self, message: Message, place: int) -> None:
        kind, vehicle, at = type(message), message.vehicle, valid_at(message)
        panels = self._panels.get(kind)
        if panels is None:
            panels = self._panels[kind] = tuple(panels_of(kind))
        in_detail = vehicle in self._detail
        for panel in panels:
            if not (in_detail or panel.every_vehicle) or (not place and panel.lead == "absent"):
                continue
            if panel.period_ns and not self._is_due(panel.name, vehicle, panel.period_ns, at):
                continue
            for series in panel.series:
                if series.each_other:
                    self._add_others(panel, series, message, place)
                elif series.first_follower or place > 1:
                    value = getattr(message, series.field)
                    self._add(panel, series, message, place, value)

    def _is_due(self, panel: str, name: str, period_ns: int, at: int) -> bool:
        timer = self._timers.get((name, panel))
        if timer is None:
            timer = self._timers[name, panel] = Timer(period_ns)
        return timer.is_due(at)

    def _add_others(self, panel: Panel, series: Series, message: Message, place: int) -> None:
        """Draw a value of each source that is neither lead nor predecessor."""
        if not isinstance(message, Tracking) or not message.other_sources:
            return
        statuses = message.statuses()
        states = panel.kind == "states"
        values = statuses.values() if states else getattr(message, series.field)
        for source, value in zip(statuses, values, strict=True):
            self._add(panel, replace(series, name=source), message, place, value)

    def _add(self, panel: Panel, series: Series, message: Message, place: int, value: Any) -> None:
        at = valid_at(message)
        name = f"{message.vehicle}/{series.name}" if series.name else message.vehicle
        if panel.kind == "states":
            if series.flag and getattr(message, series.flag):
                value = flagged(value, series.flag)
            self._states.show(panel.name, name, value, at)
            return
        value *= panel.factor
        if not math.isfinite(value):  # such as an unknown age
            return
        if not self._curves.has(panel.name, name):
            label, colour = series.label_of(message.vehicle), series.colour_at(place)
            self._curves.start(panel.name, name, label, colour, series.width)
        self._curves.add(panel.name, name, at, value)
        if series.deviation:
            self._add_band(panel, series, message, place, value)

    def _add_band(
        self, panel: Panel, series: Series, message: Message, place: int, value: float
    ) -> None:
        """Draw three standard deviations around a value, if known."""
        vehicle, at = message.vehicle, valid_at(message)
        width = SIGMAS * panel.factor * getattr(message, series.deviation)
        name = vehicle + BAND
        if not (math.isfinite(width) and self._is_due(panel.name, name, SLOW_CURVE_NS, at)):
            return
        if not self._curves.has(panel.name, name):
            colour = series.colour_at(place)
            self._curves.start_band(panel.name, name, f"{vehicle} ± {SIGMAS:.0f}σ", colour)
        self._curves.add_band(panel.name, name, at, value, width)

    def count(self, verdict: LinkVerdict) -> None:
        """Show the state of a message, and count it for the state of its link."""
        link = link_name(verdict.sender, verdict.vehicle)
        self._links.count(link, verdict)
        state = message_state(verdict)
        if state:
            self._states.show("messages", link, state, verdict.received_at_ns)

    def show_links(self, receiver: str, place: int, at: int) -> None:
        """Show the states of the links into the vehicle at `place`, up to its instant `at` (ns)."""
        for window in self._links.passed(receiver, at):
            self._states.show("links", window.link, window.state, window.at)
            if window.loss_ratio is not None:
                percent = PANELS["loss"].factor * window.loss_ratio
                if not self._curves.has("loss", window.link):
                    label = window.link.replace("_to_", " → ")
                    self._curves.start("loss", window.link, label, colour_of(place))
                self._curves.add("loss", window.link, window.at, percent)


def link_name(sender: str, receiver: str) -> str:
    """Name of a link in an entity's path, in which the viewer would escape an arrow."""
    return f"{sender}_to_{receiver}"
