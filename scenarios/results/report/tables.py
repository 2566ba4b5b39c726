"""Tables of a report: figures by vehicle and link, events and limits."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
from math import isfinite
from typing import Any

from scenarios.results.links import LinkSummary
from scenarios.results.run_event import RunEvent
from scenarios.results.string_figures import STRING_SIGNALS, StringFigures, StringSignal
from scenarios.results.summary import RunSummary
from scenarios.results.vehicle_figures import string_errors

# ---- HTML and SVG elements as text; everything but markup is escaped


class Markup(str):
    """Text that is markup already."""

    __slots__ = ()


def element(tag: str, /, *content: "str | None", **attributes: object) -> Markup:
    """Make an element; None is left out, as are attributes that are None.

    Names of attributes: a trailing underscore is dropped, others become hyphens.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(str(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    inside = join(*content)
    if not content and tag in {"path", "line", "rect", "circle", "meta"}:
        return Markup(f"<{tag}{given}/>")
    return Markup(f"<{tag}{given}>{inside}</{tag}>")


def join(*parts: "str | None") -> Markup:
    """Concatenate texts and markup."""
    return Markup(
        "".join(
            part if isinstance(part, Markup) else escape(part, quote=False)
            for part in parts
            if part is not None
        )
    )


# ---- Tables


Cell = tuple[str, Callable[[Any], Any], float, str]
"""Heading, value of a row, factor and format."""
MOST_EVENTS = 200

VEHICLE_CELLS: Sequence[Cell] = (
    ("largest error, cm", lambda row: row.cross_track_error_m_max, 100.0, ".1f"),
    ("rms error, cm", lambda row: row.cross_track_error_m_rms, 100.0, ".1f"),
    ("at, s", lambda row: row.cross_track_error_max_at_s, 1.0, ".2f"),
    ("largest road error, cm", lambda row: row.road_error_m_max, 100.0, ".1f"),
    ("least gap, m", lambda row: row.true_gap_m_min, 1.0, ".2f"),
    ("largest gap, m", lambda row: row.true_gap_m_max, 1.0, ".2f"),
    ("largest self-estimated error, cm", lambda row: row.lateral_error_m_max, 100.0, ".1f"),
    ("friction used, %", lambda row: row.friction_ratio_max, 100.0, ".0f"),
    ("stops", lambda row: row.reaction.stops, 1.0, "d"),
    ("blind, m", lambda row: row.reaction.blind_m, 1.0, ".1f"),
    ("overridden, %", lambda row: row.overridden_ratio, 100.0, ".0f"),
    ("distance, m", lambda row: row.distance_m, 1.0, ".0f"),
)
LINK_CELLS: Sequence[Cell] = (
    ("sent", lambda row: row.sent, 1.0, "d"),
    ("delivered", lambda row: row.delivered, 1.0, "d"),
    ("lost, %", lambda row: row.loss_ratio, 100.0, ".1f"),
    ("requested, %", lambda row: row.requested_loss_ratio, 100.0, ".3g"),
    ("longest burst", lambda row: row.burst_messages_max, 1.0, "d"),
    ("mean latency, ms", lambda row: row.latency_ms_mean, 1.0, ".1f"),
    ("mean age, ms", lambda row: row.age_ms_mean, 1.0, ".0f"),
    ("largest age, ms", lambda row: row.age_ms_max, 1.0, ".0f"),
)


def table(headings: Sequence[str], rows: Sequence[Sequence[Markup]], kind: str = "") -> Markup:
    """Make a table in a frame that scrolls sideways; the first cell of a row is its heading."""
    head = element("tr", *(element("th", heading, scope="col") for heading in headings))
    body = [element("tr", *cells) for cells in rows]
    whole = element("table", element("thead", head), element("tbody", *body), class_=kind or None)
    return element("div", whole, class_="wide")


def number(value: Any, factor: float = 1.0, form: str = ".4g") -> Markup:
    """Make a cell with a figure; its `data-value` is the number of `summary.json`."""
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return element("td", "–", class_="n")
    scaled = value if factor == 1.0 else value * factor
    return element("td", format(scaled, form), class_="n", data_value=repr(value))


def name_cell(text: str, colour: str | None = None) -> Markup:
    style = f"--key:{colour}" if colour else None
    inside = element("span", text, class_="key", style=style) if colour else text
    return element("th", inside, scope="row")


def vehicle_table(summary: RunSummary, colours: Mapping[str, str], most: int) -> Markup:
    rows = [
        [
            name_cell(row.name + (" (lead)" if row.role == "lead" else ""), colours.get(row.name)),
            *(number(value(row), factor, form) for _, value, factor, form in VEHICLE_CELLS),
        ]
        for row in summary.vehicles[:most]
    ]
    return table(["vehicle", *(heading for heading, *_ in VEHICLE_CELLS)], rows, "figures")


def string_table(summary: RunSummary, most: int) -> Markup | None:
    """Errors of each follower, and their gains from vehicle to vehicle and from head to tail."""
    errors = string_errors(summary.vehicles)
    if not errors:
        return None
    strings = [row.figures for row in errors]
    signals = [one for one in STRING_SIGNALS if any(map(one.has_gain, strings))]
    largest = max((row.error_m_max or 0.0 for row in errors), default=0.0)
    rows = []
    for row in errors[:most]:
        share = 100.0 * (row.error_m_max or 0.0) / largest if largest else 0.0
        bar = element("td", element("span", class_="bar", style=f"width:{share:.1f}%"), class_="b")
        of_signals = [cell for signal in signals for cell in _string_cells(signal, row.figures)]
        rows.append(
            [
                name_cell(row.vehicle),
                bar,
                number(row.error_m_max, 100.0, ".1f"),
                number(row.error_m_rms, 100.0, ".2f"),
                *of_signals,
            ]
        )
    if len(errors) > 1:
        empty = element("td")
        tail = []
        for signal in signals:
            tail += [element("td"), *map(_ratio, signal.gains_from_head(errors[-1].figures))]
        rows.append([name_cell("head to tail"), empty, empty, empty, *tail])
    headings = [heading for signal in signals for heading in _string_headings(signal)]
    return table(("vehicle", "largest error", "largest, cm", "rms, cm", *headings), rows, "figures")


def _string_cells(signal: StringSignal, figures: StringFigures) -> list[Markup]:
    factor, _ = SHOWN[signal.unit]
    return [number(signal.rms(figures), factor, ".3g"), *map(_ratio, signal.gains(figures))]


def _string_headings(signal: StringSignal) -> Sequence[str]:
    name, (_, unit) = signal.name, SHOWN[signal.unit]
    return (f"rms {signal.quantity}, {unit}", f"{name} gain, L2", f"{name} gain, L∞")


SHOWN = {"error_m": (100.0, "cm"), "mps2": (1.0, "m/s²")}
"""Factor and unit of the norms of a signal."""


def _ratio(value: float | None) -> Markup:
    if value is None:
        return number(None)
    kind = "n grows" if value > 1.0 else "n"
    return element("td", f"{value:.2f}", class_=kind, data_value=repr(value))


def link_table(summary: RunSummary, most: int) -> Markup | None:
    """Figures of the links that lost most."""
    if not summary.links:
        return None
    rows = []
    for row in _worst(summary.links, most):
        causes = {**row.dropped, **row.not_arrived}
        text = ", ".join(f"{count} {word.replace('_', ' ')}" for word, count in causes.items())
        cells = [number(value(row), factor, form) for _, value, factor, form in LINK_CELLS]
        rows.append([name_cell(link_name(row)), *cells, element("td", text)])
    return table(
        ["link", *(heading for heading, *_ in LINK_CELLS), "lost by cause"], rows, "figures"
    )


def link_name(row: LinkSummary) -> str:
    return f"{row.sender} → {row.receiver}"


def _worst(links: Sequence[LinkSummary], most: int) -> list[LinkSummary]:
    worst = sorted(range(len(links)), key=lambda place: -links[place].loss_ratio)[:most]
    return [links[place] for place in sorted(worst)]


def event_table(summary: RunSummary, command: Callable[[float], str]) -> Markup | None:
    """Events with the command that shows each; `command` takes its time (s)."""
    if not summary.events:
        return None
    rows = [
        [time_cell(event.at_s), element("td", event_text(event)), command_cell(command(event.at_s))]
        for event in summary.events[:MOST_EVENTS]
    ]
    return table(("at, s", "event", "command that shows it"), rows)


def event_text(event: RunEvent) -> str:
    """Describe an event without its time, unless that is an interval."""
    return event.line.removesuffix(f", {event.at_s:.2f} s after the start")


def time_cell(at_s: float) -> Markup:
    """A time; a click on it moves the cursor there."""
    button = element("button", f"{at_s:.2f}", class_="at", data_at=f"{at_s:.9g}", type="button")
    return element("th", button, scope="row", data_value=repr(at_s))


def command_cell(text: str) -> Markup:
    return element("td", element("code", text))


def lines_table(rows: Sequence[tuple[float, str]]) -> Markup:
    """Times with a text, such as changes."""
    return table(("at, s", "what"), [[time_cell(at), element("td", text)] for at, text in rows])


def limit_table(summary: RunSummary) -> Markup | None:
    if not summary.limits:
        return None
    rows = [
        [
            name_cell(" ".join(filter(None, (row.vehicle, row.limit, row.action)))),
            number(row.bound),
            number(row.value),
            element("td", row.message or "kept", class_="grows" if row.broken else None),
        ]
        for row in summary.limits
    ]
    return table(("limit", "allowed", "value", "result"), rows, "figures")
