"""Draws a recorded run from the columns of its log."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import chain, pairwise
from math import isnan
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scenarios.results.events.encounters import Episode
from scenarios.results.pictures.lead_in import with_lead_in
from scenarios.results.pictures.ordered_figures import ErrorColumns, ordered_figures
from scenarios.results.recorded.column_messages import in_order, messages_of
from scenarios.results.recorded.true_figures import true_gaps
from scenarios.results.stream import FigureStream
from transport.columns import Columns, Integers
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.panels import drawn_fields
from transport.picture.view import RerunView
from transport.topics import RUN_SENDER, TOPICS
from vehicles.messages import Message
from vehicles.schedule import MILLISECOND, SECOND

Key = tuple[str, str]
SEND_NS = 500 * MILLISECOND
"""Period of marking the vehicle that is furthest off, as live."""
FIRST = frozenset({"truth", "log", "change", "start", "end"})
"""Topics that are drawn first."""
EARLIEST, LATEST = -(2**62), 2**62


class Excerpt(NamedTuple):
    """Part of a run to draw: seconds from its start, and vehicles (None: all)."""

    from_s: float | None = None
    to_s: float | None = None
    vehicles: Sequence[str] | None = None

    def with_lead(self, convoy: Sequence[str], log: Path) -> "Excerpt":
        """The same with the lead, in the order of the convoy; raises LogError for other names."""
        if self.vehicles is None:
            return self
        if unknown := set(self.vehicles) - set(convoy):
            names = ", ".join(sorted(unknown))
            raise LogError(f"{log}: holds no vehicle {names}; it has {', '.join(convoy)}")
        chosen = [name for name in convoy if name == convoy[0] or name in self.vehicles]
        return self._replace(vehicles=chosen)

    def shows(self, vehicle: str) -> bool:
        return self.vehicles is None or vehicle in {*self.vehicles, RUN_SENDER}

    def check(self, start: int, reader: LogReader) -> None:
        """Raise LogError if nothing was recorded in this part of a run that began at `start`."""
        first, last = self.span(start)
        if first > last or first > reader.last_at or last < start:
            end_s = (reader.last_at - start) / SECOND
            raise LogError(
                f"{reader.path}: nothing is recorded from {self.from_s or 0.0:g} to "
                f"{end_s if self.to_s is None else self.to_s:g} s; the log ends at {end_s:.2f} s"
            )

    def span(self, start: int) -> tuple[int, int]:
        """First and last instant (ns) of a run that began at `start`."""
        first = EARLIEST if self.from_s is None else start + round(self.from_s * SECOND)
        last = LATEST if self.to_s is None else start + round(self.to_s * SECOND)
        return first, last


WHOLE_RUN = Excerpt()


class LogDrawing:
    """Draws a log into a view: positions and events in its order, everything else by columns.

    `stream` computes the true errors and, with `has_events`, the events, which need the true poses
    from the start of the run on.
    """

    def __init__(
        self, reader: LogReader, view: RerunView, stream: FigureStream, *, has_events: bool
    ) -> None:
        self._reader, self._view, self._stream = reader, view, stream
        self._has_events = has_events

    def draw(self, excerpt: Excerpt, progress: Callable[[float], None] = lambda _: None) -> int:
        """Draw part of the run, and report the share done; returns the number of messages.

        Cars, errors and gaps are sent first; the rest is read and sent after them. Of the true
        poses before the part those are read that the errors need, all of them if there are events.
        """
        start = self._start()
        excerpt.check(start, self._reader)
        self._view.begin(start)
        span = excerpt.span(start)
        fields = _fields(has_events=self._has_events)
        first = FIRST | {"tracking"} if self._has_events else FIRST
        before = None if self._has_events else self._with_lead_in(span)
        columns = self._reader.columns(first, fields=fields, span_ns=span if before else None)
        progress(0.2)
        figures = ordered_figures(
            self._stream, columns if before is None else before, has_events=self._has_events
        )
        progress(0.35)
        shown = {key: _within(rows, span) for key, rows in columns.items() if excerpt.shows(key[0])}
        errors = [
            rows.within(span) for rows in figures.errors.values() if excerpt.shows(rows.vehicle)
        ]
        marks = [
            (order, event)
            for order, event in figures.events
            if span[0] <= event.at_ns <= span[1] and any(map(excerpt.shows, event.vehicles))
        ]
        self._draw_in_order(shown, self._ticks(shown, span), errors, marks)
        self._draw_gaps(columns if before is None else before, shown)
        del columns, before
        self._view.send_positions()
        progress(0.6)
        rest = self._reader.columns(TOPICS.keys() - first, fields=fields, span_ns=span)
        shown |= {key: rows for key, rows in rest.items() if excerpt.shows(key[0])}
        progress(0.75)
        count = sum(map(len, shown.values()))
        self._view.draw_columns(shown)
        progress(1.0)
        return count

    def _start(self) -> int:
        """Instant (ns) of the first start or true pose in the log."""
        reader, topics = self._reader, {"start": (), "truth": ()}
        soon = reader.first_at, reader.first_at + SECOND
        return _start_of(reader.columns(topics, fields=topics, span_ns=soon)) or _start_of(
            reader.columns(topics, fields=topics)
        )

    def _with_lead_in(self, span: tuple[int, int]) -> Mapping[Key, Columns] | None:
        if span == (EARLIEST, LATEST):
            return None
        return with_lead_in(self._reader, list(self._stream.sizes), span)

    def _ticks(
        self, columns: Mapping[Key, Columns], span: tuple[int, int]
    ) -> tuple[Integers, Integers]:
        """Places in the log and instants (ns) of every message after half a second, and of ends."""
        order, now = self._reader.places(TOPICS, span_ns=span)
        chosen: list[int] = []
        row = 0
        while row < len(now):
            chosen.append(row)
            row = int(np.searchsorted(now, now[row] + SEND_NS))
        ends = [
            np.searchsorted(order, rows.order).tolist()
            for rows in columns.values()
            if rows.topic == "end"
        ]
        numbers = np.array(sorted({*chosen, *chain(*ends)}), np.int64)
        return order[numbers], now[numbers]

    def _draw_in_order(
        self,
        shown: Mapping[Key, Columns],
        ticks: tuple[Integers, Integers],
        errors: Sequence[ErrorColumns],
        marks: Sequence[tuple[int, Episode]],
    ) -> None:
        """Draw what depends on the order of the messages.

        `ticks` are the places in the log and the instants of recording at which the vehicle
        furthest off is marked.
        """
        for rows in errors:
            self._view.errors(rows.vehicle, rows.at_ns, rows.error_m)
        newest = _newest(shown, ticks[0])
        latest = {rows.vehicle: rows.latest_before(ticks[0]) for rows in errors}
        left = list(zip(*(column.tolist() for column in ticks), newest, strict=True))
        left = list(enumerate(left))[::-1]
        marks_left = list(reversed(marks))

        def tick() -> None:
            number, (_, _, newest_at) = left.pop()
            known = {name: values[number] for name, values in latest.items()}
            known = {name: error for name, error in known.items() if not isnan(error)}
            self._view.mark_furthest(newest_at, known)

        def mark() -> None:
            _, event = marks_left.pop()
            self._view.mark(event.kind, event.at_ns, event.place, event.vehicles)

        for order, (now, message) in _merged(shown, self._view):
            while left and left[-1][1][0] < order:
                tick()
            while marks_left and marks_left[-1][0] < order:
                mark()
            self._view.draw(now, message)
            if left and left[-1][1][0] == order:
                tick()
        while left:
            tick()
        while marks_left:
            mark()

    def _draw_gaps(self, columns: Mapping[Key, Columns], shown: Mapping[Key, Columns]) -> None:
        sizes = self._stream.sizes
        for name, follower in pairwise(sizes):
            ahead, behind = columns.get((name, "truth")), shown.get((follower, "truth"))
            if ahead is not None and behind is not None and self._view.has_curves(follower):
                gaps = true_gaps(sizes, ahead, behind)
                known = np.isfinite(gaps)
                self._view.gaps(follower, behind.at_ns[known], gaps[known])


def _fields(*, has_events: bool) -> dict[str, Collection[str]]:
    """Fields that are drawn, by topic; all of the topics that are not listed."""
    fields: dict[str, Collection[str]]
    fields = {topic.name: drawn_fields(topic.message) for topic in TOPICS.values()}
    fields["verdict"] = {"sender", "outcome", "reason", "late"}
    pieces = ("east_m", "north_m", "yaw_rad", "curvature_per_m", "curvature_rate_per_m2")
    fields["trajectory"] = {
        *(f"piece_{name}" for name in (*pieces, "length_m")),
        *(f"sample_{name}" for name in ("east_m", "north_m", "source")),
    }
    for topic in ("truth", "log", "change", "start", "end"):
        del fields[topic]
    if has_events:
        del fields["tracking"]
    return fields


def _within(columns: Columns, span: tuple[int, int]) -> Columns:
    at = columns.logged_at_ns
    if not len(at) or (at[0] >= span[0] and at[-1] <= span[1]):
        return columns
    return columns.of((at >= span[0]) & (at <= span[1]))


def _start_of(columns: Mapping[Key, Columns]) -> int:
    """Instant (ns) of the first start or true pose in the log."""
    firsts = [
        (int(rows.order[0]), int(rows.at_ns[0]))
        for (_, topic), rows in columns.items()
        if topic in {"start", "truth"} and len(rows)
    ]
    return min(firsts, default=(0, 0))[1]


def _newest(columns: Mapping[Key, Columns], places: Integers) -> list[int]:
    """Newest true pose (ns) at each of some places in the log; 0 before the first."""
    truth = [rows for (_, topic), rows in columns.items() if topic == "truth"]
    order = np.concatenate([np.zeros(0, np.int64), *(rows.order for rows in truth)])
    at = np.concatenate([np.zeros(0, np.int64), *(rows.at_ns for rows in truth)])
    by_order = np.argsort(order)
    newest = np.concatenate(([0], np.maximum.accumulate(at[by_order])))
    found: list[int] = newest[np.searchsorted(order[by_order], places, side="right")].tolist()
    return found


def _merged(
    columns: Mapping[Key, Columns], view: RerunView
) -> Iterator[tuple[int, tuple[int, Message]]]:
    """Yield (place in the log, (instant of recording, message)) of the messages drawn in order.

    Of the true poses only those at which a car is drawn.
    """
    merged = [
        rows.of(view.moving_rows(rows.at_ns)) if topic == "truth" else rows
        for (_, topic), rows in columns.items()
        if topic in {"truth", "log", "change", "start", "end"} and len(rows)
    ]
    messages = (messages_of(rows, TOPICS[rows.topic].message) for rows in merged)
    timed = zip(merged, messages, strict=True)
    return in_order(
        merged, [zip(rows.logged_at_ns.tolist(), each, strict=True) for rows, each in timed]
    )
