"""Writes report.md, report.json and the pictures of `convoy reproduce`."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.studies.engine.results import write_files
from scenarios.studies.paper.claims import (
    base_case,
    field_experiment,
    gains,
    model,
    other_cases,
    other_laws,
    string_stability,
    theory,
    trajectory,
)
from scenarios.studies.paper.claims.claim import (
    JUDGEMENTS,
    Answer,
    ClaimVerdict,
    JudgedClaim,
    groups,
    judge,
)
from scenarios.studies.paper.findings import TOLERANCE_M, in_cm
from scenarios.studies.paper.keys import (
    BASE,
    TRAJECTORIES,
    TRAJECTORY_NAMES,
    A,
    C,
    at_radius,
)
from scenarios.studies.paper.report.experiment_plots import BOTH, PICTURES
from scenarios.studies.paper.report.machine_readable import AllFindings, logs, machine_readable
from scenarios.studies.paper.report.tables import tables
from scenarios.studies.picture_style import STYLE
from vehicles.preview.curve_fit import Trajectory

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
)
"""All claims in the order of the paper, those beyond it last."""

CAPTIONS = {
    "road": "The road of the main cases, which the paper does not give.",
    "errors_base": "Lateral errors against the own trajectory, base case.",
    "errors_a_to_d": "Scenarios A to D.",
    "errors_variable_speed": "Lateral errors while the speed changes in both lane changes.",
    "maxima": "Largest errors, exact (bars), with the road moved by less than lies between "
    "samples (dashes) and with a receiver's noise (dots; where it is shorter, of the first lane "
    "change).",
    "lead_data": "With the predecessor's data only, true errors grow from car to car, while "
    "those against the own trajectory hardly show it; with the lead's data they level off.",
    "radius": "Errors against the radius of the bends, first lane change.",
    "propagation": "The paper's G(jω) in closed form and simulated, and what a swing of the "
    "lead becomes in the convoy. G takes the difference of both cars' states at one instant, "
    "heading included and without feedforward. In the convoy a car steers along the path that the "
    "other left: F(jω), which the measured ratios follow at low frequency. Above, the fit over "
    "some 35 m smooths the path away (a swing of 7 rad/s is 27 m long), less so with less preview.",
    "field": "Field experiment: PL1 drives alone, PL2 behind its record, PL3 behind both.",
    "paper_recipe": "What the paper's recipe needs. Left: radius of the bends; hollow marks "
    "are the worst of the noisy runs. Right: the base case, exact, with noise (worst seed), "
    "and with the longest straight prefix of Section III-A split off.",
}


def write_report(
    findings: AllFindings, cases: Sequence[str], out: Path, picture_format: str = "png"
) -> list[JudgedClaim]:
    """Judge the findings on `cases`, write report and plots into `out`; returns the claims."""
    claims = judge(CLAIMS, findings)
    pictures = _draw(findings, out, picture_format)
    text = "\n".join(_markdown(findings, cases, claims, pictures)) + "\n"
    (out / "report.md").write_text(text, encoding="utf-8")
    report = machine_readable(findings, cases, claims, pictures)
    (out / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return claims


def all_pictures(picture_format: str = "png") -> list[str]:
    """Names of the files of all plots."""
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
    yield f"Cases: {', '.join(cases)}. {len(claims)} claims, judged along two trajectories."
    yield ""
    for kind in findings:
        yield f"- {_counts(claims, kind)}"
    yield ""
    yield from _differing(claims)
    yield from _recipe(findings)
    calculated = [one for one in claims if not one.claim.simulated]
    simulated = [one for one in claims if one.claim.simulated]
    yield from _in_short(calculated, "fitted", "calculated, the same for both")
    for kind in findings:
        yield from _in_short(simulated, kind, TRAJECTORY_NAMES[kind])
    yield from _method()
    yield from _claims(claims)
    for name, files in pictures.items():
        yield from ("", f"### {CAPTIONS[name]}")
        for file in files:
            yield from ("", f"![{file}]({file})")
    for one in findings.values():
        yield from tables(one)
    yield from _gains(findings)
    yield from _logs(findings, cases)


def _counts(claims: Sequence[JudgedClaim], kind: Trajectory) -> str:
    judgements = [claim.verdicts[kind].judgement for claim in claims]
    hold, open_, fail, rest = (judgements.count(j) for j in JUDGEMENTS)
    return (
        f"{TRAJECTORY_NAMES[kind]}: {hold} hold, {open_} are undecided, {fail} do not hold, {rest} "
        "cannot be checked"
    )


def _differing(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    """List the claims whose verdict depends on the trajectory."""
    differing = [claim for claim in claims if claim.differs]
    yield "## Where the trajectory decides"
    yield ""
    if not differing:
        yield "Nowhere among these claims."
    else:
        yield (
            "| paper | says | " + " | ".join(TRAJECTORY_NAMES[kind] for kind in TRAJECTORIES) + " |"
        )
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
        "## What the paper's trajectory needs",
        "",
        f"With exact samples and own state, on the report's road (500 m), the paper's recipe gives "
        f"what the paper says: A {in_cm(tracking[A])}, C {in_cm(tracking[C])}, base case "
        f"{in_cm(tracking[BASE])}. It needs all of that. With 2 cm of noise the base case comes to "
        f"{in_cm(noisy)}; on bends of 300 m, exact, to "
        f"{in_cm(paper.trials[at_radius(300.0)].tracking)}, of 200 m to "
        f"{in_cm(paper.trials[at_radius(200.0)].tracking)}; and with the longest straight prefix "
        f"of Section III-A split off to {in_cm(tracking[prefix])}: see paper_recipe below.",
        "",
    )


GROUPS = {
    "does not hold": "Do not hold",
    "undecided": "Undecided: hold in some of the exact runs only",
    "noise spoils": "Hold with exact measurements, but with noise not in every run",
    "noise helps": "Do not hold with exact measurements, but in some runs with noise",
}


def _in_short(claims: Sequence[JudgedClaim], kind: Trajectory, title: str) -> Iterator[str]:
    """List the claims that do not simply hold, by group."""
    yield from (f"## In short: {title}", "")
    for group, members in groups(claims, kind).items():
        if members:
            yield f"{GROUPS[group]}:"
            yield ""
            for claim in members:
                answer = claim.verdicts[kind].answer
                runs = "" if group == "does not hold" else f": {_runs(answer)}"
                yield f"- {claim.claim.paper} ({claim.claim.where}){runs}"
            yield ""


def _runs(answer: Answer) -> str:
    return ", ".join(
        f"{t.holding} of {t.runs} {t.kind}" for t in (answer.phases, answer.noise) if t
    )


def _method() -> Iterator[str]:
    yield from (
        "## How it was done",
        "",
        "- Four cars, 15 m from centre to centre (half a second at 30 m/s), with the paper's car, "
        "law and gains; loads unknown to the controllers; poses at 20 Hz over links of 20 ms; "
        "decisions at 50 Hz.",
        "- The paper does not give its road. Here a car moves 3.6 m to the right from 5 s on and "
        "back from 20 s on, on arcs of 500 m and straights in turn, a second each: what the paper "
        "says of curvature (at most one change a second, hundreds of metres) and of time (done "
        "before 10 s and 25 s). At 10 and 20 m/s the same road is driven, and beside it one that "
        "takes the same times. What depends on the radius is said.",
        "- Everything is driven twice: along the product's fitted trajectory, and along the "
        "paper's own, by the letter of Section III-B (all samples of both sources ahead within the "
        "preview; a line where none is 10 cm from it, else the circle of eq. (5)), with the "
        "heading of that line or circle. What is calculated, not driven, is judged once.",
        "- Main runs are exact, as the paper's presumably are: measurements without noise, and "
        "cars that know their own state. Noise: 2 cm, 0.1°, 0.03 m/s, 0.1°/s, own state estimated "
        "from that, over several seeds; A to D and variable speed up to the end of the first lane "
        "change, the field experiment's repetitions up to the end of the first bend.",
        "- What a fit makes of a bend depends on where the samples fall on it. Exact runs are "
        "repeated with the road moved by a quarter, half and three quarters of 0.1 s, after which "
        "the pattern of poses and decisions repeats; A to C, runs without the lead's data and runs "
        "by other laws through the first lane change, of which the second is the mirror image. One "
        "rule for all: a claim on runs holds if it does in all its exact runs (these four phases, "
        "or the radii or frequencies tried), does not if in none, and is undecided in between. "
        "What noise changes is said beside it and decides nothing.",
        "- The paper measures errors against the trajectory that a car itself has fitted. That is "
        "given first, largest values of the followers front to back; true errors are distances "
        "from the lead's driven path. Values that differ by less than "
        f"{1000 * TOLERANCE_M:.0f} mm count as equal.",
        "",
    )


def _line(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _claims(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    names = [TRAJECTORY_NAMES[kind] for kind in TRAJECTORIES]
    yield "## Claims"
    yield ""
    yield _line("paper", "says", *(c for n in names for c in (n, "verdict")), "why, or how far")
    yield "|---|---|---|---|---|---|---|"
    for row in claims:
        first, second = (row.verdicts[kind] for kind in TRAJECTORIES)
        same = second.answer.ours == first.answer.ours
        again = "the same" if row.claim.simulated else "(calculated)"
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
    yield "## Pictures"


def _verdict_cell(verdict: ClaimVerdict) -> str:
    """The judgement, and the count of runs in which the claim holds."""
    bold = verdict.judgement in {"undecided", "does not hold"}
    text = f"**{verdict.judgement}**" if bold else str(verdict.judgement)
    runs = _runs(verdict.answer)
    return f"{text} ({runs})" if runs else text


def _reasons(first: ClaimVerdict, second: ClaimVerdict) -> str:
    reason, other = first.answer.reason, second.answer.reason
    if reason == other:
        return reason
    both = (
        (TRAJECTORY_NAMES[kind], why)
        for kind, why in zip(TRAJECTORIES, (reason, other), strict=True)
    )
    return ". ".join(f"{name.capitalize()}: {why}" for name, why in both if why)


def _gains(findings: AllFindings) -> Iterator[str]:
    pictures = next(iter(findings.values())).gains_pictures
    if pictures:
        yield from ("", "## Gains and roots", "", "Numbers: [gains.json](gains/gains.json).")
        for name in pictures:
            yield from ("", f"![{name}](gains/{name})")


def _logs(findings: AllFindings, cases: Sequence[str]) -> Iterator[str]:
    paths = logs(findings, cases)
    if paths:
        yield from ("", "## Logs", "", "`convoy review LOG` shows them:", "")
        yield from (f"- {log}" for log in paths)
