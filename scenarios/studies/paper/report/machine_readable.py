"""report.json, the machine-readable results of `convoy reproduce`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from scenarios.results.drives import Trial
from scenarios.studies.paper.claims.claim import ClaimVerdict, JudgedClaim
from scenarios.studies.paper.claims.field_experiment import numbers_of, settled_errors
from scenarios.studies.paper.experiments import RUNS_OF_CASE
from scenarios.studies.paper.findings import Findings, non_increasing
from scenarios.studies.paper.keys import FIELD_WITH, FIELD_WITHOUT, Part
from vehicles.preview.curve_fit import Trajectory

SCHEMA = "convoy.reproduction/3"

AllFindings = Mapping[Trajectory, Findings]


def logs(findings: AllFindings, cases: Sequence[str]) -> list[str]:
    runs = {key: run for case in cases for key, run in RUNS_OF_CASE[case].items()}
    paths = []
    for kind, results in findings.items():
        logged = [key for key, run in runs.items() if run.logged and results.has(key)]
        paths += [f"{kind}/{key}/run.mcap" for key in logged]
        paths += [f"{kind}/field/{name}/run.mcap" for name in results.field_logs]
    return paths


def machine_readable(
    findings: AllFindings,
    cases: Sequence[str],
    claims: Sequence[JudgedClaim],
    pictures: Mapping[str, Sequence[str]],
) -> dict[str, Any]:
    """Claims, figures of the runs, plots and logs as JSON."""
    gains_pictures = next(iter(findings.values())).gains_pictures or ()
    drawn = [file for files in pictures.values() for file in files]
    return {
        "schema": SCHEMA,
        "cases": list(cases),
        "claims": [_row(claim) for claim in claims],
        "runs": {kind: _runs_of(results) for kind, results in findings.items()},
        "propagation": {kind: _propagation(results) for kind, results in findings.items()},
        "pictures": [*drawn, *(f"gains/{name}" for name in gains_pictures)],
        "logs": logs(findings, cases),
    }


def _runs_of(findings: Findings) -> dict[str, Any]:
    runs = {str(key): _figures(trial) for key, trial in findings.trials.items()}
    if findings.has(Part.FIELD):
        for key in (FIELD_WITH, FIELD_WITHOUT):
            runs[str(key)] |= numbers_of(settled_errors(findings.trials[key]))
    return runs


def _propagation(findings: Findings) -> list[dict[str, Any]]:
    return [
        {
            "frequency_radps": response.frequency,
            "preview_s": response.preview_s,
            "amplitude_m": np.abs(response.amplitudes).tolist(),
            "ratio": response.ratios,
        }
        for response in sorted(findings.sine_responses, key=lambda response: response.frequency)
    ]


def _row(row: JudgedClaim) -> dict[str, Any]:
    claim = row.claim
    return {
        "name": claim.name,
        "where": claim.where,
        "paper": claim.paper,
        "driven": claim.simulated,
        "trajectories": {kind: _verdict_row(verdict) for kind, verdict in row.verdicts.items()},
    }


def _verdict_row(verdict: ClaimVerdict) -> dict[str, Any]:
    answer = verdict.answer
    return {
        "ours": answer.ours,
        "verdict": verdict.judgement,
        "reason": answer.reason,
        "phases": answer.phases._asdict() if answer.phases else None,
        "noise": answer.noise._asdict() if answer.noise else None,
        "numbers": answer.numbers,
    }


def _figures(trial: Trial) -> dict[str, Any]:
    return {
        "vehicles": [drive.name for drive in trial.followers],
        "lead_tracking_error_m_max": trial.lead.tracking_max,
        "tracking_error_m_max": trial.tracking,
        "cross_track_error_m_max": trial.cross_track,
        "tracking_decreases": non_increasing(trial.tracking),
        "cross_track_decreases": non_increasing(trial.cross_track),
    }
