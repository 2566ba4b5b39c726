"""The two files of a run: `run.mcap` with everything in it, and `summary.json`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from scenarios.definition.scenario import Scenario
from scenarios.results.metrics import Metrics
from scenarios.results.summary import (
    METADATA_NAME,
    SCENARIO_NAME,
    SUMMARY_NAME,
    about,
    requested_links,
    summarise,
    summary_text,
)
from scenarios.runs.recorder import Listener, Recorder
from transport.log.mcap_log import LogWriter
from vehicles.messages import RunEnd, RunStart
from vehicles.schedule import SECOND

ClockName = Literal["wall", "virtual"]
LOG_NAME = "run.mcap"
EARLY_NS = SECOND
"""A vehicle that is told before the start that the run is over says its last words then."""
NEVER = 2**63


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
        self._about = about(scenario, clock, run_id)
        folder.mkdir(parents=True, exist_ok=True)
        self._writer = LogWriter(folder / LOG_NAME)
        self._writer.metadata(METADATA_NAME, self._about)
        self._writer.attach(SCENARIO_NAME, "application/toml", scenario.text.encode())
        self.metrics = Metrics(
            scenario.vehicle_names, requested_links(scenario), scenario.route.start_yaw
        )
        self.recorder = Recorder(
            vehicles=scenario.vehicle_names,
            writer=self._writer,
            metrics=self.metrics,
            listeners=listeners,
        )
        self.recorder.valid_from = NEVER  # nobody has anything to say before the start is known
        self._start_at: int | None = None
        self._end_at = 0
        self._reason = ""

    def flush(self) -> None:
        """Bring what was written so far to the file."""
        self._writer.flush()

    def start(self, at: int, start_at: int) -> bytes:
        """Log the start instant (ns); returns the announcement for the bus."""
        self._start_at = start_at
        self.recorder.valid_from = start_at - EARLY_NS
        return self.recorder.put(RunStart, at, start_at_ns=start_at, run_id=self._about["run_id"])

    def end(self, at: int, reason: str) -> bytes:
        """Log that the run is over; an empty `reason` means as planned.

        Returns the announcement for the bus. What still comes can be recorded until `close`.
        """
        self._end_at, self._reason = at, reason
        return self.recorder.put(RunEnd, at, end_at_ns=at, reason=reason)

    def close(self, at: int) -> dict[str, Any]:
        """Complete the log at instant `at` (ns) and write the summary, which is returned."""
        self.recorder.report_health(at, final=True)
        summary = summarise(
            self._about,
            self._scenario,
            self.metrics,
            ran_ns=0 if self._start_at is None else max(self._end_at - self._start_at, 0),
            reason=self._reason,
            rejected=self.recorder.rejected,
        )
        text = summary_text(summary)
        self._writer.attach(SUMMARY_NAME, "application/json", text.encode())
        self._writer.close()
        (self._folder / SUMMARY_NAME).write_text(text, encoding="utf-8")
        return summary
