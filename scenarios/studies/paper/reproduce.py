"""`convoy paper reproduce`: run the paper's experiments, judge its claims, write one report."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from shutil import rmtree
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.wording import did_you_mean
from scenarios.results.tables import Collector, RunTables
from scenarios.studies.engine import study_engine
from scenarios.studies.job import Job, Work, refuse_existing
from scenarios.studies.paper.claims import counts_text
from scenarios.studies.paper.drives import TRIAL_KINDS, Trial, drive_trial, record_trial
from scenarios.studies.paper.measures import Findings, SampleFigures, sample_figures
from scenarios.studies.paper.runs import RUNS_OF_CASE, TRAJECTORIES, PaperRun
from scenarios.studies.workers import open_workers
from vehicles.messages import CompositeTrajectory
from vehicles.preview.curve_fit import Trajectory

REPORT = "report.md"
WORKERS = 2
GAINS = "gains"


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
    from scenarios.studies.paper.plots import PICTURES  # noqa: PLC0415 - brings matplotlib
    from scenarios.studies.paper.report import write_report  # noqa: PLC0415 - brings matplotlib

    chosen = chosen_cases(cases)
    jobs = jobs_of(chosen, out, picture_format)
    pictures = (f"{name}_{kind}.{picture_format}" for name in PICTURES for kind in TRAJECTORIES)
    written = [REPORT, "report.json", *pictures, *jobs]
    refuse_existing(*(out / name for name in written), place="folder by --out")
    out.mkdir(parents=True, exist_ok=True)
    with study_engine(partial(open_workers, workers), progress) as engine:
        engine.progress.total = len(jobs)
        parts = [Job(key=key, work=work) for key, work in jobs.items()]
        results = dict(zip(jobs, engine.results(parts), strict=True))
    gains_pictures = results.pop(GAINS, ())
    findings = {kind: _findings(kind, chosen, results) for kind in TRAJECTORIES}
    claims = write_report(findings, chosen, out, picture_format, gains_pictures)
    for kind, name in TRAJECTORIES.items():
        progress(f"claims with {name}: {counts_text(claims, kind)}")
    progress(f"report: {out / REPORT}")
    return 0


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


def jobs_of(cases: Sequence[str], out: Path, picture_format: str = "png") -> dict[str, Work]:
    """Jobs of the cases by trajectory and key of the run, the long, logged runs first."""
    runs = {key: run for case in cases for key, run in RUNS_OF_CASE[case].items()}
    jobs: dict[str, Work] = {}
    if GAINS in cases:
        jobs[GAINS] = partial(_gains, out / GAINS, picture_format)
    for key, run in sorted(runs.items(), key=lambda entry: not entry[1].logged):
        for kind in TRAJECTORIES:
            name = f"{kind}/{key}"
            jobs[name] = partial(simulate, run, kind, key, out / name)
    return jobs


def simulate(
    run: PaperRun, kind: Trajectory, key: str, folder: Path
) -> tuple[Trial, SampleFigures | None]:
    """Drives of a run; of the base case also the figures of the samples that followers fitted."""
    scenario = run.with_trajectory(kind)
    if not run.logged:
        return drive_trial(scenario), None
    rmtree(folder, ignore_errors=True)  # of an earlier, killed worker
    collector = Collector(TRIAL_KINDS | {CompositeTrajectory})
    trial = record_trial(scenario, folder, observers=(collector,) if key == "base" else ())
    tables = RunTables(scenario, collector.tables())
    return trial, sample_figures(tables) if key == "base" else None


def _gains(folder: Path, picture_format: str) -> tuple[str, ...]:
    from scenarios.studies.gains.report import gains_report  # noqa: PLC0415 - brings matplotlib
    from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS  # noqa: PLC0415

    rmtree(folder, ignore_errors=True)
    report = gains_report(LINCOLN_MKZ, NOMINAL_GAINS, out_dir=folder, picture_format=picture_format)
    return tuple(report["pictures"])


def _findings(
    kind: Trajectory, cases: Sequence[str], results: dict[str, tuple[Trial, Any]]
) -> Findings:
    """Collect the runs with one kind of trajectory."""
    own = {
        name.removeprefix(f"{kind}/"): result
        for name, result in results.items()
        if name.startswith(f"{kind}/")
    }
    samples = own["base"][1] if "base" in own else None
    return Findings(
        trajectory=kind,
        trials={key: trial for key, (trial, _) in own.items()},
        samples=samples or SampleFigures(),
        parts=frozenset({GAINS, "propagation"}).intersection(cases),
    )
