"""Draws a run with its true errors, gaps and events, live or from its log.

Import this module only for a picture: it loads Rerun, an extra.
"""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from zlib import crc32

import numpy as np

from scenarios.definition.scenario import Scenario
from scenarios.results.events import Event
from scenarios.results.live import LiveRun
from scenarios.results.tables import Collector, RunTables, Signal, Tables
from scenarios.results.true_motion import sizes_of
from scenarios.results.vehicle_figures import true_errors, true_gaps
from transport.closing import Closing
from transport.columns import Columns, joined
from transport.picture.batch import BATCH_NS, DRAWN_TOPICS, Batch, Mark, RunScene, VehicleValues
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from transport.topics import TOPICS
from vehicles.messages import Message

DEFAULT_SPACING_M = 15.0
DRAWN_KINDS: frozenset[type[Message]] = frozenset(TOPICS[topic].message for topic in DRAWN_TOPICS)
LATEST = 2**62


def batch_of(
    run: RunTables,
    events: Sequence[Event],
    tables: Tables,
    span: tuple[int, int],
    vehicles: Collection[str],
) -> Batch:
    """Batch of a picture: `tables`, `events`, errors and gaps from `span[0]` to before `span[1]`.

    Errors and gaps are those of `vehicles`; instants are ns.
    """
    names = [name for name in run.followers if name in vehicles]
    return Batch(
        start_ns=run.beginning,
        tables=tables,
        errors=_values(run, true_errors, names, span),
        gaps=_values(run, true_gaps, names, span),
        marks=[Mark(event.kind, event.at_ns, event.place, event.vehicles) for event in events],
    )


def _values(
    run: RunTables,
    signal: Callable[[RunTables, str], Signal],
    names: Sequence[str],
    span: tuple[int, int],
) -> dict[str, VehicleValues]:
    found = {}
    for name in names:
        at, values = signal(run, name)
        rows = (at >= span[0]) & (at < span[1]) & ~np.isnan(values)
        if rows.any():
            found[name] = VehicleValues(at[rows], values[rows])
    return found


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
    return RunDrawing(open_view(option, scenario, log), scenario.vehicle_names)


def open_view(
    option: RerunOption,
    scenario: Scenario,
    log: Path,
    *,
    vehicles: Sequence[str] | None = None,
) -> RerunView:
    """Open the view of a run of `scenario`; raises ViewerError.

    It shows `vehicles`, lead first, by default all.
    """
    scene = scene_of(scenario, vehicles or scenario.vehicle_names)
    return RerunView(option, recording_id=recording_id(log), scene=scene, title=scenario.title)


def scene_of(scenario: Scenario, vehicles: Sequence[str]) -> RunScene:
    """RunScene of some vehicles of a scenario, lead first."""
    path = scenario.route.path
    return RunScene(
        vehicles=vehicles,
        convoy=scenario.vehicle_names,
        spacing_m=widest_spacing(scenario),
        cars=sizes_of(scenario),
        path=(path.east.tolist(), path.north.tolist()),
        lane_m=scenario.tables.events.lane_width_m,
        duration_s=scenario.duration_s,
    )


def recording_id(log: Path) -> str:
    """Name under which a viewer keeps the run of a log apart from all others.

    Runs of one scenario and seed differ in their folders, and folders of one name in their paths.
    """
    path = log.resolve()
    return f"{path.parent.name}/{path.stem}-{crc32(str(path).encode()):08x}"


def widest_spacing(scenario: Scenario) -> float:
    """Largest spacing (m) of two vehicles, at the start or at top speed."""
    spacings = [*scenario.route.spacings[1:], 0.0]
    if scenario.tables.speed.followers == "gap":
        profile = scenario.route.profile
        top = max(profile.at(float(second))[0] for second in range(int(scenario.duration_s) + 2))
        places = range(1, len(scenario.vehicle_names))
        spacings += [scenario.spacing_policy(place).desired(top) for place in places]
    return max(spacings) or DEFAULT_SPACING_M
