"""The runs of a folder as one HTML file that sorts and filters itself, without a network."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from shlex import quote

from scenarios.studies.run_list import MISSING, ListedRun

HEADINGS = (
    "run",
    "scenario",
    "overrides",
    "seed",
    "clock",
    "outcome",
    "time, s",
    "worst error, m",
    "vehicle",
    "events",
    "in one line",
    "faults of the log",
    "open it",
)
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width">
<style>
:root {{ color-scheme: light dark; font: 14px/1.4 system-ui, sans-serif; }}
body {{ margin: 1.5rem; }}
input {{ font: inherit; padding: .3rem .5rem; width: 24rem; max-width: 100%; }}
table {{ border-collapse: collapse; margin-top: 1rem; }}
th {{ cursor: pointer; text-align: left; position: sticky; top: 0; background: Canvas; }}
th[data-order="1"]::after {{ content: " ▲"; }}
th[data-order="-1"]::after {{ content: " ▼"; }}
th, td {{ padding: .25rem .7rem; border-bottom: 1px solid color-mix(in srgb, GrayText 40%, Canvas);
  vertical-align: top; }}
td.number {{ text-align: right; font-variant-numeric: tabular-nums; }}
td.failed, td.unreadable, td.faults {{ color: light-dark(#b3261e, #ff8a80); font-weight: 600; }}
code {{ user-select: all; white-space: nowrap; }}
</style></head><body>
<h1>{title}</h1>
<input type="search" placeholder="Show rows that contain all of these words"
  aria-label="Filter rows"> <span role="status">{count}</span>
<table><thead><tr>{head}</tr></thead><tbody>
{rows}
</tbody></table>
<script>
const body = document.querySelector("tbody"), rows = [...body.rows];
const status = document.querySelector("[role=status]");
const search = document.querySelector("input");
search.addEventListener("input", () => {{
  const words = search.value.toLowerCase().split(/\\s+/);
  let shown = 0;
  for (const row of rows) {{
    const text = row.textContent.toLowerCase();
    row.hidden = !words.every(word => text.includes(word));
    shown += !row.hidden;
  }}
  status.textContent = `${{shown}} of ${{rows.length}} runs`;
}});
document.querySelectorAll("th").forEach((heading, place, all) =>
  heading.addEventListener("click", () => {{
    const order = heading.dataset.order === "1" ? -1 : 1;
    all.forEach(other => delete other.dataset.order);
    heading.dataset.order = order;
    const key = row => row.cells[place].dataset.value ?? row.cells[place].textContent;
    const isNumber = rows.some(row => row.cells[place].className.includes("number"));
    rows.sort((a, b) => {{
      const x = key(a), y = key(b);
      if (x === "" || y === "") return (x === "") - (y === "");
      return order * (isNumber ? x - y : x.localeCompare(y));
    }});
    body.append(...rows);
  }}));
</script></body></html>
"""


def run_list_page(folder: Path, runs: Sequence[ListedRun]) -> str:
    """Return the page of the runs in a folder."""
    return PAGE.format(
        title=escape(f"Runs in {folder}"),
        count=f"{len(runs)} of {len(runs)} runs",
        head="".join(f"<th>{escape(heading)}</th>" for heading in HEADINGS),
        rows="\n".join(f"<tr>{_row(run)}</tr>" for run in runs),
    )


def _row(run: ListedRun) -> str:
    cells = [
        _cell(run.log),
        _cell(run.scenario),
        _cell(" ".join(run.overrides)),
        _number(run.seed, "d"),
        _cell(run.clock),
        _cell(run.outcome, run.outcome),
        _number(run.ran_s, ".1f"),
        _number(run.worst_error_m, ".3f"),
        _cell(run.worst_vehicle),
        _number(run.events, "d"),
        _cell("" if run.faults == run.line else run.line),
        _cell(run.faults, "faults"),
        _command(run),
    ]
    return "".join(cells)


def _command(run: ListedRun) -> str:
    if run.faults == MISSING:
        return "<td></td>"
    return f"<td><code>{escape(f'convoy review {quote(run.log)}')}</code></td>"


def _cell(text: str, kind: str = "") -> str:
    return f'<td class="{kind}">{escape(text)}</td>' if kind else f"<td>{escape(text)}</td>"


def _number(value: float | None, form: str) -> str:
    if value is None:
        return '<td class="number" data-value=""></td>'
    return f'<td class="number" data-value="{value}">{value:{form}}</td>'
