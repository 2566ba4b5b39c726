"""Draws a live run with its events, true errors and gaps."""

from collections.abc import Callable, Sequence
from pathlib import Path
from zlib import crc32

from scenarios.definition.scenario import Scenario
from scenarios.results.events import Event
from scenarios.results.live import LiveRun, deviations
from scenarios.results.tables import RunTables
from scenarios.results.true_motion import sizes_of
from transport.closing import Closing
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from transport.topics import TOPIC_OF
from vehicles.messages import Message

DEFAULT_SPACING_M = 15.0
ALWAYS = -(2**62), 2**62


class RunDrawing(Closing):
    """Picture of a run: an observer that draws messages, and a watcher that draws metrics.

    `destination` describes to the user where it is shown.
    """

    kinds = frozenset(TOPIC_OF)

    def __init__(
        self,
        view: RerunView,
        *,
        span: tuple[int, int] = ALWAYS,
        shows: Callable[[str], bool] = lambda _: True,
    ) -> None:
        """Draw into `view`, of the metrics those in `span` (ns) of vehicles that it `shows`."""
        self.destination = view.destination
        self._view = view
        self._span, self._shows = span, shows
        self._until = 0
        self._marked: set[tuple[object, ...]] = set()

    def listen(self, at: int, message: Message) -> None:
        if self._view.enabled:
            self._view.draw(at, message)

    def update(self, live: LiveRun) -> None:
        self.draw_metrics(live.window, live.events, live.evaluated_until)

    def draw_metrics(self, run: RunTables, events: Sequence[Event], until: int) -> None:
        """Draw true errors and gaps up to an instant (ns), and the events that are new."""
        if not self._view.enabled:
            return
        for name, at, error, gap in deviations(run, self._until, until):
            if self._span[0] <= at <= self._span[1] and self._shows(name):
                self._view.error(name, at, error)
                self._view.gap(name, at, gap)
        self._until = until
        for event in events:
            is_within = self._span[0] <= event.at_ns <= self._span[1]
            if (
                event.key not in self._marked
                and is_within
                and any(map(self._shows, event.vehicles))
            ):
                self._view.mark(event.kind, event.at_ns, event.place, event.vehicles)
            self._marked.add(event.key)

    def close(self) -> None:
        self._view.close()


def open_drawing(option: RerunOption, scenario: Scenario, log: Path) -> RunDrawing:
    """Open the picture of a run of `scenario`; raises ViewerError."""
    return RunDrawing(open_view(option, scenario, log))


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
    path = scenario.route.path
    return RerunView(
        option,
        recording_id=recording_id(log),
        vehicles=vehicles or scenario.vehicle_names,
        convoy=scenario.vehicle_names,
        spacing_m=widest_spacing(scenario),
        cars=sizes_of(scenario),
        path=(path.east.tolist(), path.north.tolist()),
        lane_m=scenario.tables.events.lane_width_m,
        duration_s=scenario.duration_s,
        title=scenario.title,
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
