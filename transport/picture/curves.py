"""Curves and states over time, by the table of panels."""

import math
from collections.abc import Callable

import numpy as np
import rerun as rr

from transport.colours import Colour
from transport.panels import PANELS, Panel, Series, flagged, panels_of
from transport.picture.blueprint import TIMELINE
from transport.picture.detail import Detail
from transport.picture.link_states import LinkStates, message_state
from transport.topics import valid_at
from vehicles.messages import LinkVerdict, Message
from vehicles.schedule import Timer


class Curves:
    """Curves, sent in batches at a tenth of the cost of single values.

    A curve's name is its vehicle, or begins with it and a slash; `colours` are by vehicle.
    """

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording
        self._curves: dict[str, tuple[list[int], list[float]]] = {}
        self.colours: dict[str, Colour] = {}

    def style(self, quantity: str, name: str, words: str, colour: Colour, width: float) -> None:
        """Set label, colour and width of a curve, before its first value."""
        entity = f"plots/{quantity}/{name}"
        if entity not in self._curves:
            self._curves[entity] = ([], [])
            self._log_style(entity, words, colour, width)

    def _log_style(self, entity: str, words: str, colour: Colour, width: float) -> None:
        style = rr.SeriesLines(colors=[colour], names=[words], widths=[width])
        self._recording.log(entity, style, static=True)

    def add(self, quantity: str, name: str, at: int, value: float) -> None:
        """Add a finite value at instant `at` (ns); others, such as unknown ages, are left out."""
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
        """Send the values since the last call; the run began at instant `start` (ns)."""
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


class States:
    """Strips of states, each of which is logged when it changes."""

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
        """Draw a message of the vehicle at `place` of the convoy."""
        kind, vehicle, at = type(message), message.vehicle, valid_at(message)
        panels = self._panels.get(kind)
        if panels is None:
            panels = self._panels[kind] = tuple(panels_of(kind))
        in_detail = vehicle in self._detail
        for panel in panels:
            if not (in_detail or panel.every_vehicle) or (not place and panel.lead == "absent"):
                continue
            if panel.period_ns and not self._is_due(panel, vehicle, at):
                continue
            for series in panel.series:
                if series.first_follower or place > 1:
                    self._add(panel, series, message, at)

    def _is_due(self, panel: Panel, vehicle: str, at: int) -> bool:
        timer = self._timers.get((vehicle, panel.name))
        if timer is None:
            timer = self._timers[vehicle, panel.name] = Timer(panel.period_ns)
        return timer.is_due(at)

    def _add(self, panel: Panel, series: Series, message: Message, at: int) -> None:
        name = f"{message.vehicle}/{series.name}" if series.name else message.vehicle
        value = getattr(message, series.field)
        if panel.kind == "states":
            if series.flag and getattr(message, series.flag):
                value = flagged(value, series.flag)
            self._states.show(panel.name, name, value, at)
            return
        if series.colour:
            self._curves.style(panel.name, name, series.label, series.colour, series.width)
        self._curves.add(panel.name, name, at, panel.factor * value)

    def count(self, verdict: LinkVerdict) -> None:
        """Show what became of a message, and count it for the state of its link."""
        link = f"{verdict.vehicle}/from_{verdict.sender}"
        self._links.count(link, verdict)
        state = message_state(verdict)
        if state:
            self._states.show("messages", link, state, verdict.received_at_ns)

    def show_links(self, receiver: str, at: int) -> None:
        """Show the states of the links into a vehicle, up to its own instant `at` (ns)."""
        for window in self._links.passed(receiver, at):
            self._states.show("links", window.link, window.state, window.at)
            if window.loss_ratio is not None:
                percent = PANELS["loss"].factor * window.loss_ratio
                self._curves.add("loss", window.link, window.at, percent)
