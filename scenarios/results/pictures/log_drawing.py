"""Draws a recorded run from the columns of its log."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scenarios.results.events.encounters import Episode
from scenarios.results.recorded.column_messages import messages_of
from scenarios.results.recorded.true_figures import true_gaps
from scenarios.results.stream import FigureStream
from transport.columns import Columns
from transport.log.reader import LogReader
from transport.panels import drawn_fields
from transport.picture.view import RerunView
from transport.topics import RUN_SENDER, TOPICS
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import MILLISECOND, SECOND

Key = tuple[str, str]
SEND_NS = 500 * MILLISECOND
"""Period of marking the vehicle that is furthest off, as live."""
EARLIEST, LATEST = -(2**62), 2**62


class Excerpt(NamedTuple):
    """Part of a run to draw: seconds from its start, and vehicles (None: all)."""

    from_s: float | None = None
    to_s: float | None = None
    vehicles: Sequence[str] | None = None

    def shows(self, vehicle: str) -> bool:
        return self.vehicles is None or vehicle in {*self.vehicles, RUN_SENDER}

    def span(self, start: int) -> tuple[int, int]:
        """First and last instant (ns) of a run that began at `start`."""
        first = EARLIEST if self.from_s is None else start + round(self.from_s * SECOND)
        last = LATEST if self.to_s is None else start + round(self.to_s * SECOND)
        return first, last


WHOLE_RUN = Excerpt()


class LogDrawing:
    """Draws a log into a view: positions and events in its order, everything else by columns.

    `stream` computes the true errors and, with `has_events`, the events. It needs the true poses
    from the start of the run on, also if only its end is drawn.
    """

    def __init__(
        self, reader: LogReader, view: RerunView, stream: FigureStream, *, has_events: bool
    ) -> None:
        self._reader, self._view, self._stream = reader, view, stream
        self._has_events = has_events
        self._errors: list[CrossTrack] = []
        self._episodes: list[Episode] = []
        stream.on_error(self._errors.append)
        if has_events:
            stream.on_event(self._episodes.append)

    def draw(self, excerpt: Excerpt, progress: Callable[[float], None] = lambda _: None) -> int:
        """Draw part of the run, and report the share done; returns the number of messages."""
        columns = self._reader.columns(TOPICS, fields=_fields(has_events=self._has_events))
        start = _start_of(columns)
        self._view.begin(start)
        span = excerpt.span(start)
        shown = {key: _within(rows, span) for key, rows in columns.items() if excerpt.shows(key[0])}
        progress(0.4)
        ticks = _ticks([_within(rows, span) for rows in columns.values()])
        self._draw_in_order(columns, ticks, excerpt, span)
        progress(0.7)
        self._view.draw_columns(shown)
        progress(0.9)
        self._draw_gaps(columns, shown)
        return sum(map(len, shown.values()))

    def _draw_in_order(
        self,
        columns: Mapping[Key, Columns],
        ticks: Sequence[tuple[int, int]],
        excerpt: Excerpt,
        span: tuple[int, int],
    ) -> None:
        """Draw what depends on the order of the messages."""
        left = list(reversed(ticks))
        for order, now, message in _merged(columns, has_events=self._has_events):
            if now > span[1]:
                break
            while left and left[-1][0] < order:
                self._view.send(left.pop()[1])
            self._stream.listen(now, message)
            if now >= span[0] and excerpt.shows(message.vehicle):
                if not isinstance(message, Tracking):
                    self._view.draw(now, message)
                if left and left[-1][0] == order:
                    self._view.send(left.pop()[1])
            if isinstance(message, TruePose):
                self._draw_figures(excerpt, span)
        for _, now in reversed(left):
            self._view.send(now)
        self._stream.finish()
        self._draw_figures(excerpt, span)

    def _draw_figures(self, excerpt: Excerpt, span: tuple[int, int]) -> None:
        """Draw the errors and events that have become known."""
        for foot in self._errors:
            if span[0] <= foot.at_ns and excerpt.shows(foot.vehicle):
                self._view.error(foot.vehicle, foot.at_ns, foot.lateral)
        for event in self._episodes:
            if span[0] <= event.at_ns and any(map(excerpt.shows, event.vehicles)):
                self._view.mark(event.kind, event.at_ns, event.place, event.vehicles)
        self._errors.clear()
        self._episodes.clear()

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
    for topic in ("truth", "trajectory", "log", "change", "start", "end"):
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


def _ticks(columns: Sequence[Columns]) -> list[tuple[int, int]]:
    """Messages, by place in the log and instant (ns), at which the furthest vehicle is marked."""
    order = np.concatenate([rows.order for rows in columns])
    by_order = np.argsort(order)
    order = order[by_order]
    now = np.concatenate([rows.logged_at_ns for rows in columns])[by_order]
    chosen: list[int] = []
    row = 0
    while row < len(now):
        chosen.append(row)
        row = int(np.searchsorted(now, now[row] + SEND_NS))
    ends = [rows.order for rows in columns if rows.topic == "end"]
    last = np.searchsorted(order, np.concatenate(ends)) if ends else np.zeros(0, np.int64)
    rows = sorted({*chosen, *last.tolist()})
    return list(zip(order[rows].tolist(), now[rows].tolist(), strict=True))


def _merged(
    columns: Mapping[Key, Columns], *, has_events: bool
) -> Iterator[tuple[int, int, Message]]:
    """Yield (place in the log, instant of recording, message) of the messages drawn in order."""
    topics = {"truth", "log", "change", "start", "end", *(["tracking"] if has_events else [])}
    merged = [rows for (_, topic), rows in columns.items() if topic in topics and len(rows)]
    order = np.concatenate([rows.order for rows in merged])
    by_order = np.argsort(order)
    source = np.repeat(np.arange(len(merged)), [len(rows) for rows in merged])[by_order]
    now = np.concatenate([rows.logged_at_ns for rows in merged])[by_order]
    messages = [messages_of(rows, TOPICS[rows.topic].message) for rows in merged]
    for place, at, number in zip(
        order[by_order].tolist(), now.tolist(), source.tolist(), strict=True
    ):
        yield place, at, next(messages[number])
