"""The picture of blame: the run with other losses, and what each burst cost. Needs matplotlib."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.studies.many.blame.ranking import Blamed
from scenarios.studies.many.blame.report import shortened
from scenarios.studies.many.blame.rerun import BlameAnswer
from scenarios.studies.many.blame.study import Blame
from scenarios.studies.picture_style import BLUE, GREEN, GREY, ORANGE, RED, STYLE
from vehicles.schedule import SECOND

MOST_BARS = 10
LABELS = {"error": "true error", "gap": "true gap"}


def draw(found: Blame, file: Path) -> None:
    """Draw the figure of the worst vehicle over time, and metres for each row."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.5, 3.8), layout="constrained")
        over_time, bars = figure.subplots(1, 2, width_ratios=(3, 2))
        _over_time(over_time, found)
        _bars(bars, found)
        figure.savefig(file, dpi=110.0)


def _over_time(axes: Axes, found: Blame) -> None:
    runs: list[tuple[str, BlameAnswer | None, str]] = [
        ("as recorded", found.recorded, RED),
        ("worst burst given back", found.mended, BLUE),
        ("only the smallest set lost", found.smallest_answer, ORANGE),
        ("nothing lost", found.clean, GREEN),
    ]
    until_s = found.question.until / SECOND
    for label, answer, colour in runs:
        if answer is not None:
            points = [one for one in answer.series[found.recorded.vehicle] if one[0] <= until_s]
            instants, values = [at for at, _ in points], [value for _, value in points]
            axes.plot(instants, values, color=colour, label=label)
    if found.rows:
        for burst in found.rows[0].group:
            axes.axvspan(*burst.span_s, color=GREY, alpha=0.12, linewidth=0.0)
    _bound(axes, found)
    what = LABELS[found.question.figure]
    axes.set(xlabel="time, s", ylabel=f"{what} of {found.recorded.vehicle}, m")
    axes.legend(loc="upper left")


def _bound(axes: Axes, found: Blame) -> None:
    """The limit, where it is one on what is drawn."""
    limit = found.question.limit
    if limit.word == f"{found.question.figure}_m":
        axes.axhline(limit.bound, color=GREY, linewidth=0.9, linestyle=":")


def _bars(axes: Axes, found: Blame) -> None:
    rows = list(reversed(found.rows[:MOST_BARS]))
    axes.barh(range(len(rows)), [max(row.mended_m, 0.0) for row in rows], color=BLUE)
    axes.set_yticks(range(len(rows)), [_label(row) for row in rows], fontsize=7.5)
    axes.grid(visible=False, axis="y")
    axes.set(xlabel="mended when given back, m")


def _label(row: Blamed) -> str:
    first, *others = row.group
    return shortened(first.line + (f" and {len(others)} more" if others else ""), 40)
