"""The summary of a run, as `summary.json` and inside its log: one dictionary, whoever makes it."""

import json
import platform
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.metrics import Metrics
from transport.log.mcap_log import LogError, LogReader
from vehicles.messages import RunStart

SUMMARY_NAME = "summary.json"
SCENARIO_NAME = "scenario.toml"
METADATA_NAME = "convoy"
SCHEMA = "convoy.summary/1"
PACKAGES = ("convoy-emulator", "eclipse-zenoh", "mcap", "numpy", "protobuf", "pymap3d")
"""Packages whose versions are written into the log."""


def about(scenario: Scenario, clock: str, run_id: str) -> dict[str, str]:
    """What a run is, for the log's metadata."""
    return {
        "schema": SCHEMA,
        "scenario": scenario.name,
        "seed": str(scenario.seed),
        "clock": clock,
        "run_id": run_id,
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
    }


def requested_links(scenario: Scenario) -> dict[tuple[str, str], dict[str, Any]]:
    """What the scenario asks of each directed link, by (sender, receiver)."""
    return {
        (sender, receiver): asdict(rule)
        for receiver in scenario.vehicle_names
        for sender, rule in scenario.links_into(receiver).items()
    }


def summarise(
    what: Mapping[str, str],
    scenario: Scenario,
    metrics: Metrics,
    *,
    ran_ns: int,
    reason: str,
    rejected: Mapping[str, int],
) -> dict[str, Any]:
    """The summary; README, "The summary", says what its fields mean."""
    return {
        **what,
        "seed": scenario.seed,
        "outcome": "failed" if reason else "completed",
        "reason": reason,
        "duration_s": scenario.duration_s,
        "ran_s": min(ran_ns * 1e-9, scenario.duration_s),
        "recorder_rejected_messages": dict(sorted(rejected.items())),
        **metrics.summary(),
    }


def summary_text(summary: Mapping[str, Any]) -> str:
    """The content of `summary.json`, beside the log and inside it."""
    return json.dumps(summary, indent=2) + "\n"


def summary_of(log: Path) -> dict[str, Any]:
    """The summary inside `log`; for a log that breaks off, worked out from its messages."""
    reader = LogReader(log)
    attachments = reader.attachments()
    if SUMMARY_NAME in attachments:
        found: dict[str, Any] = json.loads(attachments[SUMMARY_NAME])
        return found
    scenario = scenario_in(log, attachments)
    metrics = Metrics(scenario.vehicle_names, requested_links(scenario), scenario.route.start_yaw)
    start_at = last_at = 0
    for at, _, message in reader.messages():
        metrics.add(message)
        last_at = at
        if isinstance(message, RunStart):
            start_at = message.start_at_ns
    return summarise(
        reader.metadata().get(METADATA_NAME, {}),
        scenario,
        metrics,
        ran_ns=max(last_at - start_at, 0) if start_at else 0,
        reason="the log breaks off",
        rejected={},
    )


def scenario_in(log: Path, attachments: Mapping[str, bytes]) -> Scenario:
    """The scenario inside a log, with the lead's path or trace, so that it can be run again."""
    if SCENARIO_NAME not in attachments:
        raise LogError(f"{log}: holds no scenario; was it written by `convoy`?")
    return scenario_from_text(attachments[SCENARIO_NAME].decode(), label=f"{log} ({SCENARIO_NAME})")
