"""Made-up findings of a reproduction."""

from dataclasses import replace

import numpy as np

from scenarios.studies.paper.drives import Drive, Trial
from scenarios.studies.paper.measures import Findings, SampleFigures
from scenarios.studies.paper.runs import RUNS_OF_CASE, SINES, at_sine

SPEED = 30.0


def trial_of(tracking: tuple[float, ...], true: tuple[float, ...] | None = None) -> Trial:
    """Make a run of 35 s whose followers have these largest errors (m), 12 s after the start."""
    at = np.arange(0.0, 35.0, 0.1)
    bump = np.exp(-((at - 12.0) ** 2))
    peak = bump / bump.max()
    nothing = np.zeros(len(at))
    east = SPEED * at
    lead = Drive("v1", at, east, -peak, nothing + SPEED, nothing, nothing, east, nothing)
    followers = [
        replace(lead, name=f"v{k}", lateral_error=-error * peak, cross_track=true_error * peak)
        for k, (error, true_error) in enumerate(zip(tracking, true or tracking, strict=True), 2)
    ]
    return Trial((lead, *followers))


def sine_of(frequency: float, amplitudes: tuple[float, ...]) -> Trial:
    """Make a run whose vehicles drive sines with these amplitudes (m)."""
    lead = trial_of(()).lead
    wave = np.sin(frequency * lead.east / SPEED)
    return Trial(tuple(replace(lead, north=size * wave) for size in amplitudes))


def findings_with_all_claims_true() -> Findings:
    falling, growing = trial_of((0.08, 0.06, 0.05)), (0.08, 0.16, 0.25)
    keys = [key for runs in RUNS_OF_CASE.values() for key in runs if "phase" not in key]
    trials = dict.fromkeys(keys, falling)
    trials |= {key: falling for key in keys if key.endswith("noise/1")}
    trials["no_lead_data"] = trials["long/without"] = trial_of((0.08, 0.08, 0.08), growing)
    for seed in (1, 2, 3):
        trials[f"no_lead_data/noise/{seed}"] = trials["no_lead_data"]
    for case, errors in (
        ("a", (0.03, 0.02, 0.01)),
        ("b", (0.03, 0.02, 0.01)),
        ("c", (0.05, 0.04, 0.03)),
    ):
        trials |= {key: trial_of(errors) for key in keys if key.split("/")[0] == case}
    trials["variable_speed"] = trial_of((0.10, 0.09, 0.08))
    late = trial_of((0.05, 0.04))
    first, second = late.followers
    later = replace(second, cross_track=np.roll(second.cross_track, 20))
    for key in ("field/with", "field/with/noise/1", "field/with/noise/2"):
        trials[key] = Trial((late.lead, first, later))
    for key in ("field/without", "field/without/noise/1", "field/without/noise/2"):
        trials[key] = trial_of((0.05, 0.06))
    for key in ("field/no_initial_error", "field/slip_compensated"):
        trials[key] = late
    for preview, frequencies in SINES.items():
        for frequency in frequencies:
            trials[at_sine(preview, frequency)] = sine_of(frequency, (1.0, 1.1, 1.2, 1.3))
    parts = frozenset({"gains", "propagation"})
    return Findings("fitted", trials, SampleFigures(16, 15, 1.5), parts)
