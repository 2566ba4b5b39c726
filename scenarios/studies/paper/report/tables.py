"""Tables of the report on the paper's experiments, as lines of Markdown."""

from collections.abc import Iterator, Sequence

from scenarios.results.drives import Trial
from scenarios.studies.paper.experiments import RADII, lane_change_lengths
from scenarios.studies.paper.findings import Findings, in_cm, non_increasing
from scenarios.studies.paper.keys import (
    BASE,
    NO_LEAD_DATA,
    TRAJECTORY_NAMES,
    A,
    B,
    C,
    at_radius,
)
from scenarios.studies.paper.linear_prediction import predict_case

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
