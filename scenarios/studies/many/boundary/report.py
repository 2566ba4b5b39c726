"""The files of `convoy bisect`: the picture, and all figures as JSON. Needs matplotlib."""

from dataclasses import asdict
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from scenarios.studies.engine.results import write_files
from scenarios.studies.many.boundary.answer import BoundaryAnswer, BoundaryQuestion
from scenarios.studies.picture_style import BLUE, GREY, ORANGE, RED, STYLE

SCHEMA = "convoy.bisect/1"
PICTURE, TWIN = "boundary.png", "bisect.json"
SIZE = (6.4, 3.8)


def write_answer(question: BoundaryQuestion, answer: BoundaryAnswer, out: Path) -> list[Path]:
    whole = {
        "schema": SCHEMA,
        "scenario": question.variant.name,
        "overrides": list(question.variant.overrides),
        "key": question.key,
        "limit": str(question.limit),
        "range": [question.low, question.high],
        "to": question.to,
        "share": question.share,
        "seeds": list(range(1, question.seeds + 1)),
        **asdict(answer),
    }
    return write_files(out, {PICTURE: drawn(question, answer), TWIN: whole})


@mpl.rc_context(STYLE)
def drawn(question: BoundaryQuestion, answer: BoundaryAnswer) -> Figure:
    """Draw the share of broken runs over the value, with intervals, and the bracket."""
    points = answer.points
    values = [one.value for one in points]
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    sure_low = question.low if answer.sure_low is None else answer.sure_low
    sure_high = question.high if answer.sure_high is None else answer.sure_high
    if question.share > 0.0:
        axes.axvspan(sure_low, sure_high, color=ORANGE, alpha=0.15, linewidth=0,
                     label="the boundary is here, 95 %")  # fmt: skip
        axes.axhline(question.share, color=GREY, linewidth=0.9, linestyle=":")
    axes.axvspan(answer.low, answer.high, color=RED, alpha=0.55, linewidth=0,
                 label=f"{answer.low:g} to {answer.high:g}")  # fmt: skip
    below = [one.share - one.low for one in points]
    above = [one.high - one.share for one in points]
    axes.errorbar(values, [one.share for one in points], yerr=[below, above], fmt="o-",
                  color=BLUE, markersize=4.0, elinewidth=0.9, capsize=2.0, linewidth=1.0,
                  label="runs, with Wilson's interval")  # fmt: skip
    for one in points:
        axes.annotate(f"{one.broken}/{one.runs}", (one.value, one.share), xytext=(4, 5),
                      textcoords="offset points", fontsize=6.5, color=GREY)  # fmt: skip
    margin = 0.03 * (question.high - question.low)
    axes.set(ylim=(-0.03, 1.08), xlim=(question.low - margin, question.high + margin))
    axes.set_xlabel(question.key)
    axes.set_ylabel(f"share of runs that break {question.limit}")
    axes.set_title(f"{question.variant.name}, {question.seeds} seeds")
    axes.legend(loc="upper left")
    return figure
