"""The report of a run as one HTML file: no request to a network, light and dark."""

import shlex
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

from scenarios.results.files import write_whole
from scenarios.results.outcome import with_outcome_line
from scenarios.results.record import hole_lines
from scenarios.results.report.plots import ReportDetail, RunPlots, TimeMark, colour_code
from scenarios.results.report.tables import (
    MOST_EVENTS,
    Markup,
    element,
    event_table,
    event_text,
    join,
    limit_table,
    lines_table,
    link_table,
    string_table,
    vehicle_table,
)
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from transport.panels import colour_of

MOST_BYTES = 500_000
DETAILS = (
    ReportDetail(points=16_000, vehicles=40, strips=24, rows=60),
    ReportDetail(points=4_000, vehicles=16, strips=12, rows=40),
    ReportDetail(points=1_000, vehicles=6, strips=6, rows=20),
)
"""Tried in turn until the page is small enough."""
MOST_WARNINGS, MOST_CHANGES = 50, 200
MOST_HOLES = 10
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""The page may load nothing."""
STRING_HINT = (
    "A gain divides the norm of a vehicle's error by that of the vehicle ahead; above 1 the error "
    "grows along the string. The last row divides the last follower's by the first one's, its "
    "acceleration by the lead's. Gains of errors at the level of the noise are left out. "
    "Definitions: convoy reference string-stability."
)


def write_report(record: RunRecord, path: Path, summary: RunSummary | None = None) -> None:
    """Write the report of a run; `summary` is by default that of its log.

    An existing file is replaced. Raises LogError or OSError.
    """
    write_whole(path, report_page(record, summary or record.summary).encode())


def report_page(record: RunRecord, summary: RunSummary) -> str:
    """The page as text; less detailed if it would exceed `MOST_BYTES`."""
    page = ""
    for detail in DETAILS:
        page = _page(record, summary, detail)
        if len(page.encode()) < MOST_BYTES:
            break
    return page


def _page(record: RunRecord, summary: RunSummary, detail: ReportDetail) -> str:
    about = summary.identity
    title = about.title or f"{about.scenario}, seed {about.seed}"
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", http_equiv="Content-Security-Policy", content=POLICY),
        element("title", title),
        element("style", Markup(_resource("page.css"))),
    )
    body = element(
        "body",
        *_header(record, summary, title),
        *_sections(record, summary, detail),
        element("script", Markup(_resource("page.js"))),
    )
    return f"<!DOCTYPE html>\n{element('html', head, body, lang='en')}\n"


def _resource(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _header(record: RunRecord, summary: RunSummary, title: str) -> Iterator[Markup]:
    about = summary.identity
    line = with_outcome_line(summary).outcome_line
    kind = "good" if line.startswith("OK") else "bad" if line.startswith("FAILED") else None
    yield element("h1", title)
    yield element("p", line, class_=" ".join(filter(None, ("outcome", kind))))
    versions = ", ".join(f"{name} {version}" for name, version in about.versions.items())
    yield element(
        "p",
        f"scenario {about.scenario}, seed {about.seed}, {about.clock} clock, "
        f"{summary.ran_s:.1f} of {summary.duration_s:.1f} s; {versions}",
        class_="about",
    )
    log = shlex.quote(str(record.log))
    commands = (f"convoy review {log}", f"convoy report {log}")
    codes = [part for text in commands for part in (element("code", text), Markup(" "))]
    yield element("p", *codes)
    reasons = [f"failed: {reason}" for reason in summary.reason.split("; ") if reason]
    warnings = [*reasons, *_unrecorded(record, summary), *summary.warnings]
    if len(warnings) > MOST_WARNINGS:
        more = len(warnings) - MOST_WARNINGS
        warnings = [*warnings[:MOST_WARNINGS], f"{more} more warnings are in summary.json"]
    if warnings:
        yield element(
            "div", element("ul", *(element("li", text) for text in warnings)), class_="warnings"
        )


def _unrecorded(record: RunRecord, summary: RunSummary) -> Iterator[str]:
    """Describe what is missing in the log, and so in the figures."""
    if faults := summary.log_faults or record.faults:
        yield faults
    yield from hole_lines(summary.holes, MOST_HOLES)
    for row in summary.vehicles:
        if row.silent_from_s is not None:
            yield f"silent: {row.name} from {row.silent_from_s:.2f} s after the start on"


def _sections(record: RunRecord, summary: RunSummary, detail: ReportDetail) -> Iterator[Markup]:
    names = list(record.vehicle_names)
    colours = {name: colour_code(colour_of(place)) for place, name in enumerate(names)}
    rows, total = detail.rows, len(summary.vehicles)
    hint = f"The first {rows} of {total} vehicles; summary.json has all." if total > rows else ""
    yield from _section("Vehicles", vehicle_table(summary, colours, rows), hint)
    yield from _section("String stability", string_table(summary, rows), STRING_HINT)

    def command(at_s: float) -> str:
        return f"convoy review {shlex.quote(str(record.log))} --at {at_s:.2f}"

    hint = "A click on a time moves the cursor of the pictures, one on a command copies it."
    yield from _section("Events", event_table(summary, command), hint)
    if summary.changes:
        changes = [
            (
                change.at_s,
                " ".join(filter(None, (change.kind, change.target)))
                + (f" for {change.for_s:g} s" if change.for_s is not None else "")
                + (" by hand" if change.by_hand else ""),
            )
            for change in summary.changes
        ]
        yield from _section("Changes", lines_table(changes[:MOST_CHANGES]))
    yield from _pictures(record, summary, detail)
    yield from _section("Links", link_table(summary, rows))
    yield from _section("Limits", limit_table(summary))
    text = "All figures are in summary.json; `convoy reference fields` defines them."
    yield from _section("All figures", element("p", text))


def _pictures(record: RunRecord, summary: RunSummary, detail: ReportDetail) -> Iterator[Markup]:
    events = summary.events[:MOST_EVENTS]
    marks = [TimeMark(event.at_s, event_text(event)) for event in events]
    plots = RunPlots(record, summary, detail, marks)
    if plots.is_empty:
        return
    hint = ""
    if plots.left_out:
        hint = f"The vehicles with the largest errors; {plots.left_out} others are left out."
    for kind, title, pictures in (
        ("time", "Pictures over time, s", list(plots.figures())),
        ("place", "Pictures along the path of the lead, m", list(plots.figures_along_path())),
        ("frequency", "Gains from the vehicle ahead by frequency, Hz", list(plots.gain_figures())),
    ):
        if pictures:
            text = "Move over a picture to read its values."
            readout = element("div", text, class_="readout", data_axis=kind)
            content = element("section", readout, plots.legend(), *pictures, id=f"over-{kind}")
            yield from _section(title, content, hint)


def _section(title: str, content: Markup | None, hint: str = "") -> Iterator[Markup]:
    if content is not None:
        yield join(
            element("h2", title), element("p", hint, class_="hint") if hint else None, content
        )
