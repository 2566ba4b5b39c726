"""The two files of a run: `run.mcap` and `summary.json`."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario
from scenarios.results.events import Event
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.limits import collision_ends_run, failure_reason, limit_figures
from scenarios.results.link_account import accounts
from scenarios.results.links import silent_links
from scenarios.results.log_summary import METADATA_NAME, summarise, tables_in, write_summary
from scenarios.results.record import hole_lines, record_holes
from scenarios.results.run_event import events, run_events
from scenarios.results.summary import ClockName, RunIdentity, RunSummary, to_json
from scenarios.results.tables import KINDS, Collector, RunTables
from scenarios.results.true_motion import sizes_of
from scenarios.results.vehicle_figures import tyre_warnings
from scenarios.runs.live import LiveRun
from scenarios.runs.observer import Observer
from scenarios.runs.recorder import Recorder
from transport.log.errors import LogError
from transport.log.foxglove import Scene
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from transport.topics import TOPICS
from vehicles.geometry.geodesy import LocalPlane
from vehicles.schedule import nanoseconds

MOST_HOLE_LINES = 20
"""Holes listed in the log; the summary lists all."""


def scene_of(scenario: Scenario) -> Scene:
    """Cars, lead's path and lane of `scenario` for its log."""
    path = scenario.route.path
    lane = scenario.tables.events.lane_width_m
    return Scene(sizes_of(scenario), (path.east.tolist(), path.north.tolist()), lane)


class RunLog:
    """Log and metrics of one run, from its first message to its summary.

    The metrics are computed from the rows that the log holds, and those that `[log]` leaves out.
    """

    def __init__(
        self,
        scenario: Scenario,
        folder: Path,
        *,
        clock: ClockName,
        run_id: str,
        live: LiveRun,
        observers: Sequence[Observer] = (),
    ) -> None:
        """Create `folder` and begin the log in it, with the scenario and the versions.

        Each message goes to the `observers`, among them `live` if it is in use.
        """
        self._scenario = scenario
        self._folder = folder
        self._live = live
        self._writes_live = clock == "wall"  # a virtual run has the same log without `live`
        self._identity = RunIdentity.here(scenario, clock, run_id)
        folder.mkdir(parents=True, exist_ok=True)
        self._log = folder / LOG_NAME
        rates_hz = scenario.tables.log.rates_hz
        self._writer = LogWriter(self._log, scene=scene_of(scenario), rates_hz=rates_hz)
        self._thinned = Collector(KINDS & {TOPICS[topic].message for topic in rates_hz})
        self._writer.metadata(METADATA_NAME, self._identity.metadata())
        self._writer.attach(ATTACHED_AS, "application/toml", scenario.text.encode())
        self.recorder = Recorder(
            vehicles={
                name: setup.highest_rate_hz
                for name in scenario.vehicle_names
                for setup in [scenario.vehicle(name)]
            },
            plane=LocalPlane(scenario.origin),
            writer=self._writer,
            control_rate_hz=scenario.control_rate_hz,
            observers=[self._thinned, *observers],
            clock_errors_ns={
                name: scenario.clock_error_ns(name) for name in scenario.vehicle_names
            },
        )
        self._start_at: int | None = None
        self._end_at = 0
        self._logged_events: set[tuple[object, ...]] = set()
        self._tables: RunTables | None = None
        self._recorded_at_end = 0
        self.early_end: EarlyEnd | None = None
        """Broken limit that ends the run now, if any."""
        self.reason = ""
        """Why the run has failed, once it is over; empty if as planned."""

    def flush(self) -> None:
        self._writer.flush()

    def start(self, at: int, start_at: int) -> bytes:
        """Log the start (ns); returns the announcement for the bus."""
        self._start_at = start_at
        return self.recorder.begin(at, start_at, self._identity.run_id)

    def update(self, at: int) -> bool:
        """Evaluate the last seconds at instant `at` (ns); returns whether there is news."""
        if not self._live.update():
            return False
        self.early_end = self.early_end or early_end_of(self._live)
        if self._writes_live:
            self._log_events(at, self._live.window, self._live.events)
        return True

    def _log_events(self, at: int, run: RunTables, found: Sequence[Event]) -> None:
        """Log those of the events that are not in the log."""
        for event in found:
            if event.key not in self._logged_events:
                self._logged_events.add(event.key)
                (listed,) = run_events(run, [event])
                self.recorder.log(at, listed.line, listed.level, valid_at=event.at_ns)

    def end(self, at: int, reason: str) -> bytes:
        """Log that the run is over; an empty `reason` means as planned.

        Returns the announcement for the bus; messages can be recorded until `close`. A failed log
        a link without loss that delivered nothing, and a topic with two writers are reasons too. A
        run that a limit ends is over at the instant of the event.
        """
        self._end_at = self.early_end.at_ns if self.early_end else at
        early = self.early_end.reason if self.early_end else ""
        try:
            run = self._read()
            for beyond_at, line in tyre_warnings(run).values():
                self.recorder.log(at, line, "warning", valid_at=beyond_at)
            self._log_events(at, run, events(run))
            self._live.events = list(events(run))
            for line in hole_lines(record_holes(run), MOST_HOLE_LINES):
                self.recorder.log(at, line, "warning")
            silent = silent_links(run, accounts(run))
            self.reason = self._summary(reason or early or silent or self.recorder.doubled).reason
        except LogError as error:
            self.reason = failure_reason(reason or early, [str(error)])
        return self.recorder.end(self._end_at, self.reason, self._identity.run_id)

    def _read(self) -> RunTables:
        """Tables of the messages so far, up to the end of the run."""
        if self._tables is not None and self._recorded_at_end == self.recorder.accepted:
            return self._tables
        self._writer.flush()
        try:
            run = tables_in(LogReader(self._log), self._scenario, self._ran_ns)
        except LogError:  # nothing was recorded, or the file is gone
            run = RunTables(self._scenario, {}, self._ran_ns)
        run = replace(run, tables={**run.tables, **self._thinned.tables()}, results={})
        self._recorded_at_end = self.recorder.accepted
        self._tables = run.until(self._end_at) if self.early_end else run
        return self._tables

    @property
    def _ran_ns(self) -> int:
        planned = nanoseconds(self._scenario.duration_s)
        return 0 if self._start_at is None else min(max(self._end_at - self._start_at, 0), planned)

    def close(self, at: int) -> RunSummary:
        """Complete the log at instant `at` (ns), write the summary and return it.

        If either cannot be written the run has failed: the summary has the reason, the log keeps
        what it holds, and the summary is written if there is room.
        """
        summary = None
        with suppress(LogError):  # the writer has the reason
            self.recorder.report_health(at, final=True)
            summary = self._summary(self.reason)
            self._writer.attach(SUMMARY_NAME, "application/json", to_json(summary).encode())
            self._writer.close()
        if summary is None or self._writer.failure:
            self.reason = failure_reason(self.reason, [self._writer.failure])
            summary = self._summary(self.reason)
        try:
            write_summary(self._folder, summary)
        except LogError as error:  # no other summary than that in the log is written
            if not self._writer.failure:
                self.reason = failure_reason(self.reason, [str(error)])
            summary = self._summary(self.reason)
        return summary

    def _summary(self, reason: str) -> RunSummary:
        rejected = self.recorder.rejected
        return summarise(self._identity, self._read(), reason=reason, rejected=rejected)


class EarlyEnd(NamedTuple):
    """Instant (ns) of the event that ends a run, and the limit that it breaks."""

    at_ns: int
    reason: str


def may_end_early(scenario: Scenario) -> bool:
    """Whether the limits of a scenario end its runs after a number of collisions."""
    limits = scenario.tables.limits
    return collision_ends_run(limits, 1 + (limits.collisions_max or 0))


def early_end_of(live: LiveRun) -> EarlyEnd | None:
    """Return the collision that ends a run, None unless a limit requires that."""
    limits = live.scenario.tables.limits
    collisions = [event for event in live.events if event.kind == "collision"]
    if not collision_ends_run(limits, len(collisions)):
        return None
    last = collisions[limits.collisions_max or 0]
    counted = limit_figures(limits, run_events(live.window, collisions), ())
    reason = failure_reason("", [figure.message for figure in counted if figure.message])
    return EarlyEnd(last.at_ns, reason)
