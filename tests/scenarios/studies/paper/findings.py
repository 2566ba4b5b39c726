"""Made-up findings of a reproduction."""

from dataclasses import replace

import numpy as np

from scenarios.results.drives import Drive, Trial
from scenarios.studies.paper.experiments import (
    ALPHAS,
    BASE,
    FIELD_NO_INITIAL_ERROR,
    FIELD_SLIP_COMPENSATED,
    FIELD_WITH,
    FIELD_WITHOUT,
    LATENCIES_MS,
    LONG_WITH,
    LONG_WITHOUT,
    LOSSES_PERCENT,
    NO_LEAD_DATA,
    NOISE_WITH,
    NOISE_WITHOUT,
    OTHER_LAWS,
    PREVIEWS_S,
    RADII,
    VARIABLE_SPEED,
    A,
    B,
    C,
    D,
    RunKey,
    at_alpha,
    at_preview,
    at_radius,
)
from scenarios.studies.paper.findings import (
    FREQUENCIES,
    PREVIEW_S,
    SHORT_FREQUENCIES,
    SHORT_PREVIEW_S,
    Findings,
    SampleFigures,
    SineResponse,
)
from vehicles.preview.curve_fit import Trajectory


def trial_of(tracking: tuple[float, ...], true: tuple[float, ...] | None = None) -> Trial:
    """Make a run of 35 s whose followers have these largest errors (m), 12 s after the start."""
    at = np.arange(0.0, 35.0, 0.1)
    bump = np.exp(-((at - 12.0) ** 2))
    peak = bump / bump.max()
    nothing = np.zeros(len(at))
    east = 30.0 * at
    lead = Drive("v1", at, east, -peak, nothing + 30.0, nothing, nothing, east, nothing)
    followers = [
        replace(lead, name=f"v{k}", lateral_error=-error * peak, cross_track=true_error * peak)
        for k, (error, true_error) in enumerate(zip(tracking, true or tracking, strict=True), 2)
    ]
    return Trial((lead, *followers))


def late_third_car(error: float) -> Trial:
    """Make a run in which the second follower has its largest error (m) later than the first."""
    trial = trial_of((0.05, error))
    first, second = trial.followers
    return Trial((trial.lead, first, replace(second, cross_track=np.roll(second.cross_track, 20))))


def along_both_trajectories(findings: Findings) -> dict[Trajectory, Findings]:
    return {"fitted": findings, "paper": replace(findings, trajectory="paper")}


def findings_with_all_claims_true() -> Findings:
    falling = trial_of((0.08, 0.06, 0.05))
    same = (
        BASE,
        BASE.with_variant("blend"),
        BASE.with_variant("as_is"),
        D,
        VARIABLE_SPEED.with_variant("blend"),
    )
    varied = (
        *map(at_alpha, ALPHAS),
        *map(at_preview, PREVIEWS_S),
        *(RunKey("loss", value=percent) for percent in LOSSES_PERCENT),
        *(RunKey("latency", value=latency) for latency in LATENCIES_MS),
        *(key.noisy(1) for key in (NOISE_WITH, NOISE_WITHOUT)),
    )
    trials = dict.fromkeys((*same, *varied), falling)
    trials[NO_LEAD_DATA] = trial_of((0.08, 0.08, 0.08), (0.08, 0.16, 0.25))
    trials[LONG_WITH] = trial_of((0.08, 0.06, 0.05), (0.08, 0.06, 0.05))
    trials[LONG_WITHOUT] = trial_of((0.08, 0.08, 0.08), (0.08, 0.16, 0.25))
    for key in (A, A.with_variant("slip_compensated"), A.with_variant("same_times"), B):
        trials[key] = trial_of((0.03, 0.02, 0.01))
    for key in (C, C.with_variant("slip_compensated"), C.with_variant("same_times")):
        trials[key] = trial_of((0.05, 0.04, 0.03))
    trials[VARIABLE_SPEED] = trial_of((0.10, 0.09, 0.08))
    for radius in RADII:
        trials[at_radius(radius)] = trials[at_radius(radius).noisy(1)] = falling
    for law in OTHER_LAWS:
        trials[BASE.with_variant(law)] = falling
    trials[FIELD_WITH], trials[FIELD_WITHOUT] = late_third_car(0.04), trial_of((0.05, 0.06))
    for key in (FIELD_NO_INITIAL_ERROR, FIELD_SLIP_COMPENSATED):
        trials[key] = trial_of((0.05, 0.04))
    responses = [
        SineResponse(frequency, preview, (1.0, 1.1, 1.2, 1.3))
        for preview, frequencies in (
            (PREVIEW_S, FREQUENCIES),
            (SHORT_PREVIEW_S, SHORT_FREQUENCIES),
        )
        for frequency in frequencies
    ]
    samples = {BASE: SampleFigures(16, 15, 1.5)}
    return Findings(trials=trials, samples=samples, sine_responses=responses, gains_pictures=())
