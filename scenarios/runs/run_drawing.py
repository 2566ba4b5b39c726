"""Draws a running run with its true errors, gaps and events in Rerun.

Import this module only for a picture: it loads Rerun, an extra.
"""

from collections.abc import Sequence
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.review import batch_of, recording_id, scene_of
from scenarios.results.tables import Collector
from scenarios.runs.live import LiveRun
from transport.closing import Closing
from transport.columns import Columns, joined
from transport.picture.batch import BATCH_NS, DRAWN_TOPICS
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from transport.topics import TOPICS
from vehicles.messages import Message

DRAWN_KINDS: frozenset[type[Message]] = frozenset(TOPICS[topic].message for topic in DRAWN_TOPICS)
LATEST = 2**62


class RunDrawing(Closing):
    """Picture of a running run: an observer of its messages, and a watcher of its metrics.

    It draws what came since the last evaluation at once. `destination` describes to the user where
    it is shown.
    """

    kinds = DRAWN_KINDS

    def __init__(self, view: RerunView, vehicles: Sequence[str]) -> None:
        self.destination = view.destination
        self._view = view
        self._vehicles = vehicles
        self._collector = Collector(DRAWN_KINDS)
        self._ahead: dict[tuple[str, str], Columns] = {}
        self._until = 0
        self._marked: set[tuple[object, ...]] = set()
        self._last: LiveRun | None = None

    def listen(self, at: int, message: Message) -> None:
        """Take a message recorded at an instant (ns)."""
        self._collector.listen(at, message)

    def update(self, live: LiveRun) -> None:
        self._last = live
        start = live.window.beginning
        self._draw(live, start + (live.evaluated_until + 1 - start) // BATCH_NS * BATCH_NS)

    def _draw(self, live: LiveRun, until: int) -> None:
        """Draw the rows before an instant (ns), and the events that are new."""
        run, tables = live.window, self._rows_until(until)
        known = [event for event in live.events if event.at_ns < until]
        new = [event for event in known if event.key not in self._marked]
        self._marked |= {event.key for event in new}
        self._view.draw(batch_of(run, new, tables, (self._until, until), self._vehicles))
        self._until = until

    def _rows_until(self, until: int) -> dict[tuple[str, str], Columns]:
        """Take the rows before an instant (ns); the others are drawn later."""
        taken, ahead, drawn = self._collector.take(), self._ahead, {}
        self._ahead = {}
        for key in {**ahead, **taken}:
            whole = joined([part[key] for part in (ahead, taken) if key in part])
            drawn[key] = whole.of(whole.at_ns < until)
            self._ahead[key] = whole.of(whole.at_ns >= until)
        return drawn

    def close(self) -> None:
        """Draw all that is left, and end the picture."""
        if self._last is not None:
            self._draw(self._last, LATEST)
        self._view.close()


def open_drawing(option: RerunOption, scenario: Scenario, log: Path) -> RunDrawing:
    """Open the picture of a run of `scenario`; raises ViewerError."""
    scene = scene_of(scenario, scenario.vehicle_names)
    view = RerunView(option, recording_id=recording_id(log), scene=scene, title=scenario.title)
    return RunDrawing(view, scenario.vehicle_names)
