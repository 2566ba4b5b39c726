"""`convoy reproduce`: run the paper's experiments, judge its claims, write one report."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.link_tables import USUAL, WORDS
from scenarios.definition.wording import did_you_mean
from scenarios.results.drives import Drive, Trial
from scenarios.results.files import LOG_NAME
from scenarios.runs.node.recorded_vehicle import Replay, head_start, read_recorded_vehicle
from scenarios.runs.virtual import drive_trial, record_trial
from scenarios.studies.engine import study_engine
from scenarios.studies.job import Job, Work, refuse_existing
from scenarios.studies.paper.claim import counts_text
from scenarios.studies.paper.experiments import (
    EXACT,
    FIELD_WITH,
    FIELD_WITHOUT,
    RUNS_OF_CASE,
    TRAJECTORIES,
    TRAJECTORY_NAMES,
    Experiment,
    JobKey,
    Part,
    RunKey,
    SineKey,
    WithTrajectory,
)
from scenarios.studies.paper.findings import (
    FREQUENCIES,
    PREVIEW_S,
    SHORT_FREQUENCIES,
    SHORT_PREVIEW_S,
    Findings,
    SampleCounter,
    SampleFigures,
    SineResponse,
    drive_sine,
)
from scenarios.studies.workers import open_workers
from vehicles.geometry.geodesy import LocalPlane
from vehicles.preview.curve_fit import Trajectory

# ---- The paper's field experiment (Section V-D), in which one car drives run after run
#
# Run 1 drives the course alone and is recorded. Run i replays the record of run 1 as its lead and
# the record of run i − 1 as its predecessor.


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


# ---- Reproduce


REPORT = "report.md"
WORKERS = 2


def reproduce(
    cases: Sequence[str],
    out: Path,
    progress: Callable[[str], None],
    *,
    workers: int = WORKERS,
    picture_format: str = "png",
) -> int:
    """Run `cases`, by default all, and write report, plots and logs into `out`.

    Reports progress line by line. Returns exit code 0, even if claims do not hold. Raises
    ScenarioError for an unknown case, or if `out` already holds a report.
    """
    from scenarios.studies.paper.report import all_pictures, write_report  # noqa: PLC0415 - brings matplotlib

    chosen = chosen_cases(cases)
    jobs = jobs_of(chosen, out, picture_format)
    written = [REPORT, "report.json", *all_pictures(picture_format), *map(str, jobs)]
    refuse_existing(*(out / name for name in written), place="folder by --out")
    out.mkdir(parents=True, exist_ok=True)
    with study_engine(partial(open_workers, workers), progress) as engine:
        parts = [
            Job(key=str(key), work=partial(_run_in_clean_folder, out / str(key), work))
            for key, work in jobs.items()
        ]
        engine.progress.total = len(parts)
        results = dict(zip(jobs, engine.results(parts), strict=True))
    findings = {trajectory: Findings(trajectory) for trajectory in TRAJECTORIES}
    for key in jobs:
        if isinstance(key, WithTrajectory):
            store_result(findings[key.trajectory], key.part, results[key])
        else:
            for findings_of_kind in findings.values():
                store_result(findings_of_kind, key, results[key])
    claims = write_report(findings, chosen, out, picture_format)
    for trajectory in TRAJECTORIES:
        progress(f"claims with {TRAJECTORY_NAMES[trajectory]}: {counts_text(claims, trajectory)}")
    progress(f"report: {out / REPORT}")
    return 0


def _run_in_clean_folder(folder: Path, work: Work) -> Any:
    """Delete the folder of an earlier, killed worker, then do the work."""
    rmtree(folder, ignore_errors=True)
    return work()


def chosen_cases(cases: Sequence[str]) -> list[str]:
    """Order the cases as in the paper; raises ScenarioError for unknown ones."""
    unknown = [case for case in cases if case not in RUNS_OF_CASE]
    if unknown:
        allowed = ", ".join(RUNS_OF_CASE)
        raise ScenarioError(
            f"--case {name}: no such case{did_you_mean(name, RUNS_OF_CASE)}, allowed {allowed}"
            for name in unknown
        )
    return [case for case in RUNS_OF_CASE if case in cases or not cases]


def jobs_of(cases: Sequence[str], out: Path, picture_format: str = "png") -> dict[JobKey, Work]:
    """Jobs of the cases, longest first."""
    jobs: dict[JobKey, Work] = {}
    if Part.FIELD in cases:
        for trajectory in TRAJECTORIES:
            key = WithTrajectory(trajectory, Part.FIELD)
            jobs[key] = partial(_field, out / str(key), trajectory)
    if Part.GAINS in cases:
        jobs[Part.GAINS] = partial(_gains, out / Part.GAINS, picture_format)
    jobs |= _runs_of(cases, out)
    if Part.PROPAGATION in cases:
        for preview, frequencies in (
            (PREVIEW_S, FREQUENCIES),
            (SHORT_PREVIEW_S, SHORT_FREQUENCIES),
        ):
            for frequency in frequencies:
                for trajectory in TRAJECTORIES:
                    key = WithTrajectory(trajectory, SineKey(frequency, preview))
                    jobs[key] = partial(drive_sine, frequency, preview, trajectory)
    return jobs


def _runs_of(cases: Sequence[str], out: Path) -> Iterator[tuple[JobKey, Work]]:
    """Runs of the cases with each trajectory, logged runs first."""
    runs = {key: experiment for case in cases for key, experiment in RUNS_OF_CASE[case].items()}
    for run, experiment in sorted(runs.items(), key=lambda row: not row[1].logged):
        if experiment.names_trajectory:
            yield run, partial(run_experiment, experiment, out / str(run))
            continue
        for trajectory in TRAJECTORIES:
            key = WithTrajectory(trajectory, run)
            yield (
                key,
                partial(run_experiment, experiment.with_trajectory(trajectory), out / str(key)),
            )


@dataclass(frozen=True, slots=True)
class ExperimentRun:
    """The drives of one run and, if it was logged, the samples that its followers fitted."""

    trial: Trial
    samples: SampleFigures | None = None


def run_experiment(experiment: Experiment, folder: Path) -> ExperimentRun:
    scenario = load_scenario(experiment.scenario, experiment.overrides, experiment.seed)
    if not experiment.logged:
        return ExperimentRun(drive_trial(scenario))
    counter = SampleCounter()
    return ExperimentRun(record_trial(scenario, folder, observers=(counter,)), counter.figures)


def _field(folder: Path, trajectory: Trajectory) -> FieldRuns:
    experiment = Experiment(scenario="paper_field", overrides=EXACT).with_trajectory(trajectory)
    return field_runs(load_scenario(experiment.scenario, experiment.overrides), folder)


def _gains(folder: Path, picture_format: str) -> tuple[str, ...]:
    from scenarios.studies.gains.report import gains_report  # noqa: PLC0415 - brings matplotlib
    from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS  # noqa: PLC0415

    report = gains_report(LINCOLN_MKZ, NOMINAL_GAINS, out_dir=folder, picture_format=picture_format)
    return report.pictures


def store_result(findings: Findings, key: RunKey | SineKey | Part, result: object) -> None:
    match key, result:
        case RunKey(), ExperimentRun():
            findings.trials[key] = result.trial
            if result.samples is not None:
                findings.samples[key] = result.samples
        case SineKey(), SineResponse():
            findings.sine_responses.append(result)
        case Part.FIELD, FieldRuns():
            findings.field_logs = result.logs
            findings.trials[FIELD_WITH] = result.with_lead_data
            findings.trials[FIELD_WITHOUT] = result.without_lead_data
        case Part.GAINS, tuple():
            findings.gains_pictures = result
        case _:
            raise TypeError(f"{key}: unexpected result {type(result).__name__}")
