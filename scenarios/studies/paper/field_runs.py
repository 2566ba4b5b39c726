"""The paper's field experiment (Section V-D), in which one car drives run after run.

Run 1 drives the course alone and is recorded. Run i replays the record of run 1 as its lead and the
record of run i − 1 as its predecessor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.flow_table import USUAL, WORDS
from scenarios.results.drives import Drive, Trial
from scenarios.results.files import LOG_NAME
from scenarios.runs.node.recorded_vehicle import Replay, head_start, read_recorded_vehicle
from scenarios.runs.virtual.logged_run import record_trial
from vehicles.geometry.geodesy import LocalPlane

TIME_BETWEEN_RUNS = timedelta(minutes=5)
"""Time between the starts of two runs."""

WITH_LEAD_DATA = "composite"
WITHOUT_LEAD_DATA = "predecessor"
LATERAL = {WITH_LEAD_DATA: USUAL, WITHOUT_LEAD_DATA: WORDS["predecessor"]}
"""Lateral sources by the suffix of the logs."""


@dataclass(frozen=True)
class FieldRuns:
    """The drives of all runs, lead first, and the folder names of their logs."""

    with_lead_data: Trial
    without_lead_data: Trial
    logs: tuple[str, ...]


def field_runs(scenario: Scenario, folder: Path) -> FieldRuns:
    """Simulate all runs of `scenario`, each logged in a sub-folder of `folder`.

    The first two runs are shared: with only the lead ahead, there are no separate lead data.
    """
    shared: list[tuple[Drive, Path]] = []
    for place in range(min(2, len(scenario.vehicle_names))):
        shared.append(_drive(scenario, place, WITH_LEAD_DATA, folder, shared))
    trials: dict[str, Trial] = {}
    logs = [log for _, log in shared]
    for data in LATERAL:
        runs = list(shared)
        for place in range(2, len(scenario.vehicle_names)):
            runs.append(_drive(scenario, place, data, folder, runs))
        trials[data] = Trial(tuple(drive for drive, _ in runs))
        logs += [log for _, log in runs[len(shared) :]]
    names = tuple(log.name for log in logs)
    return FieldRuns(trials[WITH_LEAD_DATA], trials[WITHOUT_LEAD_DATA], names)


def _drive(
    scenario: Scenario,
    place: int,
    data: str,
    folder: Path,
    before: Sequence[tuple[Drive, Path]],
) -> tuple[Drive, Path]:
    """Simulate run `place` (from 0) behind the earlier runs; return its drive and log."""
    run = as_run(scenario, place, data)
    kind = "" if place < 2 else f"_{data}"
    name = run.vehicle_names[place]
    log = folder / f"run_{place + 1}_{name}{kind}"
    trial = record_trial(run, log, _replays(run, [path for _, path in before]))
    return next(drive for drive in trial.drives if drive.name == name), log


def as_run(scenario: Scenario, place: int, data: str = WITH_LEAD_DATA) -> Scenario:
    """Scenario of the run of the vehicle at `place` (from 0), which starts after earlier runs."""
    tables, names = scenario.tables, scenario.vehicle_names[: place + 1]
    return Scenario(
        tables.model_copy(
            update={
                "name": f"{scenario.name}_run_{place + 1}",
                "duration_s": scenario.duration_s,
                "start_at": tables.start_at + place * TIME_BETWEEN_RUNS,
                "convoy": tables.convoy.model_copy(update={"names": names, "vehicles": len(names)}),
                "information_flow": tables.information_flow.model_copy(
                    update={"lateral": LATERAL[data]}
                ),
                "vehicle": {name: own for name, own in tables.vehicle.items() if name in names},
            }
        )
    )


def _replays(run: Scenario, logs: Sequence[Path]) -> list[Replay]:
    """Replays of lead and predecessor, each at its distance ahead of the driving car."""
    names, route = run.vehicle_names, run.route
    ego = len(names) - 1
    replays = []
    for place in sorted({0, ego - 1}) if ego else []:
        recorded = read_recorded_vehicle(logs[place] / LOG_NAME, names[place])
        start = route.path.at(route.start_station(ego))
        distance = sum(route.spacings[place + 1 : ego + 1])
        ahead = head_start(recorded, LocalPlane(run.origin), (start.east, start.north), distance)
        replays.append(recorded.replay(start_at=run.start_at_ns, ahead=ahead))
    return replays
