"""The two files of a run: `run.mcap` with everything in it, and `summary.json`."""

from collections.abc import Sequence
from pathlib import Path

from scenarios.definition.library import ATTACHED_AS
from scenarios.definition.scenario import Scenario
from scenarios.results.log_summary import (
    LOG_NAME,
    METADATA_NAME,
    SUMMARY_NAME,
    silent_links,
    summarise,
)
from scenarios.results.metrics import Metrics
from scenarios.results.summary import ClockName, RunIdentity, RunSummary, to_json
from scenarios.runs.recorder import Listener, Recorder
from transport.log.writer import LogWriter
from vehicles.geometry.geodesy import LocalPlane

SLOW_WRITER = "this version of the mcap package writes the log in its own, slower way"


class RunLog:
    """Log and figures of one run, from its first message to its summary."""

    def __init__(
        self,
        scenario: Scenario,
        folder: Path,
        *,
        clock: ClockName,
        run_id: str,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """Open the log in `folder`, which is made, and write what the run is into it."""
        self._scenario = scenario
        self._folder = folder
        self._identity = RunIdentity.here(scenario.name, scenario.seed, clock, run_id)
        folder.mkdir(parents=True, exist_ok=True)
        self._writer = LogWriter(folder / LOG_NAME)
        self._writer.metadata(METADATA_NAME, self._identity.metadata())
        self._writer.attach(ATTACHED_AS, "application/toml", scenario.text.encode())
        self.metrics = Metrics(scenario.vehicle_names, scenario.links, scenario.route.start_yaw)
        self.recorder = Recorder(
            vehicles={name: scenario.vehicle(name).gnss.rate_hz for name in scenario.vehicle_names},
            plane=LocalPlane(scenario.origin),
            writer=self._writer,
            metrics=self.metrics,
            listeners=listeners,
        )
        self._start_at: int | None = None
        self._end_at = 0
        self._reason = ""

    def flush(self) -> None:
        """Bring what was written so far to the file."""
        self._writer.flush()

    def start(self, at: int, start_at: int) -> bytes:
        """Log the start instant (ns); returns the announcement for the bus."""
        self._start_at = start_at
        start = self.recorder.begin(at, start_at, self._identity.run_id)
        if not self._writer.fast:
            self.recorder.say(at, SLOW_WRITER, "warning")
        return start

    def end(self, at: int, reason: str) -> bytes:
        """Log that the run is over; an empty `reason` means as planned.

        It failed all the same when a link that should lose nothing delivered nothing. Returns the
        announcement for the bus. What still comes can be recorded until `close`.
        """
        self._end_at = at
        self._reason = reason or silent_links(self._scenario, self.metrics)
        return self.recorder.end(at, self._reason)

    def close(self, at: int) -> RunSummary:
        """Complete the log at instant `at` (ns) and write the summary, which is returned."""
        self.recorder.report_health(at, final=True)
        summary = summarise(
            self._identity,
            self._scenario,
            self.metrics,
            ran_ns=0 if self._start_at is None else max(self._end_at - self._start_at, 0),
            reason=self._reason,
            rejected=self.recorder.rejected,
        )
        text = to_json(summary)
        self._writer.attach(SUMMARY_NAME, "application/json", text.encode())
        self._writer.close()
        (self._folder / SUMMARY_NAME).write_text(text, encoding="utf-8")
        return summary
