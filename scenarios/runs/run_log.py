"""The two files of a run: `run.mcap` and `summary.json`."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.results.files import LOG_NAME, SUMMARY_NAME, write_whole
from scenarios.results.holes import hole_lines
from scenarios.results.limits import broken_limits, collision_ends_run, failure_reason
from scenarios.results.link_summary import describe_link
from scenarios.results.log_summary import METADATA_NAME, silent_links, summarise, write_summary
from scenarios.results.metrics import Metrics
from scenarios.results.stream import sizes_of
from scenarios.results.summary import ClockName, RunIdentity, RunSummary, to_json
from scenarios.runs.observer import Observer
from scenarios.runs.recorder import Recorder
from transport.log.errors import LogError
from transport.log.foxglove import Scene, foxglove_layout
from transport.log.writer import LogWriter
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import Message, TruePose
from vehicles.schedule import nanoseconds

# ---- The layout with which Foxglove shows the log of a run without this project


FOXGLOVE_NAME = "foxglove.json"


def write_foxglove_layout(folder: Path, scenario: Scenario) -> None:
    """Write a layout next to the log of a run of `scenario`, unless there is one.

    Nothing depends on it, so errors such as a full disk are ignored.
    """
    with suppress(OSError):
        layout = foxglove_layout(scenario.vehicle_names)
        write_whole(folder / FOXGLOVE_NAME, layout.encode(), new=True)


# ---- The observer that ends a run early, when a limit requires that


class LimitWatch:
    """Observer that ends a run early after collisions that break a limit.

    `metrics` must receive each message first. `reason` is empty until the run has to end.
    """

    kinds: frozenset[type[Message]] = frozenset({TruePose})  # nothing else brings collisions

    def __init__(self, limits: LimitsTable, metrics: Metrics) -> None:
        self._limits = limits
        self._metrics = metrics
        self.reason = ""

    def listen(self, at: int, _pose: Message) -> None:
        collisions = self._metrics.events.collisions
        if collisions and not self.reason and collision_ends_run(self._limits, collisions):
            ran_ns = max(at - (self._metrics.start_at or 0), 0)
            self.reason = failure_reason("", self.broken(ran_ns))

    def broken(self, ran_ns: int) -> list[str]:
        """List the limits broken after `ran_ns`, a line each."""
        return broken_limits(
            self._limits,
            self._metrics.events.events(),
            self._metrics.vehicle_summaries(ran_ns),
            self._metrics.deadlines.figures(ran_ns),
            self._metrics.unseen(ran_ns),
        )


# ---- Run log


MOST_HOLE_LINES = 20
"""Holes listed in the log; the summary lists all."""
MOST_LINK_LINES = 100
"""Links listed in the log, likewise."""


def scene_of(scenario: Scenario) -> Scene:
    """Cars, lead's path and lane of `scenario` for its log."""
    path = scenario.route.path
    lane = scenario.tables.events.lane_width_m
    return Scene(sizes_of(scenario), (path.east.tolist(), path.north.tolist()), lane)


class RunLog:
    """Log and figures of one run, from its first message to its summary."""

    def __init__(
        self,
        scenario: Scenario,
        folder: Path,
        *,
        clock: ClockName,
        run_id: str,
        metrics: Metrics | None = None,
        observers: Sequence[Observer] = (),
        replayed: frozenset[str] = frozenset(),
    ) -> None:
        """Create `folder` and begin the log in it, with the scenario and the versions.

        Each message goes to `metrics`, the figures of the run, and then to the `observers`.
        `replayed` vehicles receive nothing.
        """
        self._scenario = scenario
        self._folder = folder
        self._replayed = replayed
        self._identity = RunIdentity.here(scenario, clock, run_id)
        folder.mkdir(parents=True, exist_ok=True)
        self._writer = LogWriter(
            folder / LOG_NAME, scene=scene_of(scenario), rates_hz=scenario.tables.log.rates_hz
        )
        write_foxglove_layout(folder, scenario)
        self._writer.metadata(METADATA_NAME, self._identity.metadata())
        self._writer.attach(ATTACHED_AS, "application/toml", scenario.text.encode())
        self.metrics = metrics or Metrics.of(scenario)
        self._limits = LimitWatch(scenario.tables.limits, self.metrics)
        self.recorder = Recorder(
            vehicles={
                name: setup.highest_rate_hz
                for name in scenario.vehicle_names
                for setup in [scenario.vehicle(name)]
            },
            plane=LocalPlane(scenario.origin),
            writer=self._writer,
            metrics=self.metrics,
            observers=[*observers, self._limits],
            clock_errors_ns={
                name: scenario.clock_error_ns(name) for name in scenario.vehicle_names
            },
        )
        self._end_at = 0
        self.reason = ""
        """Why the run has failed, once it is over; empty if as planned."""

    def flush(self) -> None:
        self._writer.flush()

    def start(self, at: int, start_at: int) -> bytes:
        """Log the start (ns); returns the announcement for the bus."""
        return self.recorder.begin(at, start_at, self._identity.run_id)

    def end(self, at: int, reason: str) -> bytes:
        """Log that the run is over; an empty `reason` means as planned.

        Returns the announcement for the bus; messages can be recorded until `close`. A failed log
        and a link without loss that delivered nothing are reasons too.
        """
        self._end_at = at
        try:
            self.metrics.finish()
            self.recorder.log_news(at)
            for line in hole_lines(self.metrics.holes(self._ran_ns), MOST_HOLE_LINES):
                self.recorder.log(at, line, "warning")
            for row in self.metrics.link_summaries(self._ran_ns)[:MOST_LINK_LINES]:
                if row.judged:
                    self.recorder.log(at, describe_link(row), "debug")  # for the log only
            silent = silent_links(self.metrics, self._replayed, self._scenario.off_links)
            broken = self._limits.broken(self._ran_ns)
            wrong = [*broken, *self.metrics.contradictions(self._ran_ns)]
            self.reason = failure_reason(reason or self.early_end_reason or silent, wrong)
            return self.recorder.end(at, self.reason, self._identity.run_id)
        except LogError as error:
            self.reason = failure_reason(reason or self.early_end_reason, [str(error)])
            return self.recorder.end(at, self.reason, self._identity.run_id)

    @property
    def early_end_reason(self) -> str:
        """The broken limit that ends the run now, or empty."""
        return self._limits.reason

    @property
    def _ran_ns(self) -> int:
        if self.metrics.start_at is None:
            return 0
        planned = nanoseconds(self._scenario.duration_s)
        return min(max(self._end_at - self.metrics.start_at, 0), planned)

    def close(self, at: int) -> RunSummary:
        """Complete the log at instant `at` (ns), write the summary and return it.

        If either cannot be written the run has failed: the summary has the reason, the log keeps
        what it holds, and the summary is written if there is room.
        """
        with suppress(LogError):  # the writer has the reason
            self.recorder.report_health(at, final=True)
            summary = self._summary()
            self._writer.attach(SUMMARY_NAME, "application/json", to_json(summary).encode())
            self._writer.close()
        if self._writer.broken:
            self.reason = failure_reason(self.reason, [self._writer.failure])
            summary = self._summary()
        try:
            write_summary(self._folder, summary)
        except LogError as error:  # no other summary than that in the log is written
            if not self._writer.broken:
                self.reason = failure_reason(self.reason, [str(error)])
            summary = self._summary()
        return summary

    def _summary(self) -> RunSummary:
        return summarise(
            self._identity,
            self._scenario,
            self.metrics,
            ran_ns=self._ran_ns,
            reason=self.reason,
            rejected=self.recorder.rejected,
        )
