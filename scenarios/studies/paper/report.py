"""Writes report.md, report.json and the plots of `convoy reproduce`."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from scenarios.results.drives import Trial
from scenarios.results.figure_style import STYLE
from scenarios.studies.job import write_files
from scenarios.studies.paper import (
    base_case,
    field_experiment,
    gains,
    information,
    model,
    other_cases,
    other_laws,
    string_stability,
    theory,
    trajectory,
)
from scenarios.studies.paper.claim import (
    Answer,
    ClaimVerdict,
    JudgedClaim,
    counts_text,
    groups,
    judge,
)
from scenarios.studies.paper.experiment_plots import BOTH, PICTURES
from scenarios.studies.paper.experiments import (
    BASE,
    FIELD_WITH,
    FIELD_WITHOUT,
    NO_LEAD_DATA,
    RADII,
    RUNS_OF_CASE,
    TRAJECTORIES,
    TRAJECTORY_NAMES,
    A,
    B,
    C,
    Part,
    at_radius,
    lane_change_lengths,
)
from scenarios.studies.paper.field_experiment import numbers_of, settled_errors
from scenarios.studies.paper.findings import (
    TOLERANCE_M,
    Findings,
    in_cm,
    non_increasing,
    predict_case,
)
from vehicles.preview.curve_fit import Trajectory

# ---- Tables of the report on the paper's experiments, as lines of Markdown


EXPECTED = (BASE, NO_LEAD_DATA, A, B, C)
"""Cases of equal cars at constant speed."""

CHANGED = {
    BASE.with_variant("as_is"): "none (base case)",
    BASE.with_variant("blend"): "one trajectory for each source, commands blended",
    BASE.with_variant("lead_only"): "lead's data only (α = 0)",
    BASE.with_variant("slip_compensated"): "slip compensated in curves (the default law)",
    BASE.with_variant("knows_loading"): "controller knows the load",
    BASE.with_variant("slip_compensated_knows_loading"): "slip compensated, load known",
    BASE.with_variant("own_state_estimated"): "own state estimated from exact measurements",
    BASE.with_variant("paper_prefix"): "the paper's recipe, longest straight prefix first",
    BASE.with_variant("stanley"): "Stanley's law (both lane changes)",
    BASE.with_variant("pure_pursuit"): "pure pursuit (both lane changes)",
    BASE.with_variant("gap_20_m"): "gap of 20 m, so the predecessor is beyond the preview",
}
"""Variants of the base case, by what is changed."""


def tables(findings: Findings) -> Iterator[str]:
    name = TRAJECTORY_NAMES[findings.trajectory]
    rows = [(text, findings.trials[key]) for key, text in CHANGED.items() if findings.has(key)]
    if rows:
        title = f"Variants of the base case ({name}; first lane change)"
        yield from _table(title, "change", rows)
    if any(map(findings.has, EXPECTED)):
        yield from _expected(findings)
    if findings.has(at_radius(RADII[0])):
        yield from _radii(findings)


def _radii(findings: Findings) -> Iterator[str]:
    rows = [
        (f"{r:g} m, {word} ({_road(r)})", findings.trials[key])
        for r in RADII
        for key, word in (
            (at_radius(r), "with lead data"),
            (at_radius(r).with_variant("no_lead_data"), "without lead data"),
        )
    ]
    name = TRAJECTORY_NAMES[findings.trajectory]
    title = f"Radius of the curves, with and without the lead's data ({name})"
    yield from _table(title, "radius", rows)
    decreasing = sum(non_increasing(trial.tracking) for _, trial in rows[::2])
    better = sum(
        a.cross_track[-1] < b.cross_track[-1]
        for (_, a), (_, b) in zip(rows[::2], rows[1::2], strict=True)
    )
    yield ""
    yield (
        f"With the lead's data, the largest tracking errors decrease along the convoy on "
        f"{decreasing} of {len(RADII)} roads. The true error of the last car is smaller than "
        f"without them on {better}."
    )


def _road(radius: float) -> str:
    arc, straight = lane_change_lengths(radius)
    return f"arcs of {arc:.0f} m, {straight:.0f} m between"


def _table(title: str, heading: str, rows: Sequence[tuple[str, Trial]]) -> Iterator[str]:
    yield from ("", f"## {title}", "")
    yield f"| {heading} | tracking errors | decreasing | true errors |"
    yield "|---|---|---|---|"
    for text, trial in rows:
        word = "yes" if non_increasing(trial.tracking) else "no"
        yield f"| {text} | {in_cm(trial.tracking)} | {word} | {in_cm(trial.cross_track)} |"


def _expected(findings: Findings) -> Iterator[str]:
    yield from (
        "",
        f"## Comparison with linear theory ({TRAJECTORY_NAMES[findings.trajectory]})",
        "",
        "Linear theory applies F(jω) to the path of the lead, car by car. It neglects sampling, "
        "fit and links.",
        "",
        "| case | tracking: theory | simulated | true error: theory | simulated |",
        "|---|---|---|---|---|",
    )
    for key in EXPECTED:
        if findings.has(key):
            own, true = predict_case(findings, key)
            trial = findings.trials[key]
            cells = (own, trial.tracking, true, trial.cross_track)
            yield (f"| {key.label} | " + " | ".join(map(in_cm, cells)) + " |")


# ---- report.json, the machine-readable results of `convoy reproduce`


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


# ---- Report


CLAIMS = (
    *model.CLAIMS,
    *trajectory.CLAIMS,
    *theory.CLAIMS,
    *gains.CLAIMS,
    *base_case.CLAIMS,
    *other_cases.CLAIMS,
    *string_stability.CLAIMS,
    *field_experiment.CLAIMS,
    *other_laws.CLAIMS,
    *information.CLAIMS,
)
"""All claims in the order of the paper, followed by additional ones."""

CAPTIONS = {
    "road": "The road of the main cases, which the paper does not specify.",
    "errors_base": "Tracking errors in the base case.",
    "errors_a_to_d": "Tracking errors in scenarios A to D.",
    "errors_variable_speed": "Tracking errors while the speed changes in both lane changes.",
    "maxima": "Largest errors: exact (bars), on shifted roads (dashes), and with receiver noise "
    "(dots). Noisy runs of some cases cover the first lane change only.",
    "lead_data": "With the predecessor's data only, true errors grow from car to car, which "
    "tracking errors hardly show. With the lead's data, true errors level off.",
    "along_the_convoy": "Eight cars: true errors for several weights α, simulated and (dotted) by "
    "linear theory, which neglects the fit; and noise of receivers on a straight.",
    "radius": "Largest errors over the radius of the curves, first lane change.",
    "propagation": "The paper's G(jω), in closed form and simulated, and measured ratios of the "
    "convoy. In G a car steers by the difference of both cars' states at the same instant, with "
    "heading and without feedforward. In the convoy a car steers along its predecessor's path, as "
    "in F(jω), which the measured ratios follow at low frequencies. At high frequencies the fit "
    "over about 35 m smooths the path (at 7 rad/s a wavelength is 27 m); a shorter preview smooths "
    "less.",
    "field": "Field experiment: PL1 drives alone, PL2 follows the record of PL1, PL3 follows both.",
    "paper_recipe": "Conditions of the paper's recipe. Left: radius of the curves; hollow marks "
    "are the worst noisy runs. Right: the base case, exact, with noise (worst seed), and with the "
    "longest straight prefix of Section III-A fitted separately.",
}


def write_report(
    findings: AllFindings, cases: Sequence[str], out: Path, picture_format: str = "png"
) -> list[JudgedClaim]:
    """Judge the claims on `cases` and write report and plots into `out`; returns the claims."""
    claims = judge(CLAIMS, findings)
    pictures = _draw(findings, out, picture_format)
    text = "\n".join(_markdown(findings, cases, claims, pictures)) + "\n"
    report = machine_readable(findings, cases, claims, pictures)
    whole = json.dumps(report, indent=2) + "\n"
    write_files(out, {"report.md": text, "report.json": whole})
    return claims


def all_pictures(picture_format: str = "png") -> list[str]:
    names = [*BOTH, *(_file(name, kind) for name in PICTURES for kind in TRAJECTORIES)]
    return [f"{name}.{picture_format}" for name in names]


def _file(name: str, kind: Trajectory) -> str:
    return f"{name}_{kind}"


def _draw(findings: AllFindings, out: Path, picture_format: str) -> dict[str, list[str]]:
    """Draw every plot for which there are results; returns the file names of each."""
    drawn: dict[str, list[str]] = {}
    figures: dict[str, Figure] = {}
    with mpl.rc_context(STYLE):
        for name, (needs, draw_both) in BOTH.items():
            if all(results.has(need) for results in findings.values() for need in needs):
                figures[file := f"{name}.{picture_format}"] = draw_both(findings)
                drawn[name] = [file]
        for name, (needs, draw) in PICTURES.items():
            for kind, results in findings.items():
                if all(map(results.has, needs)):
                    figures[file := f"{_file(name, kind)}.{picture_format}"] = draw(results)
                    drawn.setdefault(name, []).append(file)
    write_files(out, figures)
    return drawn


def _markdown(
    findings: AllFindings,
    cases: Sequence[str],
    claims: Sequence[JudgedClaim],
    pictures: Mapping[str, Sequence[str]],
) -> Iterator[str]:
    yield "# The paper's claims, tested"
    yield ""
    yield f"Cases: {', '.join(cases)}. Claims judged with each of two trajectories: {len(claims)}."
    yield ""
    for kind in findings:
        yield f"- {TRAJECTORY_NAMES[kind]}: {counts_text(claims, kind)}"
    yield ""
    yield from _differing(claims)
    yield from _recipe(findings)
    calculated = [row for row in claims if not row.claim.simulated]
    simulated = [row for row in claims if row.claim.simulated]
    yield from _summary(calculated, "fitted", "calculated, the same for both")
    for kind in findings:
        yield from _summary(simulated, kind, TRAJECTORY_NAMES[kind])
    yield from _method()
    yield from _claims(claims)
    for name, files in pictures.items():
        yield from ("", f"### {CAPTIONS[name]}")
        for file in files:
            yield from ("", f"![{file}]({file})")
    for results in findings.values():
        yield from tables(results)
    yield from _gains(findings)
    yield from _logs(findings, cases)


def _differing(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    differing = [claim for claim in claims if claim.differs]
    yield "## Claims that depend on the trajectory"
    yield ""
    if not differing:
        yield "None."
    else:
        yield _line("section", "claim", *(TRAJECTORY_NAMES[kind] for kind in TRAJECTORIES))
        yield "|---|---|---|---|"
    for claim in differing:
        verdicts = (claim.verdicts[kind].judgement for kind in TRAJECTORIES)
        yield _line(claim.claim.where, claim.claim.paper, *verdicts)
    yield ""


def _recipe(findings: AllFindings) -> Iterator[str]:
    paper = findings["paper"]
    prefix = BASE.with_variant("paper_prefix")
    if not all(map(paper.has, (BASE, prefix, A, C, at_radius(300.0)))):
        return
    tracking = {key: paper.trials[key].tracking for key in (A, C, BASE, prefix)}
    noisy = max(paper.noisy(BASE), key=lambda run: max(run.tracking)).tracking
    yield from (
        "## Conditions of the paper's trajectory",
        "",
        "With exact samples, a known own state and curves of 500 m, the paper's recipe agrees with "
        f"the paper. Largest tracking errors: A {in_cm(tracking[A])}, C {in_cm(tracking[C])}, base "
        f"case {in_cm(tracking[BASE])}. Each condition is necessary. The base case has "
        f"{in_cm(noisy)} with 2 cm of noise (worst seed), "
        f"{in_cm(paper.trials[at_radius(300.0)].tracking)} on exact curves of 300 m, "
        f"{in_cm(paper.trials[at_radius(200.0)].tracking)} on curves of 200 m, and "
        f"{in_cm(tracking[prefix])} with the longest straight prefix of Section III-A fitted "
        "separately (plot paper_recipe).",
        "",
    )


GROUPS = {
    "does not hold": "Do not hold",
    "misprint, harmless": "Misprints without consequence",
    "undecided": "Undecided: hold in some of the exact runs only",
    "fails in noise": "Hold in exact runs, but not in every noisy run",
    "holds in noise": "Do not hold in exact runs, but in some noisy runs",
}


NOT_ALWAYS = ("undecided", "fails in noise", "holds in noise")
"""Groups of claims that hold in some runs."""


def _summary(claims: Sequence[JudgedClaim], kind: Trajectory, title: str) -> Iterator[str]:
    """List the claims that do not hold in all runs, by group."""
    grouped = {group: members for group, members in groups(claims, kind).items() if members}
    if grouped:
        yield from (f"## Summary: {title}", "")
    for group, members in grouped.items():
        yield from (f"{GROUPS[group]}:", "")
        for claim in members:
            answer = claim.verdicts[kind].answer
            text = _runs(answer) if group in NOT_ALWAYS else ""
            runs = f": {text}" if text else ""
            yield f"- {claim.claim.paper} ({claim.claim.where}){runs}"
        yield ""


def _runs(answer: Answer) -> str:
    return ", ".join(
        f"{t.holding} of {t.runs} {t.kind}" for t in (answer.phases, answer.noise) if t
    )


def _method() -> Iterator[str]:
    yield from (
        "## Method",
        "",
        "- Errors. The *tracking error* is a car's distance from the trajectory it has fitted; "
        "this is the error in the figures of V-C. The *true error* is the distance from the path "
        "that the lead has driven; this is e_lat in Section IV-B, and decides whether a car is "
        "off the track. Lists contain the largest error of each follower, front to back. "
        f"Differences below {1000 * TOLERANCE_M:.0f} mm are ignored.",
        "- Convoy. Four of the paper's cars, 15 m from centre to centre (0.5 s at 30 m/s), with "
        "the paper's law and gains. Controllers do not know the load. Poses are sent at 20 Hz "
        "over links with 20 ms latency; control runs at 50 Hz.",
        "- Road. The paper does not specify its road. Here each car moves 3.6 m to the right from "
        "5 s on and back from 20 s on, on arcs of 500 m radius and straights of one second each. "
        "This agrees with the paper: at most one change of curvature per second, radii of hundreds "
        "of metres, lane changes complete before 10 s and 25 s. At 10 and 20 m/s the convoy drives "
        "the same road, and another road that takes the same times.",
        "- Trajectories. Every run is simulated twice: with the default fitted trajectory, and "
        "with the paper's recipe taken literally from Section III-B. The recipe uses all samples "
        "of both sources within the preview. It fits a line if no sample is 10 cm from it, else "
        "the circle of eq. (5), and takes its heading. Calculated claims are judged once.",
        "- Exact and noisy runs. Main runs have exact measurements and cars that know their own "
        "state, presumably as in the paper. Noisy runs use several seeds of 2 cm, 0.1°, 0.03 m/s "
        "and 0.1°/s, and estimate the own state. They end after the first lane change in A to D "
        "and at variable speed, and in the first curve in the field experiment.",
        "- Shifted roads. A fit depends on where samples lie in a curve. Exact runs are therefore "
        "repeated with the road shifted by a quarter, half and three quarters of 0.1 s, the common "
        "period of poses and control. In A to C, without the lead's data and with other laws, "
        "these runs end after the first lane change, which the second one mirrors.",
        "- Verdicts. A claim about runs holds if it holds in all its exact runs: the four phases "
        "of the road, or the simulated radii or frequencies. It does not hold if it holds in none "
        "of them, and is undecided otherwise. Counts of noisy runs are given for information. A "
        "misprint is a formula or figure that is wrong as printed; no other claim depends on it.",
        "- Field experiment. All claims on amplification are judged by the rms of the true errors "
        "after the first 10 s, or by true errors at equal arc length.",
        "- Other laws. Where slip compensation, Stanley's law or pure pursuit has smaller errors "
        'than the paper\'s law in the same case, the row states them after "Better".',
        "",
    )


def _line(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _claims(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    names = [TRAJECTORY_NAMES[kind] for kind in TRAJECTORIES]
    yield "## Claims"
    yield ""
    yield _line("section", "claim", *(c for n in names for c in (n, "verdict")), "explanation")
    yield "|---|---|---|---|---|---|---|"
    for row in claims:
        first, second = (row.verdicts[kind] for kind in TRAJECTORIES)
        same = second.answer.ours == first.answer.ours
        again = "same result" if row.claim.simulated else "(calculated)"
        yield _line(
            row.claim.where,
            row.claim.paper,
            first.answer.ours,
            _verdict_cell(first),
            again if same else second.answer.ours,
            _verdict_cell(second),
            _reasons(first, second),
        )
    yield ""
    yield "## Plots"


def _verdict_cell(verdict: ClaimVerdict) -> str:
    bold = verdict.judgement in {"undecided", "misprint, harmless", "does not hold"}
    text = f"**{verdict.judgement}**" if bold else str(verdict.judgement)
    runs = _runs(verdict.answer)
    return f"{text} ({runs})" if runs else text


def _reasons(first: ClaimVerdict, second: ClaimVerdict) -> str:
    reason, other = first.answer.reason, second.answer.reason
    if reason == other:
        return reason
    reasons = zip(TRAJECTORIES, (reason, other), strict=True)
    return ". ".join(
        f"{TRAJECTORY_NAMES[kind].capitalize()}: {text}" for kind, text in reasons if text
    )


def _gains(findings: AllFindings) -> Iterator[str]:
    pictures = next(iter(findings.values())).gains_pictures
    if pictures:
        yield from ("", "## Gains and roots", "", "Numbers: [gains.json](gains/gains.json).")
        for name in pictures:
            yield from ("", f"![{name}](gains/{name})")


def _logs(findings: AllFindings, cases: Sequence[str]) -> Iterator[str]:
    paths = logs(findings, cases)
    if paths:
        yield from ("", "## Logs", "", "Open a log with `convoy review LOG`.", "")
        yield from (f"- {log}" for log in paths)
