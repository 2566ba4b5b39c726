"""The two files of a run: `run.mcap` with everything in it, and `summary.json`."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from scenarios.metrics import Metrics
from scenarios.recorder import Listener, Recorder
from scenarios.scenario import Scenario
from scenarios.summary import (
    METADATA_NAME,
    SCENARIO_NAME,
    SUMMARY_NAME,
    about,
    requested_links,
    summarise,
)
from transport.mcap_log import LogWriter
from vehicles.messages import RunEnd, RunStart

ClockName = Literal["wall", "virtual"]
LOG_NAME = "run.mcap"


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
        self.metrics = Metrics(scenario.vehicle_names, requested_links(scenario))
        self.recorder = Recorder(
            vehicles=scenario.vehicle_names,
            writer=self._writer,
            metrics=self.metrics,
            listeners=listeners,
        )
        self._start_at: int | None = None

    def flush(self) -> None:
        """Bring what was written so far to the file."""
        self._writer.flush()

    def start(self, at: int, start_at: int) -> bytes:
        """Log the start instant (ns); returns the announcement for the bus."""
        self._start_at = start_at
        return self.recorder.put(RunStart, at, start_at_ns=start_at, run_id=self._about["run_id"])

    def close(self, at: int, reason: str) -> tuple[dict[str, Any], bytes]:
        """Complete the log at instant `at` (ns); an empty `reason` means the run ended as planned.

        Returns the summary and the announcement of the end for the bus.
        """
        self.recorder.report_health(at, final=True)
        end = self.recorder.put(RunEnd, at, end_at_ns=at, reason=reason)
        summary = self._summary(at, reason)
        text = json.dumps(summary, indent=2) + "\n"
        self._writer.attach(SUMMARY_NAME, "application/json", text.encode())
        self._writer.close()
        (self._folder / SUMMARY_NAME).write_text(text, encoding="utf-8")
        return summary, end

    def _summary(self, at: int, reason: str) -> dict[str, Any]:
        return summarise(
            self._about,
            self._scenario,
            self.metrics,
            ran_ns=0 if self._start_at is None else max(at - self._start_at, 0),
            reason=reason,
            rejected=self.recorder.rejected,
        )
