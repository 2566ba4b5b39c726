"""True errors and events of a recorded run, with the places in the log at which they are known."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from scenarios.results.events.encounters import Episode
from scenarios.results.recorded.column_messages import in_order, messages_of
from scenarios.results.stream import FigureStream
from transport.columns import Array, Columns, Integers
from transport.topics import TOPICS
from vehicles.geometry.driven_path import CrossTrack


class ErrorColumns(NamedTuple):
    """True errors (N) of a vehicle, and the place in the log from which each of them is known."""

    vehicle: str
    order: Integers
    at_ns: Integers
    error_m: Array

    def within(self, span: tuple[int, int]) -> "ErrorColumns":
        rows = (self.at_ns >= span[0]) & (self.at_ns <= span[1])
        return ErrorColumns(self.vehicle, *(column[rows] for column in self[1:]))

    def latest_before(self, places: Integers) -> list[float]:
        """Latest error before each of some places in the log; NaN before the first."""
        latest = np.concatenate(([np.nan], self.error_m))
        found: list[float] = latest[np.searchsorted(self.order, places)].tolist()
        return found


class OrderedFigures(NamedTuple):
    """Errors by vehicle, and events with the place in the log at which they are certain."""

    errors: Mapping[str, ErrorColumns]
    events: list[tuple[int, Episode]]


def ordered_figures(
    stream: FigureStream, columns: Mapping[tuple[str, str], Columns], *, has_events: bool
) -> OrderedFigures:
    """Pass the messages of a log to `stream`, of which events are requested with `has_events`."""
    errors: list[CrossTrack] = []
    events: list[Episode] = []
    stream.on_error(errors.append)
    topics = {"start", "truth"}
    if has_events:
        stream.on_event(events.append)
        topics.add("tracking")
    error_places: list[int] = []
    event_places: list[int] = []
    place = 0
    merged = [rows for (_, topic), rows in columns.items() if topic in topics and len(rows)]
    for place, _ in in_order(merged, [_listener(stream, rows, has_events) for rows in merged]):
        error_places += [place] * (len(errors) - len(error_places))
        event_places += [place] * (len(events) - len(event_places))
    stream.finish()
    event_places += [place] * (len(events) - len(event_places))
    return OrderedFigures(
        _by_vehicle(errors, error_places), list(zip(event_places, events, strict=True))
    )


def _listener(stream: FigureStream, columns: Columns, has_events: bool) -> Iterator[None]:
    """Pass one message to `stream` at each step; of followers without events only the place."""
    if has_events or columns.topic != "truth" or columns.vehicle not in stream.followers:
        for message in messages_of(columns, TOPICS[columns.topic].message):
            stream.listen(0, message)
            yield
    else:
        places = (columns.at_ns, columns["east_m"], columns["north_m"])
        for at, east, north in zip(*(column.tolist() for column in places), strict=True):
            stream.add_place(columns.vehicle, at, east, north)
            yield


def _by_vehicle(errors: list[CrossTrack], places: list[int]) -> dict[str, ErrorColumns]:
    vehicle = np.array([foot.vehicle for foot in errors], object)
    order = np.array(places, np.int64)
    at = np.array([foot.at_ns for foot in errors], np.int64)
    lateral = np.array([foot.lateral for foot in errors], np.float64)
    return {
        name: ErrorColumns(name, order[rows], at[rows], lateral[rows])
        for name in dict.fromkeys(vehicle.tolist())
        for rows in [vehicle == name]
    }
