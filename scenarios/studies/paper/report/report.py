"""Writes what `convoy reproduce` found: report.md, report.json and the pictures beside them."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from scenarios.results.drives import Trial
from scenarios.studies.paper.claims import base, field, gains, model, other_cases, theory
from scenarios.studies.paper.claims.claim import JUDGEMENTS, Answer, JudgedClaim, groups, judge
from scenarios.studies.paper.claims.field import numbers_of, settled_errors
from scenarios.studies.paper.experiments import RUNS_OF_CASE
from scenarios.studies.paper.findings import SAME, Findings, non_increasing
from scenarios.studies.paper.keys import FIELD_WITH, FIELD_WITHOUT
from scenarios.studies.paper.report.pictures import PICTURES
from scenarios.studies.paper.report.tables import tables
from scenarios.studies.picture_style import STYLE

SCHEMA = "convoy.reproduction/1"
CLAIMS = (
    *model.CLAIMS,
    *theory.CLAIMS,
    *gains.CLAIMS,
    *base.CLAIMS,
    *other_cases.CLAIMS,
    *field.CLAIMS,
)
"""All claims, in the order of the paper."""

CAPTIONS = {
    "road.png": "The road of the main cases, which the paper does not give.",
    "errors_base.png": "Lateral errors against the own trajectory, base case.",
    "errors_a_to_d.png": "Scenarios A to D. D rings at 3 Hz: with a light car at 30 m/s the loop's "
    "steering mode has a damping ratio of no more than 0.14, and a yaw rate that is measured at 20 "
    "Hz takes some of it away; measured at 50 Hz it does not ring.",
    "errors_variable_speed.png": "Lateral errors while the speed changes in both lane changes.",
    "maxima.png": "Largest errors, exact (bars), with the road moved by less than lies between "
    "samples (dashes) and with a receiver's noise (dots; where it is shorter, of the first lane "
    "change).",
    "lead_data.png": "With the predecessor's data only, true errors grow from car to car, while "
    "those against the own trajectory hardly show it; with the lead's data they level off.",
    "radius.png": "Errors against the radius of the bends, first lane change.",
    "propagation.png": "The paper's G(jω) in closed form and simulated, and what a swing of the "
    "lead becomes in the convoy. G takes the difference of both cars' states at one instant, "
    "heading included and without feedforward. In the convoy a car steers along the path that the "
    "other left: F(jω), which the measured ratios follow at low frequency. Above, the fit over "
    "some 35 m smooths the path away (a swing of 7 rad/s is 27 m long), less so with less preview.",
    "field.png": "Field experiment: PL1 drives alone, PL2 behind its record, PL3 behind both.",
}


def write_report(findings: Findings, cases: Sequence[str], out: Path) -> list[JudgedClaim]:
    """Judge the findings on `cases`, write report and pictures into `out`; gives the claims."""
    claims = judge(CLAIMS, findings)
    pictures = _draw(findings, out)
    text = "\n".join(_markdown(findings, cases, claims, pictures)) + "\n"
    (out / "report.md").write_text(text, encoding="utf-8")
    report = _machine_readable(findings, cases, claims, pictures)
    (out / "report.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return claims


def _draw(findings: Findings, out: Path) -> list[str]:
    """Draw every picture for which there are results; gives their file names."""
    drawn = []
    with mpl.rc_context(STYLE):
        for name, (needs, draw) in PICTURES.items():
            if all(map(findings.has, needs)):
                draw(findings).savefig(out / name, metadata={"Software": ""})
                drawn.append(name)
    return drawn


def _markdown(
    findings: Findings, cases: Sequence[str], claims: Sequence[JudgedClaim], pictures: Sequence[str]
) -> Iterator[str]:
    yield "# The paper's claims, tested"
    yield ""
    yield f"Cases: {', '.join(cases)}. {_counts(claims)}"
    yield ""
    yield from _in_short(claims)
    yield from _method()
    yield from _claims(claims)
    for name in pictures:
        yield from ("", f"![{name}]({name})", "", CAPTIONS[name])
    yield from tables(findings)
    yield from _gains(findings)
    yield from _logs(findings, cases)


def _counts(claims: Sequence[JudgedClaim]) -> str:
    hold, open_, fail, rest = (sum(one.judgement == j for one in claims) for j in JUDGEMENTS)
    return (
        f"Of {len(claims)} claims {hold} hold, {open_} are undecided, {fail} do not hold, {rest} "
        "cannot be checked."
    )


GROUPS = {
    "does not hold": "Do not hold",
    "undecided": "Undecided: hold or not with where on the road the samples fall",
    "noise spoils": "Hold with exact measurements, but with noise not for every seed",
    "noise helps": "Do not hold with exact measurements, but with noise for some seeds",
}


def _in_short(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    for group, found in groups(claims).items():
        if found:
            yield f"{GROUPS[group]}:"
            yield ""
            for one in found:
                runs = "" if group == "does not hold" else f": {_runs(one.answer)}"
                yield f"- {one.claim.paper} ({one.claim.where}){runs}"
            yield ""


def _runs(answer: Answer) -> str:
    """In how many runs a claim holds."""
    tallies = ((answer.phases, "phases"), (answer.noise, "seeds"))
    return ", ".join(f"{t.holding} of {t.runs} {name}" for t, name in tallies if t)


def _method() -> Iterator[str]:
    yield from (
        "## How it was done",
        "",
        "- Four cars, 15 m apart (half a second at 30 m/s), with the paper's car, law and gains; "
        "loads unknown to the controllers; poses at 20 Hz over links of 20 ms; decisions at 50 Hz.",
        "- The paper does not give its road. Here a car moves 3.6 m to the right from 5 s on and "
        "back from 20 s on, on arcs of 500 m and straights in turn, a second each: what the paper "
        "says of curvature (at most one change a second, hundreds of metres) and of time (done "
        "before 10 s and 25 s). At 10 and 20 m/s the same road is driven, and beside it one that "
        "takes the same times. What depends on the radius is said.",
        "- Main runs are exact, as the paper's presumably are. Noise: 2 cm, 0.1°, 0.03 m/s, "
        "0.1°/s, over several seeds; A to D and variable speed up to the end of the first lane "
        "change.",
        "- What a fit makes of a bend depends on where the samples fall on it. Exact runs are "
        "repeated with the road moved by a quarter, half and three quarters of 0.1 s, after which "
        "the pattern of poses and decisions repeats. A claim that holds in some of these four "
        "phases only is undecided.",
        "- The paper measures errors against the trajectory that a car itself has fitted. That is "
        "given first, largest values of the followers front to back; true errors are distances "
        f"from the lead's driven path. Values that differ by less than {1000 * SAME:.0f} mm count "
        "as equal.",
        "",
    )


def _claims(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    yield "## Claims"
    yield ""
    yield "| paper | says | we get | verdict | holds in | why, or how far |"
    yield "|---|---|---|---|---|---|"
    for one in claims:
        claim, answer, verdict = one.claim, one.answer, str(one.judgement)
        if verdict in {"undecided", "does not hold"}:
            verdict = f"**{verdict}**"
        cells = (claim.where, claim.paper, answer.ours, verdict, _runs(answer), answer.reason)
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    yield ""
    yield "## Pictures"


def _gains(findings: Findings) -> Iterator[str]:
    if findings.gains_pictures:
        yield from ("", "## Gains and roots", "", "Numbers: [gains.json](gains/gains.json).")
        for name in findings.gains_pictures:
            yield from ("", f"![{name}](gains/{name})")


def _logs(findings: Findings, cases: Sequence[str]) -> Iterator[str]:
    found = logs(findings, cases)
    if found:
        yield from ("", "## Logs", "", "`convoy review LOG` shows them:", "")
        yield from (f"- {log}" for log in found)


def logs(findings: Findings, cases: Sequence[str]) -> list[str]:
    """Logs that were kept, relative to the report."""
    runs = {key: run for case in cases for key, run in RUNS_OF_CASE[case].items()}
    found = [f"{key}/run.mcap" for key, run in runs.items() if run.logged and findings.has(key)]
    if findings.field is not None:
        found += [f"field/{name}/run.mcap" for name in findings.field.logs]
    return found


def _machine_readable(
    findings: Findings, cases: Sequence[str], claims: Sequence[JudgedClaim], pictures: Sequence[str]
) -> dict[str, Any]:
    report: dict[str, Any] = {
        "schema": SCHEMA,
        "cases": list(cases),
        "claims": [_row(one) for one in claims],
        "runs": {str(key): _figures(trial) for key, trial in findings.trials.items()},
        "propagation": [
            {
                "frequency_radps": one.frequency,
                "preview_s": one.preview_s,
                "amplitude_m": np.abs(one.amplitudes).tolist(),
                "ratio": one.ratios,
            }
            for one in sorted(findings.sine_responses, key=lambda one: one.frequency)
        ],
        "pictures": [*pictures, *(f"gains/{name}" for name in findings.gains_pictures or ())],
        "logs": logs(findings, cases),
    }
    if findings.field is not None:
        for key, trial in (
            (FIELD_WITH, findings.field.with_lead_data),
            (FIELD_WITHOUT, findings.field.without_lead_data),
        ):
            report["runs"][str(key)] = _figures(trial) | numbers_of(settled_errors(trial))
    return report


def _row(one: JudgedClaim) -> dict[str, Any]:
    """A judged claim as JSON."""
    claim, answer = one.claim, one.answer
    return {
        "name": claim.name,
        "where": claim.where,
        "paper": claim.paper,
        "ours": answer.ours,
        "verdict": one.judgement,
        "reason": answer.reason,
        "phases": answer.phases._asdict() if answer.phases else None,
        "noise": answer.noise._asdict() if answer.noise else None,
        "numbers": answer.numbers,
    }


def _figures(trial: Trial) -> dict[str, Any]:
    """Largest errors of one run, an entry per follower."""
    return {
        "vehicles": [drive.name for drive in trial.followers],
        "lead_tracking_error_m_max": trial.lead.tracking_max,
        "tracking_error_m_max": trial.tracking,
        "cross_track_error_m_max": trial.cross_track,
        "tracking_decreases": non_increasing(trial.tracking),
        "cross_track_decreases": non_increasing(trial.cross_track),
    }
