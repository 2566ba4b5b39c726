"""Draws a live run with its events and true gaps."""

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from zlib import crc32

from scenarios.definition.scenario import Scenario
from scenarios.results.metrics import Metrics
from scenarios.results.stream import sizes_of
from transport.closing import Closing
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Message, TruePose

DEFAULT_SPACING_M = 15.0
MAX_PENDING_ERRORS = 10_000
"""Largest number of true errors that wait to be drawn."""


class RunDrawing(Closing):
    """Picture of a run with its figures; `draw` is an observer.

    `destination` describes to the user where it is shown.
    """

    def __init__(self, view: RerunView, metrics: Metrics) -> None:
        """Draw into `view` with the figures of `metrics`, which are gathered elsewhere."""
        self.destination = view.destination
        self._view = view
        self._events = metrics.events
        self._marked = 0
        names = list(metrics.vehicles)
        self._follower_of = dict(pairwise(names))
        self._pending_errors: deque[CrossTrack] = deque(maxlen=MAX_PENDING_ERRORS)
        self._gaps = metrics.stream.gaps
        self._stream = metrics.stream
        if view.enabled:
            self._stream.on_error(self._pending_errors.append)
        self._drawn_at = {name: 0 for name in names if view.has_curves(name)}

    def draw(self, now: int, message: Message) -> None:
        if not self._view.enabled:
            return
        self._view.draw(now, message)
        if isinstance(message, TruePose):
            while self._pending_errors:
                foot = self._pending_errors.popleft()
                self._view.error(foot.vehicle, foot.at_ns, foot.lateral)
            for name in (message.vehicle, self._follower_of.get(message.vehicle, "")):
                if name in self._drawn_at:
                    self._draw_gap(name)
            self._draw_marks()

    def _draw_gap(self, name: str) -> None:
        gap = self._gaps.get(name)
        if gap is not None and gap.now_at_ns > self._drawn_at[name]:
            self._drawn_at[name] = gap.now_at_ns
            self._view.gap(name, gap.now_at_ns, gap.now_m)

    def _draw_marks(self) -> None:
        for event in self._events.episodes(self._marked):
            self._view.mark(event.kind, event.at_ns, event.place, event.vehicles)
            self._marked += 1

    def close(self) -> None:
        """Draw events that are still open, and end the picture."""
        if self._view.enabled:
            self._stream.finish()
            self._draw_marks()
        self._view.close()


def open_drawing(
    option: RerunOption, scenario: Scenario, log: Path, metrics: Metrics
) -> RunDrawing:
    """Open the picture of a run of `scenario`, whose figures `metrics` are gathered elsewhere.

    Raises ViewerError.
    """
    return RunDrawing(open_view(option, scenario, log), metrics)


def open_view(
    option: RerunOption,
    scenario: Scenario,
    log: Path,
    *,
    vehicles: Sequence[str] | None = None,
    of_log: bool = False,
) -> RerunView:
    """Open the view of a run of `scenario`, live or of its log; raises ViewerError.

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
        of_log=of_log,
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
