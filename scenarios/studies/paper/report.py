"""Writes report.md, report.json and the plots of `convoy paper reproduce`."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from scenarios.studies.job import write_files
from scenarios.studies.paper.claims import (
    JUDGEMENTS,
    Claim,
    JudgedClaim,
    Values,
    counts_text,
    judge_all,
)
from scenarios.studies.paper.drives import Trial
from scenarios.studies.paper.measures import (
    TOLERANCE_M,
    Findings,
    growth,
    predict_case,
)
from scenarios.studies.paper.plots import CAPTIONS, draw_all
from scenarios.studies.paper.runs import RUNS_OF_CASE, SINES, TRAJECTORIES, label
from vehicles.preview.curve_fit import Trajectory

SCHEMA = "convoy.reproduction/4"
AllFindings = Mapping[Trajectory, Findings]
LOST_M = 10.0
"""Errors (m) of cars that have lost their path; larger ones are not printed."""

METHOD = f"""## Method

- Errors. The *tracking error* is a car's distance from the trajectory it has fitted; this is the
  error in the figures of V-C. The *true error* is the distance from the path that the lead has
  driven; this is e_lat in Section IV-B, and decides whether a car is off the track. Lists contain
  the largest error of each follower, front to back. Differences below {1000 * TOLERANCE_M:.0f} mm
  are ignored.
- Convoy. Four of the paper's cars, 15 m from centre to centre (0.5 s at 30 m/s), with the paper's
  law and gains. Controllers do not know the load. Poses are sent at 20 Hz over links with 20 ms
  latency; control runs at 50 Hz.
- Road. The paper does not specify its road. Here each car moves 3.6 m to the right from 5 s on and
  back from 20 s on, on arcs of 500 m radius and straights of one second each. At 10 and 20 m/s the
  convoy drives the same road, and another road that takes the same times.
- Trajectories. Every run is simulated twice: with the default fitted trajectory, and with the
  paper's recipe taken literally from Section III-B: all samples of both sources within the preview,
  a line if no sample is 10 cm from it, else the circle of eq. (5).
- Exact and noisy runs. Main runs have exact measurements and cars that know their own state,
  presumably as in the paper. Noisy runs use several seeds of 2 cm, 0.1°, 0.03 m/s and 0.1°/s, and
  estimate the own state. They end after the first lane change in A to D and at variable speed, and
  in the first curve in the field experiment.
- Shifted roads. A fit depends on where samples lie in a curve. Exact runs are therefore repeated
  with the road shifted by a quarter, half and three quarters of 0.1 s, the common period of poses
  and control.
- Verdicts. A claim about runs holds if it holds in all its exact runs: the four phases of the road,
  or the simulated radii or frequencies. It does not hold if it holds in none of them, and is
  undecided otherwise. Counts of noisy runs are given for information. A misprint is a formula or
  figure that is wrong as printed; no other claim depends on it.
"""


def write_report(
    findings: AllFindings,
    cases: Sequence[str],
    out: Path,
    picture_format: str = "png",
    gains_pictures: Sequence[str] = (),
) -> list[JudgedClaim]:
    """Judge the claims on `cases` and write report and plots into `out`; returns the claims."""
    claims = judge_all(findings)
    figures = draw_all(findings, picture_format)
    pictures = [*figures, *(f"gains/{name}" for name in gains_pictures)]
    text = "\n".join(_markdown(findings, cases, claims, pictures)) + "\n"
    report = _machine_readable(findings, cases, claims, pictures)
    write_files(out, {"report.md": text, "report.json": report, **figures})
    return claims


def _logs(findings: AllFindings, cases: Sequence[str]) -> list[str]:
    runs = {key: run for case in cases for key, run in RUNS_OF_CASE[case].items()}
    logged = [key for key, run in runs.items() if run.logged]
    return [f"{kind}/{key}/run.mcap" for kind in findings for key in logged]


# ---- report.json


def _machine_readable(
    findings: AllFindings,
    cases: Sequence[str],
    claims: Sequence[JudgedClaim],
    pictures: Sequence[str],
) -> dict[str, Any]:
    """Claims, figures of the runs, plots and logs as JSON."""
    return {
        "schema": SCHEMA,
        "cases": list(cases),
        "claims": [_row(claim) for claim in claims],
        "runs": {
            kind: {key: _figures(trial) for key, trial in results.trials.items()}
            for kind, results in findings.items()
        },
        "pictures": list(pictures),
        "logs": _logs(findings, cases),
    }


def _row(row: JudgedClaim) -> dict[str, Any]:
    claim = row.claim
    return {
        "name": claim.name,
        "where": claim.where,
        "paper": claim.paper,
        "expected": claim.expected and f"{claim.expected.relation} {claim.expected.limit:.6g}",
        "unit": claim.expected.unit if claim.expected else "",
        "simulated": claim.simulated,
        "note": claim.note,
        "trajectories": {
            kind: {
                "verdict": row.verdicts[kind],
                "values": {"kind": values.kind, "exact": values.exact, "noisy": values.noisy},
                "holding": {
                    "exact": claim.holding(values.exact),
                    "noisy": claim.holding(values.noisy),
                },
                "figures": values.figures,
            }
            for kind, values in row.values.items()
        },
    }


def _figures(trial: Trial) -> dict[str, Any]:
    return {
        "vehicles": [drive.name for drive in trial.followers],
        "lead_tracking_error_m_max": trial.lead.tracking_max,
        "tracking_error_m_max": trial.tracking,
        "cross_track_error_m_max": trial.cross_track,
    }


# ---- report.md


def in_cm(errors: Sequence[float]) -> str:
    """Format errors (m), such as the largest of each follower, front to back."""
    texts = (f"{100.0 * m:z.1f}" if m < LOST_M else f"over {100.0 * LOST_M:.0f}" for m in errors)
    return ", ".join(texts) + " cm"


def _markdown(
    findings: AllFindings,
    cases: Sequence[str],
    claims: Sequence[JudgedClaim],
    pictures: Sequence[str],
) -> Iterator[str]:
    yield "# The paper's claims, tested\n"
    yield f"Cases: {', '.join(cases)}. Claims, judged with two trajectories: {len(claims)}.\n"
    yield from (f"- {name}: {counts_text(claims, kind)}" for kind, name in TRAJECTORIES.items())
    yield "\n## Claims that do not hold, or only in some runs\n"
    for verdict in list(JUDGEMENTS)[1:4]:
        for row in claims:
            kinds = [name for kind, name in TRAJECTORIES.items() if row.verdicts[kind] == verdict]
            with_kinds = "" if len(kinds) == 2 or not kinds else f" with {kinds[0]}"
            if kinds:
                yield f"- {verdict}{with_kinds}: {row.claim.paper} ({row.claim.where})"
    yield f"\n{METHOD}\n## Claims\n"
    yield from _table(
        ("section", "claim", *(c for n in TRAJECTORIES.values() for c in (n, "verdict")), "note"),
        [
            (
                row.claim.where,
                row.claim.paper,
                *(cell for kind in TRAJECTORIES for cell in _cells(row, kind)),
                row.claim.note,
            )
            for row in claims
        ],
    )
    yield "\n## Plots"
    for picture in pictures:
        caption = next((text for name, text in CAPTIONS.items() if picture.startswith(name)), "")
        yield f"\n{caption}\n\n![{picture}]({picture})" if caption else f"\n![{picture}]({picture})"
    for results in findings.values():
        yield from _theory(results)
    yield from _runs(findings)
    yield "\n## Logs\n\nOpen a log with `convoy review LOG`.\n"
    yield from (f"- {log}" for log in _logs(findings, cases))


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    for cells in (heading, ["---"] * len(heading), *rows):
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _cells(row: JudgedClaim, kind: Trajectory) -> tuple[str, str]:
    """Value with other figures, and verdict with the counts of runs in which the claim holds."""
    claim, values = row.claim, row.values[kind]
    if not claim.simulated and kind != next(iter(TRAJECTORIES)):
        return "(calculated)", row.verdicts[kind]
    figures = [f"{name}: {_text(value)}" for name, value in values.figures.items()]
    verdict = row.verdicts[kind]
    counts = [
        f"{claim.holding(found)} of {len(found)} {words}"
        for found, words in ((values.exact, values.kind), (values.noisy, "noisy"))
        if len(found) > 1 or (found and words == "noisy")
    ]
    text = f"{verdict} ({', '.join(counts)})" if counts and claim.expected else verdict
    return "; ".join(filter(None, (_value(claim, values), *figures))), text


def _value(claim: Claim, values: Values) -> str:
    """The value of the exact runs, or its range, and what is expected."""
    if not values.exact:
        return ""
    low, high = min(values.exact), max(values.exact)
    unit = claim.expected.unit if claim.expected else "m"

    def number(value: float) -> str:
        in_length = unit == "m" and claim.simulated
        return in_cm([value]) if in_length else f"{value:.3g} {unit}".strip()

    found = number(values.exact[0])
    if high > low:
        found += f" ({number(low)} to {number(high)})"
    if claim.expected is None:
        return found
    return f"{found}, expected {claim.expected.relation} {number(claim.expected.limit)}"


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{_text(entry)} at {key}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return "(" + ", ".join(map(_text, value)) + ")"
    return f"{value:.3g}"


def _theory(findings: Findings) -> Iterator[str]:
    """Compare cases of equal cars at constant speed with linear theory."""
    cases = [key for key in ("base", "no_lead_data", "a", "b", "c") if findings.has(key)]
    if not cases:
        return
    yield f"\n## Comparison with linear theory ({TRAJECTORIES[findings.trajectory]})\n"
    yield "Linear theory applies F(jω) to the lead's path, car by car, without sampling, fit and "
    yield "links.\n"
    rows = []
    for key in cases:
        tracking, true = predict_case(findings, key)
        run = findings.trials[key]
        errors = (tracking, run.tracking, true, run.cross_track)
        rows.append((label(key), *map(in_cm, errors)))
    yield from _table(
        ("case", "tracking: theory", "simulated", "true error: theory", "simulated"), rows
    )


def _runs(findings: AllFindings) -> Iterator[str]:
    """Largest errors in all exact runs on roads that are not shifted, and ratios behind sines."""
    for kind, results in findings.items():
        yield f"\n## Largest errors of the runs ({TRAJECTORIES[kind]})\n"
        rows = []
        for key, run in results.trials.items():
            if not {"phase", "noise", "sine"} & set(key.split("/")):
                word = "yes" if growth(run.tracking) <= TOLERANCE_M else "no"
                rows.append((label(key), in_cm(run.tracking), word, in_cm(run.cross_track)))
        yield from _table(("run", "tracking errors", "decreasing", "true errors"), rows)
        if results.has("propagation"):
            yield f"\n## Amplitude over that of the car ahead ({TRAJECTORIES[kind]})\n"
            ratios = []
            for preview in SINES:
                for frequency, row in zip(*results.ratios(preview), strict=True):
                    ratios.append(
                        (f"{preview:g} s", f"{frequency:g}", ", ".join(f"{r:.3f}" for r in row))
                    )
            yield from _table(("preview", "frequency, rad/s", "cars 2, 3, 4"), ratios)
