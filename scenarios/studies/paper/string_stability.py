"""String stability of the simulated convoys by Definition 1, in L2, and of true errors."""

import numpy as np

from scenarios.results.drives import Trial
from scenarios.studies.paper.base_case import levels_off, off_the_road
from scenarios.studies.paper.claim import Answer, Claims, by_runs
from scenarios.studies.paper.experiments import (
    BASE,
    LONG_WITH,
    LONG_WITHOUT,
    NO_LEAD_DATA,
    VARIABLE_SPEED,
    A,
    B,
    C,
    D,
)
from scenarios.studies.paper.findings import (
    TOLERANCE_M,
    Findings,
    better_laws,
    cm,
    empty_transfer,
    in_cm,
    non_increasing,
    predict_errors,
    transfer,
)
from scenarios.studies.paper.other_cases import SIMULATIONS
from transport.columns import Floats
from vehicles.theory.linear_model import Transfer, chain_offsets
from vehicles.theory.string_stability import head_to_tail, is_string_stable, peak

OTHERS = (A, B, C, D, VARIABLE_SPEED)
"""The simulations other than the base case."""

ALPHA = 0.5
"""The paper's weight of the predecessor."""

MANY = 60
"""Number of followers of a convoy that stands for any number."""

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
        + (", ".join(others) or "any")
        + better_laws(findings, BASE),
        reason="the norm combines metres and radians: in these units the heading is never "
        "decisive. Judged by tracking errors, as the figures of V-C; in Section IV-B e_lat is the "
        "distance from the common line, for which the row on true errors stands",
        numbers={"norm_max": norms, "heading_error_rad_max": heading},
    )


@CLAIMS.claim(
    where="IV-B; weaker senses, eight cars",
    paper="With the lead's data, errors are bounded for any number of cars",
    needs=(BASE, LONG_WITH, LONG_WITHOUT),
)
def bounded_along_the_convoy(findings: Findings) -> Answer:
    loaded = transfer(BASE)
    contraction = ALPHA * peak(loaded).magnitude
    with_data, without = findings.trials[LONG_WITH], findings.trials[LONG_WITHOUT]
    limit = predict_errors(findings.trials[BASE].lead, loaded, ALPHA, MANY)[1][-1]
    gains, without_gains = (largest_gains(loaded, alpha) for alpha in (ALPHA, 1.0))
    last, step = len(with_data.followers), head_to_tail(l2_norms(with_data)[:2])
    level = levels_off(with_data)
    word = "level off" if level else f"do not level off{off_the_road(with_data)}"
    empty = ALPHA * peak(empty_transfer()).magnitude
    return Answer(
        **by_runs(findings, lambda run: levels_off(run) and contraction < 1.0, LONG_WITH),
        ours=f"true errors {in_cm(with_data.cross_track)} {word} (theory: at {cm(limit)}); "
        f"without the lead's data {in_cm(without.cross_track)}. The gain in L2 from the lead's "
        f"offset to any car's error is at most {max(gains):.1f}, with any number of cars; without "
        f"the lead's data {without_gains[last - 1]:.0f} for car {last + 1}, growing as ‖F‖∞ⁿ = "
        f"{peak(loaded).magnitude:.2f}ⁿ",
        reason=(
            "it levels off, so it is string stable in the sense of Swaroop and Hedrick (1996: the "
            "largest errors are bounded for any number of cars) and of Ploeg et al. (2014, L2: the "
            "error of each car is bounded by the lead's manoeuvre), though Definition 1 fails. "
            if level
            else "it does not level off, so it is string stable neither in the sense of Swaroop "
            "and Hedrick (1996: the largest errors are bounded for any number of cars) nor in that "
            "of Ploeg et al. (2014, L2: the error of each car is bounded by the lead's manoeuvre). "
        )
        + "Definition 1 is the strict form in L∞: no car amplifies the error of the car ahead. "
        f"Here the second follower has {step:.2f} times the error of the first in L2. Feng et al. "
        "(2019) compare both forms: the strict one, from car to car, implies the weak one, from "
        "the lead to each car, but not conversely. Linear theory without the fit: with the base "
        f"case's loaded cars α‖F‖∞ = {contraction:.2f} < 1, so the contributions of all cars ahead "
        "converge, in L2 and (Gelfand's formula) in L∞. With empty cars at 30 m/s α‖F‖∞ = "
        f"{empty:.2f}, at {peak(empty_transfer()).frequency:.0f} rad/s: theory does not bound "
        "their errors; the fit smooths that wavelength of 9 m"
        + ("" if level else ". This trajectory is not linear: its circles lead a car off the road"),
        numbers={
            "alpha_norm_f_ratio": contraction,
            "alpha_norm_f_of_empty_cars_ratio": empty,
            "limit_m": limit,
            "largest_gain_ratio": max(gains),
            "largest_gain_without_ratio": without_gains[last - 1],
            "second_over_first_l2_ratio": step,
        },
    )


def largest_gains(transfer: Transfer, alpha: float) -> tuple[float, ...]:
    """Gain in L2 from the lead's offset to the true error of each of MANY followers.

    The largest magnitude of `chain_offsets` over frequencies from 0.01 to 200 rad/s.
    """
    frequencies = np.geomspace(0.01, 200.0, 4000)
    gains = np.abs(chain_offsets(transfer, frequencies, alpha, MANY)).max(axis=1)
    return tuple(gains.tolist())


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
        + "; ".join(
            f"{key.label} {in_cm(trial.cross_track)}{better_laws(findings, key, 'cross_track')}"
            for key, trial in trials.items()
        ),
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
    slip = findings.trials.get(BASE.with_variant("slip_compensated"))
    better = ""
    if slip is not None and max(l2_norms(slip)) < max(l2_norms(trial)):
        better = f". Better: slip compensation, {_in_l2(slip)}"
    return Answer(
        **by_runs(findings, does_not_amplify, BASE),
        ours=_in_l2(trial) + better,
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


def _section(trial: Trial) -> Floats:
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
