"""String stability of the simulated convoys by Definition 1, in L2, and of true errors."""

import numpy as np

from scenarios.results.drives import Array, Trial
from scenarios.studies.paper.claims.claim import Answer, Claims, by_runs
from scenarios.studies.paper.claims.other_cases import SIMULATIONS
from scenarios.studies.paper.findings import TOLERANCE_M, Findings, cm, in_cm, non_increasing
from scenarios.studies.paper.keys import BASE, NO_LEAD_DATA, VARIABLE_SPEED, A, B, C, D
from vehicles.theory.string_stability import head_to_tail, is_string_stable

OTHERS = (A, B, C, D, VARIABLE_SPEED)
"""The simulations other than the base case."""

SPACING = 0.5
"""Distance (m) between the points of the lead's path at which cars are compared."""

CLAIMS = Claims()


@CLAIMS.claim(
    where="IV-B, Definition 1, with heading",
    paper="‖(e_lat, θ̃)‖∞ of a follower does not exceed that of its predecessor",
    needs=SIMULATIONS,
)
def definition_1(findings: Findings) -> Answer:
    trial = findings.trials[BASE]
    norms = definition_1_norms(trial)
    others = [key.label for key in SIMULATIONS if not holds_definition_1(findings.trials[key])]
    heading = [float(np.abs(drive.heading_error).max()) for drive in trial.followers]
    return Answer(
        **by_runs(findings, holds_definition_1, BASE),
        ours="base case "
        + ", ".join(f"{norm:.4f}" for norm in norms)
        + ", the larger of |e_lat| in m and |θ̃| in rad (|θ̃| alone "
        + ", ".join(f"{angle:.4f}" for angle in heading)
        + "). Of the six simulations, it does not hold in "
        + (", ".join(others) or "any"),
        reason="the norm combines metres and radians: in these units the heading is never decisive",
        numbers={"norm_max": norms, "heading_error_rad_max": heading},
    )


@CLAIMS.claim(
    where="V-C.2, V-C.3; IV-B (no car will be off-track)",
    paper="Also in A to D and at variable speed, no car is farther off the track than the car "
    "ahead",
    needs=OTHERS,
)
def others_true(findings: Findings) -> Answer:
    def stays_on_track(*runs: Trial) -> bool:
        return all(non_increasing(run.cross_track) for run in runs)

    trials = {key: findings.trials[key] for key in OTHERS}
    return Answer(
        **by_runs(findings, stays_on_track, *OTHERS),
        ours="true errors: "
        + "; ".join(f"{key.label} {in_cm(trial.cross_track)}" for key, trial in trials.items()),
        reason="as in the base case, every car adds its own error to half of its predecessor's",
        numbers={str(key): trial.cross_track for key, trial in trials.items()},
    )


@CLAIMS.claim(
    where="IV-B, in L2 (whose induced norm is ‖G‖∞), at equal arc length",
    paper="With the predecessor's data only, errors amplify from car to car",
    needs=(NO_LEAD_DATA,),
)
def amplified_in_l2(findings: Findings) -> Answer:
    def grows(run: Trial) -> bool:
        return not is_string_stable(l2_norms(run), TOLERANCE_M * length(run) ** 0.5)

    trial = findings.trials[NO_LEAD_DATA]
    return Answer(
        **by_runs(findings, grows, NO_LEAD_DATA),
        ours=_in_l2(trial),
        reason="all cars over the same section of the lead's path",
        numbers=_numbers(trial),
    )


@CLAIMS.claim(
    where="V-C.1, in L2, at equal arc length",
    paper="With the lead's data, errors do not amplify from car to car",
    needs=(BASE,),
)
def not_amplified_in_l2(findings: Findings) -> Answer:
    def does_not_amplify(run: Trial) -> bool:
        return is_string_stable(l2_norms(run), TOLERANCE_M * length(run) ** 0.5)

    trial = findings.trials[BASE]
    return Answer(
        **by_runs(findings, does_not_amplify, BASE),
        ours=_in_l2(trial),
        reason="judged by true errors, for all cars over the same section of the lead's path. "
        f"Growth by less than {1000 * TOLERANCE_M:.0f} mm rms is ignored",
        numbers=_numbers(trial),
    )


def definition_1_norms(trial: Trial) -> tuple[float, ...]:
    """‖(e_lat, θ̃)‖∞ of each follower over its run: the larger maximum, in m and rad."""
    return tuple(
        float(np.maximum(np.abs(drive.lateral_error), np.abs(drive.heading_error)).max())
        for drive in trial.followers
    )


def holds_definition_1(trial: Trial) -> bool:
    """Whether no follower's norm exceeds that of the car ahead by more than TOLERANCE_M."""
    return is_string_stable(definition_1_norms(trial), TOLERANCE_M)


def l2_norms(trial: Trial, measure: str = "cross_track") -> tuple[float, ...]:
    """√∫d² ds (m^1.5) of each follower, over the section of the lead's path that all have driven.

    `measure` names an array of a `Drive`: `cross_track` or `lateral_error` (tracking).
    """
    places = _section(trial)
    norms = []
    for drive in trial.followers:
        values = getattr(drive, measure)[: len(drive.station)]
        errors = np.interp(places, drive.station, values)
        norms.append(float(np.sqrt(np.sum(errors * errors) * SPACING)))
    return tuple(norms)


def length(trial: Trial) -> float:
    """Length (m) of the section that all followers have driven."""
    return SPACING * len(_section(trial))


def _section(trial: Trial) -> Array:
    begin = max(float(drive.station[0]) for drive in trial.followers)
    end = min(float(drive.station[-1]) for drive in trial.followers)
    return np.arange(begin, end, SPACING, dtype=np.float64)


def _in_l2(trial: Trial) -> str:
    own, true = (l2_norms(trial, measure) for measure in ("lateral_error", "cross_track"))
    root = length(trial) ** 0.5
    return (
        f"over {length(trial):.0f} m, rms of true errors "
        + ", ".join(cm(norm / root) for norm in true)
        + f" (head to tail {head_to_tail(true):.2f}), of tracking errors "
        + ", ".join(cm(norm / root) for norm in own)
        + f" (head to tail {head_to_tail(own):.2f})"
    )


def _numbers(trial: Trial) -> dict[str, object]:
    own, true = (l2_norms(trial, measure) for measure in ("lateral_error", "cross_track"))
    root = length(trial) ** 0.5
    return {
        "stretch_m": length(trial),
        "cross_track_error_m_rms": [norm / root for norm in true],
        "tracking_error_m_rms": [norm / root for norm in own],
        "head_to_tail_ratio": head_to_tail(true),
        "head_to_tail_own_trajectory_ratio": head_to_tail(own),
    }
