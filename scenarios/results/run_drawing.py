"""Draws a live run with its events and true gaps."""

from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from zlib import crc32

from scenarios.definition.scenario import Scenario
from scenarios.results.encounters import Episode
from scenarios.results.metrics import Metrics
from scenarios.results.stream import FigureStream, sizes_of
from transport.closing import Closing
from transport.picture.option import RerunOption
from transport.picture.view import RerunView
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Message, TruePose

DEFAULT_SPACING_M = 15.0
MAX_PENDING_ERRORS = 10_000
"""Largest number of true errors that wait to be drawn."""
ALWAYS = -(2**62), 2**62


class RunDrawing(Closing):
    """Picture of a run with its figures; `draw` is an observer.

    `destination` describes to the user where it is shown.
    """

    def __init__(
        self,
        view: RerunView,
        stream: FigureStream,
        *,
        span: tuple[int, int] = ALWAYS,
        shows: Callable[[str], bool] = lambda _: True,
    ) -> None:
        """Draw into `view` with the figures of `stream`, which receives the messages elsewhere.

        Only figures with an instant in `span` (ns), of vehicles that it `shows`, are drawn.
        """
        self.destination = view.destination
        self._view, self._stream = view, stream
        self._span, self._shows = span, shows
        self._pending_errors: deque[CrossTrack] = deque(maxlen=MAX_PENDING_ERRORS)
        self._pending_events: list[Episode] = []
        if view.enabled:
            stream.on_error(self._pending_errors.append)
            stream.on_event(self._pending_events.append)
        self._follower_of = dict(pairwise(stream.sizes))
        self._drawn_at = {name: 0 for name in stream.sizes if view.has_curves(name)}

    def draw(self, now: int, message: Message) -> None:
        if not self._view.enabled:
            return
        self._view.draw(now, message)
        if isinstance(message, TruePose):
            while self._pending_errors:
                foot = self._pending_errors.popleft()
                if self._is_within(foot.at_ns) and self._shows(foot.vehicle):
                    self._view.error(foot.vehicle, foot.at_ns, foot.lateral)
            for name in (message.vehicle, self._follower_of.get(message.vehicle, "")):
                if name in self._drawn_at:
                    self._draw_gap(name)
            self._draw_marks()

    def _is_within(self, at: int) -> bool:
        return self._span[0] <= at <= self._span[1]

    def _draw_gap(self, name: str) -> None:
        gap = self._stream.gaps.get(name)
        if gap is None or not self._is_within(gap.now_at_ns):
            return
        if gap.now_at_ns > self._drawn_at[name]:
            self._drawn_at[name] = gap.now_at_ns
            self._view.gap(name, gap.now_at_ns, gap.now_m)

    def _draw_marks(self) -> None:
        for event in self._pending_events:
            if self._is_within(event.at_ns) and any(map(self._shows, event.vehicles)):
                self._view.mark(event.kind, event.at_ns, event.place, event.vehicles)
        self._pending_events.clear()

    def finish(self) -> None:
        """Draw events that are still open."""
        if self._view.enabled:
            self._stream.finish()
            self._draw_marks()

    def close(self) -> None:
        """Draw events that are still open, and end the picture."""
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
