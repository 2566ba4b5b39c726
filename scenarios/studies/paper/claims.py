"""The paper's numbers and claims: one table, whose rows are judged on the results of the runs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from scenarios.definition.scenario import load_scenario
from scenarios.studies.paper import calculations, measures
from scenarios.studies.paper.drives import Trial
from scenarios.studies.paper.measures import EMPTY, TOLERANCE_M, Findings, predict_errors, transfer
from scenarios.studies.paper.runs import (
    ALPHAS,
    BASE_SPEED,
    LANE,
    LATENCIES_MS,
    LOSSES_PERCENT,
    OTHER_LAWS,
    PREVIEW_S,
    PREVIEWS_S,
    RADII,
    SHORT_PREVIEW_S,
    SIMULATIONS,
    at_alpha,
    at_preview,
    at_radius,
)
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS
from vehicles.preview.curve_fit import FitSettings, Trajectory
from vehicles.theory.linear_model import propagation
from vehicles.theory.string_stability import largest_weight, peak

# ---- Rows, values and verdicts


Judgement = Literal["holds", "undecided", "misprint, harmless", "does not hold", "not checkable"]
JUDGEMENTS: Mapping[Judgement, str] = {
    "holds": "hold",
    "undecided": "undecided",
    "misprint, harmless": "harmless misprints",
    "does not hold": "do not hold",
    "not checkable": "cannot be checked",
}


class Values(NamedTuple):
    """The judged value in each exact run, which differ in `kind`, and in each noisy run.

    `figures` are other results by name and unit, such as "limit_m".
    """

    exact: Sequence[float]
    kind: str = "phases"
    noisy: Sequence[float] = ()
    figures: Mapping[str, Any] = {}


Calculate = Callable[[Findings], Values]


@dataclass(frozen=True, slots=True)
class Expected:
    """What the paper states: the value is below, above or near a limit, in a unit."""

    relation: Literal["<", "≤", ">", "≈"]
    limit: float
    unit: str = ""
    tolerance: float = 0.0

    def holds(self, value: float) -> bool:
        match self.relation:
            case "<":
                return value < self.limit
            case "≤":
                return value <= self.limit
            case ">":
                return value > self.limit
            case "≈":
                return abs(value - self.limit) <= self.tolerance


@dataclass(frozen=True, slots=True)
class Claim:
    """A row: name, section or equation, the paper's statement, value, and what is expected of it.

    The claim is judged if the findings have the runs and parts of `needs`. A claim without an
    expected value cannot be checked. A claim that does not hold is a `misprint` if it is wrong as
    printed and no other claim depends on it. Only the values of `simulated` claims depend on the
    trajectory.
    """

    name: str
    where: str
    paper: str
    value: Calculate
    expected: Expected | None
    needs: tuple[str, ...]
    note: str = ""
    misprint: bool = field(default=False, kw_only=True)
    simulated: bool = field(default=True, kw_only=True)

    def judge(self, values: Values) -> Judgement:
        """A claim that holds in only some of its exact runs is undecided."""
        if self.expected is None:
            return "not checkable"
        holding = [self.expected.holds(value) for value in values.exact]
        if all(holding):
            return "holds"
        if any(holding):
            return "undecided"
        return "misprint, harmless" if self.misprint else "does not hold"

    def holding(self, values: Sequence[float]) -> int:
        return sum(self.expected is not None and self.expected.holds(value) for value in values)


@dataclass(frozen=True, slots=True)
class JudgedClaim:
    """A claim with its values and verdict by trajectory."""

    claim: Claim
    values: Mapping[Trajectory, Values]
    verdicts: Mapping[Trajectory, Judgement]


def judge_all(
    findings: Mapping[Trajectory, Findings], claims: Iterable[Claim] | None = None
) -> list[JudgedClaim]:
    """Judge the claims, by default all, whose runs are there with every trajectory."""
    judged = []
    for claim in CLAIMS if claims is None else claims:
        if all(results.has(*claim.needs) for results in findings.values()):
            values = {kind: claim.value(results) for kind, results in findings.items()}
            verdicts = {kind: claim.judge(found) for kind, found in values.items()}
            judged.append(JudgedClaim(claim, values, verdicts))
    return judged


def counts_text(claims: Sequence[JudgedClaim], kind: Trajectory) -> str:
    verdicts = [claim.verdicts[kind] for claim in claims]
    return ", ".join(f"{verdicts.count(name)} {words}" for name, words in JUDGEMENTS.items())


# ---- Kinds of rows


def of_runs(
    measure: Callable[..., float],
    *keys: str,
    figures: Callable[[Findings], Mapping[str, Any]] = lambda _: {},
) -> Calculate:
    """Value of a measure of the runs `keys`: exact, on shifted roads, and with noise."""

    def value(findings: Findings) -> Values:
        exact, noisy = (
            [measure(*runs) for runs in zip(*map(repeated, keys), strict=False)]
            for repeated in (findings.moved, findings.noisy)
        )
        return Values(exact, "phases", noisy, figures(findings))

    return value


def row(  # noqa: PLR0917 - a row of the table below
    name: str,
    where: str,
    paper: str,
    measure: Callable[..., float],
    keys: tuple[str, ...],
    expected: Expected,
    note: str = "",
    **figures: Any,
) -> Claim:
    """A claim on runs."""
    return Claim(name, where, paper, of_runs(measure, *keys, **figures), expected, keys, note)


def calculated(  # noqa: PLR0917 - a row of the table below
    name: str,
    where: str,
    paper: str,
    calculate: Callable[[], tuple[float, Mapping[str, Any]]],
    expected: Expected,
    note: str = "",
    *,
    need: str = "gains",
    misprint: bool = False,
) -> Claim:
    """A claim that is calculated, not simulated."""

    def value(_: Findings) -> Values:
        number, figures = calculate()
        return Values([number], figures=figures)

    return Claim(
        name, where, paper, value, expected, (need,), note, misprint=misprint, simulated=False
    )


def decreasing(key: str, where: str, conditions: str = "", note: str = "") -> Claim:
    """The largest errors do not increase from follower to follower."""
    paper = f"Largest errors decrease along the convoy{conditions}"
    return row(f"{key}_decreasing", where, paper, measures.tracking_growth, (key,), NO_GROWTH, note)


# ---- Values of claims on several runs


def _samples(findings: Findings) -> Values:
    samples = findings.samples
    most = max(samples.lead, samples.predecessor)
    figures = {"lead_samples": samples.lead, "predecessor_samples": samples.predecessor}
    return Values([most], figures=figures)


def _changes(findings: Findings) -> Values:
    """Most changes of curvature that the lead of the base case reaches within a second."""
    settings = FitSettings(trajectory=findings.trajectory)
    window = (settings.ahead(BASE_SPEED) + settings.behind(BASE_SPEED)) / BASE_SPEED
    route = load_scenario("paper_base").route
    distances = np.arange(0.0, route.path.length - route.start, 0.1)
    curvatures = np.array([route.path.at(route.start + s).curvature for s in distances])
    at = distances[1:][np.abs(np.diff(curvatures)) > 1e-6] / route.profile.speeds[0]

    def most(span: float) -> int:
        return max(int(np.sum((at >= first) & (at < first + span - 0.01))) for first in at)

    return Values([most(1.0)], figures={"window_s": window, "changes_in_window": most(window)})


def _over(
    kind: str, keys: Mapping[str, float], measure: Callable[[Trial], float], findings: Findings
) -> Values:
    """Value in the exact run of each key, and in the noisy runs of all of them the largest."""
    noisy = [[measure(run) for run in findings.noisy(key)] for key in keys]
    exact = {f"{value:g}": measure(findings.trials[key]) for key, value in keys.items()}
    worst = [max(values) for values in noisy if values]
    return Values([*exact.values()], kind, worst, {f"by_{kind}": exact})


def _noise(findings: Findings) -> Values:
    runs, others = findings.noisy("noise_along/with"), findings.noisy("noise_along/without")
    figures = {
        "with_m_rms": measures.rms_after(5.0, *runs),
        "without_m_rms": measures.rms_after(5.0, *others),
    }
    return Values(
        [measures.noise_growth(*runs)],
        "all seeds",
        [measures.noise_growth(run) for run in runs],
        figures,
    )


def _measured_propagation(findings: Findings) -> Values:
    frequencies, ratios = findings.ratios(PREVIEW_S)
    short_at, short = findings.ratios(SHORT_PREVIEW_S)
    mean = ratios.prod(axis=1) ** (1.0 / ratios.shape[1])
    paper = propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_SPEED)
    figures = {
        "frequency_radps": frequencies.tolist(),
        "measured_ratio": ratios.tolist(),
        "g_ratio": np.abs(paper.at(frequencies)).tolist(),
        "f_ratio": np.abs(EMPTY.at(frequencies)).tolist(),
        "short_preview_frequency_radps": short_at.tolist(),
        "short_preview_measured_ratio": short.tolist(),
    }
    return Values(mean[frequencies <= LOW_FREQUENCY].tolist(), "frequencies", (), figures)


LOW_FREQUENCY = 2.5
"""Upper end (rad/s) of the low frequencies of Section IV-B."""
MANY = 60
"""Number of followers of a convoy that stands for any number."""


def _bounded_figures(findings: Findings) -> dict[str, float]:
    """Linear theory of the base case's convoy with the lead's data (α = 0.5) and without."""
    car, last = transfer(), len(findings.trials["long/with"].followers)
    lead = findings.trials["base"].lead
    return {
        "alpha_norm_f_ratio": 0.5 * peak(car).magnitude,
        "alpha_norm_f_of_empty_cars_ratio": 0.5 * peak(EMPTY).magnitude,
        "limit_m": predict_errors(lead, car, 0.5, MANY)[1][-1],
        "largest_gain_ratio": max(measures.largest_gains(car, 0.5, MANY)),
        "largest_gain_without_ratio": measures.largest_gains(car, 1.0, last)[-1],
    }


def _alphas(findings: Findings) -> Values:
    lead, car = findings.trials["base"].lead, transfer()
    theory = {f"{alpha:g}": predict_errors(lead, car, alpha, 7)[1][-1] for alpha in ALPHAS}
    steps = [measures.excess_of_last_step(findings.trials[at_alpha(a)]) for a in ALPHAS if a < 1.0]
    figures = {
        "theory_of_last_car_m_by_alpha": theory,
        "largest_alpha_f_ratio": largest_weight(car),
        "largest_alpha_f_of_empty_cars_ratio": largest_weight(EMPTY),
        "largest_alpha_g_ratio": largest_weight(
            propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_SPEED)
        ),
    }
    return Values(steps, "weights", (), figures)


def _previews(findings: Findings) -> Values:
    errors = {
        f"{t:g}": measures.largest_tracking(findings.trials[at_preview(t)]) for t in PREVIEWS_S
    }
    return Values([errors["0.8"]], figures={"tracking_error_m_by_preview_s": errors})


def _rms_figures(key: str, findings: Findings) -> dict[str, Any]:
    run = findings.trials[key]
    names = {"true_error_m_rms": "cross_track", "tracking_error_m_rms": "lateral_error"}
    return {name: measures.rms_along_the_road(run, measure) for name, measure in names.items()}


def _settled_figures(findings: Findings) -> dict[str, Any]:
    keys = ("field/with", "field/without", "field/no_initial_error", "field/slip_compensated")
    return {
        f"{key.removeprefix('field/')}_m_rms": measures.rms_after(
            measures.SETTLING_S, findings.trials[key]
        )
        for key in keys
        if findings.has(key)
    }


def _shares(findings: Findings) -> dict[str, float]:
    keys = {
        "share_ratio": "field/with",
        "share_without_initial_error_ratio": "field/no_initial_error",
    }
    return {name: measures.share_farther_off(findings.trials[key]) for name, key in keys.items()}


def _nothing(_: Findings) -> Values:
    return Values([])


# ---- The table


NO_GROWTH = Expected("≤", TOLERANCE_M, "m")
GROWTH = Expected(">", TOLERANCE_M, "m")
STABLE = Expected("<", 0.0, "1/s")
LIMIT = Expected("<", 0.09, "m")
"""The paper's limit on tracking errors in the base case."""

TWO_EFFECTS = (
    "two effects: each path oscillates more than the path ahead where |F| > 1 (table on linear "
    "theory), and one curve is fitted to two paths centimetres apart. Fitting one trajectory for "
    "each source (run `blend`) removes the second"
)
OWN_ERRORS = (
    "every car adds its own error to half of its predecessor's, which tracking errors do not show"
)
FIT_DESCRIPTION = (
    "the fitted trajectory chooses the simplest of several shapes that explains the samples; the "
    "paper's recipe fits a line if all samples pass the test, else one circle"
)


# fmt: off
CLAIMS: tuple[Claim, ...] = (
    # Sections II and III: car, samples, trajectory, feedforward
    calculated("parameters", "II, Table I; III-D",
        "The table's car is understeering (K_sg > 0); m_v = W/g", calculations.table_i,
        Expected(">", 0.0, "s² rad/m")),
    calculated("steering_parameters", "II, eq. (4)",
        "ζ = 0.4056, ω_n = 21.4813 rad/s are similar to others' ζ = 0.7, ω_n ≈ 19 rad/s",
        calculations.other_steering, STABLE,
        "slowest root with the other steering, over all speeds and loadings. The paper's weaker "
        "damping causes a resonance"),
    calculated("feedforward", "III-D, eq. (6)",
        "δ_ff = (a + b)/R + K_sg V²/R keeps a car on a circle of radius R, without feedback",
        calculations.feedforward, Expected("≈", 0.0, "of eq. (3)", 1e-9),
        "θ̃ is not zero: with feedback the car settles at an offset. A loaded car needs more "
        "steering, which a controller without knowledge of the load cannot provide"),
    calculated("preview", "III-A", "L_preview = 0.8 v ≈ 30 m at highway speed",
        lambda: (PREVIEW_S * BASE_SPEED, {"speed_for_30_m_mps": 30.0 / PREVIEW_S}),
        Expected("≈", 30.0, "m", 3.0),
        "24 m is used here. 30 m change the results little (row on the preview below)", need="base",
        misprint=True),
    calculated("signs", "III-B",
        "e_lat = R − distance from the centre; on a line (Y − m X − c) / √(1 + m²)",
        calculations.printed_error_in_a_right_turn, Expected("≈", 1.0, "m", 0.01),
        "of a car 1 m to the left of its path in a right turn. y = m x + c does not exist for a "
        "road to the north. Correct with the sign of the turn and a line given by its heading",
        need="base", misprint=True),
    Claim("preview_samples", "III-A",
        "At 20 Hz the preview contains M, N < 20 samples, about a metre apart", _samples,
        Expected("<", 20, "samples"), ("base",),
        "1.5 m apart; fewer of the predecessor, which is only 15 m ahead"),
    Claim("one_change", "III-A", "There is at most one change of curvature within a second",
        _changes, Expected("≤", 1, "changes"), ("base",),
        "the road was chosen accordingly. A lane change of 3.6 m at 30 m/s needs arcs of less "
        "than a second on radii up to 400 m"),
    calculated("ten_centimetres", "III-A, III-B",
        "Samples within 10 cm of their chord are a straight line", calculations.hidden_curvature,
        Expected("≤", 1e-5, "1/m"),
        f"arcs of this curvature also pass the line test at 30 m/s: {FIT_DESCRIPTION}",
        need="base"),
    calculated("circle", "III-A.1, eq. (5)",
        "X_c, Y_c and R that minimise J come from three linear equations in X_c, Y_c, R² − X_c² − "
        "Y_c²; at α = 0.5 both sources have equal weight", calculations.circle,
        Expected("≈", 0.0, "of R", 1e-6),
        "solved relative to the samples, against a solution as printed. With 2 cm of noise the "
        "circle is too small: e is a distance times 2R, so J favours small circles", need="base"),
    Claim("recipe_suffices", "III-A, III-B",
        "Line test and circle suffice: radii are hundreds of metres, positions accurate to 2 cm",
        partial(_over, "radii", {at_radius(r): r for r in RADII}, measures.largest_tracking), LIMIT,
        tuple(map(at_radius, RADII)),
        f"judged by the paper's 9 cm on each road; {FIT_DESCRIPTION}"),
    Claim("two_samples", "III-B",
        "θ_R is the direction of the closest and the second closest point",
        lambda findings: Values([findings.samples.rule_error]), Expected("<", 0.05, "rad"),
        ("base",),
        "against the car's heading in the base case: samples of lead and predecessor are side by "
        "side. Here θ_R is the direction of the fit"),
    # Sections III-F and IV: polynomial, Proposition 1, G(jω)
    calculated("polynomial", "III-F", "The coefficients A_6 … A_0 of Δ(s, K)",
        calculations.polynomial_against_matrix, Expected("≈", 0.0, "of a root", 1e-6),
        "its roots are the eigenvalues of eqs. (3), (4) with feedback at all speeds and loadings; "
        "the polynomial of the preceding equation differs by a factor of ω_n²"),
    calculated("state_equation", "IV-A", "The matrix A(γ) of the closed loop",
        calculations.printed_matrix, Expected("≈", 1.0, "of eq. (3)'s slowest root", 0.01),
        "M⁻¹ is missing before L, C_0, B and F, and the term v̇ θ̃ for varying speed. With both, "
        "Proposition 1 holds (rows below)", misprint=True),
    calculated("proposition_1_square_integrable", "IV-A, Proposition 1, first case",
        "If the acceleration is square integrable, the loop is exponentially stable",
        calculations.mean_decay, Expected(">", 0.0, "1/s"),
        "with this c the energy of an error satisfies V(t) ≤ V(0) exp(k ∫|v̇| − c t) at every "
        "speed between, and ∫|v̇| ≤ √(t ∫v̇²) grows more slowly than c t. The paper omits the "
        "term v̇ θ̃"),
    calculated("proposition_1_in_the_mean", "IV-A, Proposition 1, cases (i) and (ii)",
        "There is a bound μ* for the mean of |v̇|, and also of v̇²", calculations.mean_acceleration,
        Expected(">", 0.0, "m/s²"),
        "c/k of the row above is valid for both, and conservative: a constant bound on |v̇| may "
        "be much larger (next row)"),
    calculated("proposition_1", "IV-A, Proposition 1, case (iii)",
        "Eigenvalues stay left of −σ at all speeds, so some bound μ* on |v̇| keeps it stable",
        calculations.certified_accelerations, Expected(">", 0.0, "m/s²"),
        "smallest certified |v̇|; the paper states no number and omits the term v̇ θ̃"),
    calculated("norm_of_g", "IV-B",
        "With the predecessor's data only, ‖G‖∞ > 1, at low frequencies", calculations.norm_of_g,
        Expected(">", 1.0), "without and, larger, with steering actuation", need="propagation"),
    calculated("equivalence", "IV-B", "sup σ_max(…) ≤ 1 is equivalent to ‖G‖∞ ≤ 1",
        calculations.singular_value, Expected("≈", 1.0, "of ‖G‖∞", 0.01),
        'the matrix has rank one, and |G| is its non-zero eigenvalue: "equivalent" should read '
        '"necessary", which suffices. N(0) also lacks the factor C_f, which changes no sign',
        need="propagation", misprint=True),
    # Sections V-A and V-B: sets of gains, loadings
    calculated("stabilising_set", "V-A, figure of the stabilising set",
        "The set at 30 m/s is bounded and not convex", calculations.stabilising_set,
        Expected(">", 0.0, "1/s"), "slowest root midway between two stabilising points"),
    calculated("inside_the_intersection", "V-A",
        "(0.06, 0.96, 0.08) lies inside the sets at 10, 20, … 60, 67 mph",
        calculations.slowest_root_over_speeds, STABLE),
    calculated("ball", "V-A", "The set contains a ball around the gains", calculations.ball,
        Expected(">", 0.0, "of all gains"),
        "at all speeds and loadings; at 30 m/s the ball is limited by k_e = 0"),
    calculated("first_condition", "V-A",
        "The ball implies Proposition 1's first condition: bounded A, eigenvalues on the left",
        calculations.bounded_matrix, Expected(">", 0.0, "1/s"),
        "true, but not implied by the ball: seven speeds do not cover those between. Here it is "
        "proven for the whole range"),
    calculated("inertia", "V-B", "I_update = I + m_p n_f a² + m_p n_r b² + m_l (n_f + n_r)(b + c)²",
        calculations.inertia, Expected("<", 0.05, "too large"),
        "the paper places passengers on the axles and keeps the centre of mass; compared with "
        "Steiner's theorem about the true centre"),
    calculated("not_affine", "V-B", "The coefficients of the polynomial are not affine in the mass",
        calculations.second_difference, Expected(">", 1e-6, "of a coefficient"),
        "second difference over 0, 1 and 2 rear passengers"),
    calculated("all_loadings", "V-B, figure of the roots",
        "With n_f ≤ 1, n_r ≤ 3 all roots stay in the left half-plane at 30 m/s",
        calculations.slowest_root_over_loadings, STABLE,
        "the paper keeps the centre of mass, which the load moves back"),
    calculated("open_loop_roots", "V-B, figure of the roots", "These are roots of Δ_o(s)",
        calculations.open_loop_root, STABLE,
        "Δ_o(s) = s² R(s) has a double root at the origin for every load. Δ(s, K) is meant: the "
        "figure can only show the roots of the closed loop", misprint=True),
    # Section V-C: simulations
    Claim("road", "V-C, target trajectory",
        "A double lane change on 1 km: first from 5 s to before 10 s, then from 20 s to 25 s",
        _nothing, None, ("base",),
        "the paper does not specify radius, lane width and gaps. Here 3.6 m to the right from 5 s "
        "and back from 20 s on, on arcs of 500 m radius and straights of one second each"),
    row("base_below_9_cm", "V-C.1, errors with n_f = 1, n_r = 3",
        "Four cars, 30 m/s: the largest lateral error is under 9 cm", measures.largest_tracking,
        ("base",), LIMIT, "depends on the road, see the table of runs for other radii"),
    row("base_where", "V-C.1", "The largest error occurs where the curved section begins or ends",
        measures.largest_lag, ("base",), Expected("<", 0.2, "s"),
        "with 0.8 s of preview a trajectory curves before the road does"),
    row("base_decreasing", "V-C.1; IV-B, Definition 1",
        "The largest errors decrease from the first follower on", measures.tracking_growth,
        ("base",), NO_GROWTH, TWO_EFFECTS),
    row("base_true", "V-C.1; IV-B (no car will be off-track)",
        "Lateral string stability: no car is farther off the track than the car ahead",
        measures.true_growth, ("base",), NO_GROWTH, f"{OWN_ERRORS} (row on bounded errors below)"),
    row("amplified_without_lead_data", "I, IV-B, in simulation",
        "With the predecessor's data only, cross-track errors amplify",
        lambda run: run.cross_track[-1] - run.cross_track[0], ("no_lead_data",), GROWTH,
        "as predicted by linear theory"),
    row("reduced_by_lead_data", "I, V-C, in simulation",
        "The lead's data reduce the propagation of cross-track errors", measures.step_against,
        ("long/with", "long/without"), Expected("<", 1.0),
        "of eight cars the last adds less than a tenth of its error without the data, and is "
        "closer to the lead's path"),
    decreasing("a", "V-C.2, scenario A", " (10 m/s, n_r = 2)"),
    decreasing("b", "V-C.2, scenario B", " (10 m/s, n_r = 0)"),
    decreasing("c", "V-C.2, scenario C", " (20 m/s, n_r = 0)"),
    decreasing("d", "V-C.2, scenario D", " (30 m/s, two heavier cars, two lighter)"),
    row("uneven", "V-C.2, scenario D", "An uneven convoy does not impact lateral string stability",
        measures.more_than(measures.head_to_tail), ("base", "d"), Expected("≤", 0.0),
        "growth of true errors along the convoy, less that of the uniform convoy"),
    row("faster", "V-C.2, A against C", "Errors are larger at 20 m/s than at 10 m/s",
        measures.more_than(measures.largest_tracking), ("a", "c"), Expected(">", 0.0, "m"),
        "in a curve a car has a slip angle, against which the law steers, more at 10 m/s. The "
        "paper's recipe fits a line to a curve, whose deviation grows with the preview. Runs "
        "`same_times` drive curves with the same lateral acceleration"),
    row("mass", "V-C.2, A against B", "The effect of the mass is negligible",
        measures.relative_difference, ("a", "b"), Expected("<", 1.0),
        "difference over a tenth of the error. At 30 m/s the load, unknown to the feedforward, "
        "has a larger effect"),
    row("small", "V-C.2", "Errors remain minimal compared to the lane width", measures.largest_true,
        SIMULATIONS, Expected("<", 0.1 * LANE, "m")),
    row("variable_below_11_cm", "V-C.3", "With acceleration up to 30 m/s no error exceeds 11 cm",
        measures.largest_tracking, ("variable_speed",), Expected("<", 0.11, "m")),
    Claim("slightly_more", "V-C.3", "Errors are slightly larger than at constant speed",
        of_runs(measures.more_than(measures.largest_tracking), "base", "variable_speed"), None,
        ("base", "variable_speed"),
        "depends on the speed profile, which the paper only plots: on the same curves, a lower "
        "speed needs less lateral acceleration and a higher speed more"),
    decreasing("variable_speed", "V-C.3",
        note="all cars have the same speed at the same time, so each enters a curve faster than "
        "its predecessor did. The composite also has an effect, as in the base case"),
    # Section IV-B: string stability of the simulated convoys
    row("definition_1", "IV-B, Definition 1, with heading",
        "‖(e_lat, θ̃)‖∞ of a follower does not exceed that of its predecessor",
        measures.definition_1_growth, ("base",), NO_GROWTH,
        "the norm combines metres and radians: in these units the heading is never decisive. "
        "Judged by tracking errors, as the figures of V-C; in Section IV-B e_lat is the distance "
        "from the common line, for which the row on true errors stands"),
    row("bounded_along_the_convoy", "IV-B; weaker senses, eight cars",
        "With the lead's data, errors are bounded for any number of cars",
        measures.excess_of_last_step, ("long/with",), Expected("≤", 0.0, "m"),
        "step of the last car beyond half the second follower's. If it levels off, the convoy is "
        "string stable in the sense of Swaroop and Hedrick (1996, largest errors) and of Ploeg et "
        "al. (2014, L2), though Definition 1, the strict form from car to car, fails. Linear "
        "theory: contributions converge with α‖F‖∞ < 1; with empty cars they need not, but the "
        "fit smooths that wavelength of 9 m", figures=_bounded_figures),
    row("others_true", "V-C.2, V-C.3; IV-B (no car will be off-track)",
        "Also in A to D and at variable speed, no car is farther off the track than the car ahead",
        measures.true_growth, SIMULATIONS[1:], NO_GROWTH, OWN_ERRORS),
    row("amplified_in_l2", "IV-B, in L2 (whose induced norm is ‖G‖∞), at equal arc length",
        "With the predecessor's data only, errors amplify from car to car", measures.rms_growth,
        ("no_lead_data",), GROWTH, "rms of true errors over the same section of the lead's path",
        figures=partial(_rms_figures, "no_lead_data")),
    row("not_amplified_in_l2", "V-C.1, in L2, at equal arc length",
        "With the lead's data, errors do not amplify from car to car", measures.rms_growth,
        ("base",), NO_GROWTH, "rms of true errors over the same section of the lead's path",
        figures=partial(_rms_figures, "base")),
    Claim("propagation_measured", "IV-B, in the emulated convoy",
        "Errors amplify at low frequencies with the predecessor's data only", _measured_propagation,
        Expected(">", 1.0), ("propagation",),
        "amplitude over the car ahead's, up to 2.5 rad/s. In G a car steers by the difference of "
        "both cars' states at one instant; here it follows its predecessor's path with "
        "feedforward (F), and the fit smooths wavelengths shorter than the preview"),
    # Section V-D: field experiment
    Claim("field_course", "V-D, reference path and errors",
        "Plots of the path and of the lateral errors", _nothing, None, ("field/with",),
        "the text states neither the course, nor the initial errors, nor any number. Here an oval "
        "with curves of 200 m and a double lane change"),
    row("field_amplified", "V-D.1, without lead data", "Cross-track errors amplify from PL2 to PL3",
        measures.settled_growth, ("field/without",), GROWTH, "rms of true errors after 10 s",
        figures=_settled_figures),
    row("field_not_amplified", "V-D.2, with lead data",
        "Cross-track errors of the followers do not amplify", measures.settled_growth,
        ("field/with",), NO_GROWTH,
        "rms of true errors after 10 s. Two followers do not show whether errors level off",
        figures=_settled_figures),
    row("field_initial_error", "V-D.2, with lead data",
        "Where they appear to amplify, the initial error of the second car is the cause",
        measures.excess_of_share, ("field/with", "field/no_initial_error"), Expected("<", 0.0),
        "share of the road on which PL3 is farther off than PL2: the cause would remove at least "
        "half. PL2's error decays within seconds; PL3 adds its own error to half of PL2's",
        figures=_shares),
    row("field_on_the_road", "V-D.2", "All followers stay on the road throughout",
        measures.largest_true, ("field/with",), Expected("<", measures.LANE_MARGIN, "m"),
        "including the start; a lane has this width on each side of a car"),
    # Not in the paper: other laws, weight, noise, preview, loss and latency
    *(
        row(
            f"against_{law}",
            "not in the paper",
            f"The paper's law has no larger tracking errors than {words}",
            measures.more_than(measures.largest_tracking),
            (f"base/{law}", "base"),
            NO_GROWTH,
        )
        for law, words in zip(
            OTHER_LAWS,
            (
                "Stanley's law (Hoffmann et al., 2007)",
                "pure pursuit (Coulter, 1992; Snider, 2009)",
            ),
            strict=True,
        )
    ),
    Claim("alpha_chain", "III-A.1, V-C; not in the paper: α varied, eight cars",
        "With any weight of the lead (α < 1), true errors level off along the convoy", _alphas,
        Expected("≤", 0.0, "m"), ("base", *map(at_alpha, ALPHAS)),
        "each car passes on the share α of its error. Theory ensures this at every frequency "
        "below α* = 1/‖F‖∞; the fit smooths the steering's mode, where empty cars exceed it. "
        "`convoy check` prints α* of the paper's G"),
    Claim("noise_along_the_convoy",
        "III-A (positions accurate to 2 cm); not in the paper: eight cars on a straight",
        "With the lead's data, receiver noise does not grow along the convoy", _noise,
        Expected("≤", 1.1), ("noise_along/with/noise/1", "noise_along/without/noise/1"),
        "rms of the last of eight cars over that of the third; up to 10 % more is chance"),
    Claim("preview_suffices", "III-A; limited preview varied, base case",
        "A preview of 0.8 s suffices", _previews, LIMIT, tuple(map(at_preview, PREVIEWS_S)),
        "judged by the paper's 9 cm; 1 s are the 30 m of Section III-A. A longer preview adds "
        "samples of the lead only, since the predecessor is 15 m ahead"),
    *(
        Claim(f"{name}_varied", f"Abstract, I (reliable connectivity); {name} varied, base case",
            f"At the lead's speed, errors stay under 9 cm if links {verb}",
            partial(_over, "values", {f"{name}/{v:g}": v for v in values},
                measures.tracking_at_speed),
            LIMIT, ("base", *(f"{name}/{value:g}" for value in values)),
            "the paper assumes reliable connectivity; all other runs have 20 ms and no loss. A car "
            "that knows too little of the path slows down, which does not count as holding")
        for name, values, verb in (
            ("loss", LOSSES_PERCENT, "lose 30 to 60 % of messages"),
            ("latency", LATENCIES_MS, "delay messages by 100 to 400 ms"),
        )
    ),
)
# fmt: on

"""All claims in the order of the paper, followed by additional ones."""
