"""Files of `convoy blame`: a plot, JSON, and the smallest set as a scenario.

Needs matplotlib.
"""

import shlex
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.definition.scenario import Scenario
from scenarios.studies.engine.results import write_files
from scenarios.studies.many.blame.losses import Burst, bursts_of
from scenarios.studies.many.blame.ranking import MAX_ALONE, NEGLIGIBLE_M, Attribution
from scenarios.studies.many.blame.rerun import RerunResult
from scenarios.studies.many.blame.study import BlameResult
from scenarios.studies.picture_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    RED,
    SMALL_PT,
    STYLE,
)
from vehicles.schedule import SECOND

SCHEMA = "convoy.blame/1"
PICTURE, JSON_FILE, SMALLEST = "blame", "blame.json", "smallest.toml"
FIELDS = {"error": "cross_track_error_m_max", "gap": "true_gap_m_min"}
"""Summary fields of the figures."""
GROUPING = (
    "A burst is a series of consecutive messages lost on one link. An overlap is a set of bursts "
    "that overlap in time. Groups were restored half by half. Only halves that change the figure "
    f"by at least {NEGLIGIBLE_M:g} m, alone or together, were divided further."
)


def smallest_scenario(blame: BlameResult) -> Scenario | None:
    """Return the scenario that loses only the smallest set, with the limit."""
    if blame.smallest is None:
        return None
    lines = ", ".join(burst.line for burst in bursts_of(blame.smallest.items))
    count, seed = len(blame.smallest.items), blame.run.scenario.seed
    description = f"{blame.run.scenario.name}, seed {seed}: {count} messages lost, {lines}"
    return blame.convoy.smallest(
        blame.smallest.items, blame.criteria.limit, _shortened(description)
    )


def _shortened(text: str, most: int = 200) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def command_of(out: Path) -> str:
    return shlex.join(["convoy", "run", str(out / SMALLEST), "--clock", "virtual"])


def write_report(blame: BlameResult, out: Path, picture_format: str = "png") -> list[Path]:
    """Write picture, JSON, and the scenario of the smallest set if there is one."""
    contents: dict[str, Any] = {
        f"{PICTURE}.{picture_format}": drawn(blame),
        JSON_FILE: machine_readable(blame, out),
    }
    scenario = smallest_scenario(blame)
    if scenario is not None:
        head = (
            f"# Written by `convoy blame {shlex.quote(str(blame.run.log))}`.\n"
            f"# The losses listed below break the limit {blame.criteria.limit}.\n"
        )
        contents[SMALLEST] = f"{head}#\n#   {command_of(out)}\n\n{scenario.text}"
    return write_files(out, contents)


def machine_readable(blame: BlameResult, out: Path) -> dict[str, Any]:
    run = blame.run
    lost = [message for burst in blame.bursts for message in burst.messages]
    return {
        "schema": SCHEMA,
        "log": str(run.log),
        "scenario": run.scenario.name,
        "seed": run.scenario.seed,
        "limit": str(blame.criteria.limit),
        "figure": FIELDS[blame.criteria.figure],
        "until_s": blame.criteria.until / SECOND,
        "recorded": _result_fields(blame.recorded),
        "without_loss": _result_fields(blame.clean),
        "considered_messages": len(lost),
        "considered_bursts": len(blame.bursts),
        "grouping": GROUPING,
        "lost_alone_rows_max": MAX_ALONE,
        "rows": [_row(row) for row in blame.rows],
        "smallest": _smallest(blame, out),
        "not_reduced_reason": blame.not_reduced_reason,
        "runs": blame.runs,
    }


def _result_fields(result: RerunResult) -> dict[str, Any]:
    broken = result.broken_at
    return {
        "figure_m": result.figure_m,
        "vehicle": result.vehicle,
        "worst_at_s": result.worst_at / SECOND,
        "broken_at_s": None if broken is None else broken / SECOND,
    }


def _burst(burst: Burst) -> dict[str, Any]:
    (sender, receiver), (from_s, to_s) = burst.link, burst.span_s
    return {
        "sender": sender,
        "receiver": receiver,
        "numbers": list(burst.numbers),
        "from_s": from_s,
        "to_s": to_s,
        "messages": len(burst.messages),
    }


def _row(row: Attribution) -> dict[str, Any]:
    return {
        "kind": row.kind,
        "messages": row.messages,
        "reduction_m": row.reduction_m,
        "alone": None if row.alone is None else _result_fields(row.alone),
        "bursts": [_burst(burst) for burst in row.group],
    }


def _smallest(blame: BlameResult, out: Path) -> dict[str, Any] | None:
    if blame.smallest is None or blame.smallest_result is None:
        return None
    return {
        "file": SMALLEST,
        "command": command_of(out),
        "messages": len(blame.smallest.items),
        "is_minimal": blame.smallest.is_minimal,
        "bursts": [_burst(burst) for burst in bursts_of(blame.smallest.items)],
        **_result_fields(blame.smallest_result),
    }


# ---- The plot: the run with other losses, and the effect of each burst

MOST_BARS = 8
LABELS = {"error": "true error", "gap": "true gap"}


@mpl.rc_context(STYLE)
def drawn(blame: BlameResult) -> Figure:
    """Draw the figure of the worst vehicle over time, and metres for each row."""
    figure = Figure(figsize=(PAGE_IN, 3.2), layout="constrained")
    over_time, bars = figure.subplots(1, 2, width_ratios=(3, 2))
    _over_time(over_time, blame)
    _bars(bars, blame)
    handles, labels = over_time.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _over_time(axes: Axes, blame: BlameResult) -> None:
    runs: list[tuple[str, RerunResult | None, str, str]] = [
        ("as recorded", blame.recorded, RED, "-"),
        ("worst burst restored", blame.best_restored, BLUE, "-"),
        ("only the smallest set lost", blame.smallest_result, ORANGE, "--"),
        ("nothing lost", blame.clean, GREEN, "-"),
    ]
    until_s = blame.criteria.until / SECOND
    for label, result, colour, line in runs:
        if result is not None:
            points = [one for one in result.series[blame.recorded.vehicle] if one[0] <= until_s]
            instants, values = [at for at, _ in points], [value for _, value in points]
            axes.plot(instants, values, color=colour, linestyle=line, label=label)
    if blame.rows:
        for number, burst in enumerate(blame.rows[0].group):
            axes.axvspan(*burst.span_s, color=GREY, alpha=0.2, linewidth=0.0,
                         label="" if number else "worst burst")  # fmt: skip
    _bound(axes, blame)
    what = LABELS[blame.criteria.figure]
    axes.set(xlabel="time, s", ylabel=f"{what} of {blame.recorded.vehicle}, m")


def _bound(axes: Axes, blame: BlameResult) -> None:
    """Draw the limit, if it applies to the figure drawn."""
    limit = blame.criteria.limit
    applies = limit.vehicle in {"", blame.recorded.vehicle}
    if applies and limit.row.live == blame.criteria.figure and limit.row.figure:
        axes.axhline(limit.bound, color=GREY, linewidth=0.9, linestyle=":")


def _bars(axes: Axes, blame: BlameResult) -> None:
    rows = list(reversed(blame.rows[:MOST_BARS]))
    axes.barh(range(len(rows)), [max(row.reduction_m, 0.0) for row in rows], color=BLUE)
    axes.set_yticks(range(len(rows)), [_bar_label(row) for row in rows], fontsize=SMALL_PT)
    axes.grid(visible=False, axis="y")
    axes.set(xlabel="gain if restored, m")


def _bar_label(row: Attribution) -> str:
    span = "{:.2f}-{:.2f} s".format(*row.span_s)
    if len(row.group) == 1:
        return _shortened(f"{row.group[0].line}, {span}", 32)
    return f"{len(row.group)} bursts, {span}"
