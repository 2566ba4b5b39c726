"""Draws a run with its true figures and events, live or from its log."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, TypeVar
from zlib import crc32

import numpy as np

from scenarios.definition.scenario import Scenario
from scenarios.results.encounters import Episode
from scenarios.results.metrics import Metrics
from scenarios.results.stream import FigureStream, sizes_of
from scenarios.results.tables import Collector, Tables
from transport.closing import Closing
from transport.columns import joined
from transport.log.reader import LogReader
from transport.picture.batch import BATCH_NS, DRAWN_TOPICS, Batch, Mark, RunScene, VehicleValues
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from transport.topics import TOPIC_OF, TOPICS, valid_at
from vehicles.messages import Message, RunStart, TruePose
from vehicles.schedule import MILLISECOND

DEFAULT_SPACING_M = 15.0
PATIENCE_NS = 100 * MILLISECOND
"""How much later than the end of a batch a pose is when the batch is drawn: the messages of several
vehicles are mixed."""
DRAWN_KINDS: frozenset[type[Message]] = frozenset(TOPICS[topic].message for topic in DRAWN_TOPICS)
LATEST = 2**62


class BatchFigures:
    """Errors, gaps and events of a stream, and tables of the same messages, cut into batches."""

    def __init__(
        self, stream: FigureStream, vehicles: Collection[str], reader: LogReader | None = None
    ) -> None:
        """Collect figures of `vehicles`.

        The stream receives the messages of the log of `reader`; without it, others elsewhere.
        """
        self._stream, self._vehicles = stream, set(vehicles)
        self._errors: list[tuple[str, int, float]] = []
        self._gaps: list[tuple[str, int, float]] = []
        self._events: list[tuple[Episode, int]] = []
        self._ahead: Tables = {}
        errors, gaps, events = self._errors, self._gaps, self._events
        stream.on_error(lambda foot: errors.append((foot.vehicle, foot.at_ns, foot.lateral)))
        stream.on_gap(lambda gap: gaps.append((gap.vehicle, gap.now_at_ns, gap.now_m)))
        stream.on_event(lambda event: events.append((event, event.at_ns)))
        topics = [TOPIC_OF[kind].name for kind in stream.kinds]
        self._messages = reader.messages(topics) if reader else iter(())

    def batch(self, start: int, until: int, tables: Tables) -> Batch:
        """Take all with an instant before `until` (ns); the next batch has the rest.

        The last batch, until `LATEST`, has the events that are still open.
        """
        for at, _, message in self._messages:
            self._stream.listen(at, message)
            if at >= until:
                break
        if until == LATEST:
            self._stream.finish()
        ahead, self._ahead, drawn = self._ahead, {}, {}
        for key in {**ahead, **tables}:
            whole = joined([part[key] for part in (ahead, tables) if key in part])
            drawn[key] = whole.of(whole.at_ns < until)
            self._ahead[key] = whole.of(whole.at_ns >= until)
        marks = [
            Mark(event.kind, at, event.place, event.vehicles)
            for event, at in _taken(self._events, until)
            if not self._vehicles.isdisjoint(event.vehicles)
        ]
        errors, gaps = (self._values(_taken(one, until)) for one in (self._errors, self._gaps))
        return Batch(start_ns=start, tables=drawn, errors=errors, gaps=gaps, marks=marks)

    def _values(self, rows: list[tuple[str, int, float]]) -> dict[str, VehicleValues]:
        of: defaultdict[str, list[tuple[int, float]]] = defaultdict(list)
        for vehicle, at, value in rows:
            of[vehicle].append((at, value))
        return {
            name: VehicleValues(*map(np.array, zip(*of[name], strict=True)))
            for name in of
            if name in self._vehicles
        }


Row = TypeVar("Row", bound=tuple[Any, ...])


def _taken(rows: list[Row], until: int) -> list[Row]:
    """Remove the rows with an instant, their second value, before `until` (ns)."""
    taken = [row for row in rows if row[1] < until]
    rows[:] = [row for row in rows if row[1] >= until]
    return taken


class RunDrawing(Closing):
    """Picture of a running run; `draw` is an observer.

    The picture gets the messages and figures of half a second of run time at once. `destination`
    describes to the user where it is shown.
    """

    def __init__(self, view: RerunView, stream: FigureStream) -> None:
        """Draw into `view` with the figures of `stream`, which receives the messages elsewhere."""
        self.destination = view.destination
        self._view = view
        self._figures = BatchFigures(stream, stream.sizes) if view.enabled else None
        self._collector = Collector(DRAWN_KINDS)
        self._start: int | None = None
        self._until = 0

    def draw(self, now: int, message: Message) -> None:
        """Take a message recorded at instant `now` (ns)."""
        if self._figures is None:
            return
        if self._start is None and isinstance(message, RunStart | TruePose):
            self._start = valid_at(message)
            self._until = self._start + BATCH_NS
        if type(message) in DRAWN_KINDS:
            self._collector.listen(now, message)
        if isinstance(message, TruePose) and message.true_at_ns >= self._until + PATIENCE_NS:
            self._send(self._until)
            self._until += (message.true_at_ns - self._until) // BATCH_NS * BATCH_NS + BATCH_NS

    def _send(self, until: int) -> None:
        tables, self._collector = self._collector.tables(), Collector(DRAWN_KINDS)
        if self._figures is not None and self._start is not None:
            self._view.draw(self._figures.batch(self._start, until, tables))

    def finish(self) -> None:
        """Draw the last messages, and events that are still open."""
        self._send(LATEST)

    def close(self) -> None:
        """Draw all that is left, and end the picture."""
        self.finish()
        self._view.close()


def open_drawing(
    option: RerunOption, scenario: Scenario, log: Path, metrics: Metrics
) -> RunDrawing:
    """Open the picture of a run of `scenario`, whose figures `metrics` are gathered elsewhere.

    Raises ViewerError.
    """
    return RunDrawing(open_view(option, scenario, log), metrics.stream)


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
