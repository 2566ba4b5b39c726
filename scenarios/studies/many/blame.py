"""The smallest set of losses that still breaks the limit.

Delta debugging: Zeller and Hildebrandt, "Simplifying and isolating failure-inducing input", IEEE
Transactions on Software Engineering 28(2), 2002. Only complements are tested: subsets double the
number of tests and are not needed for a 1-minimal result (Hodován and Kiss, "Practical
improvements to the minimizing delta debugging algorithm", ICSOFT 2016).
"""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario
from scenarios.results.figure_style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, RED, SMALL_PT, STYLE
from scenarios.studies.engine import Engine
from scenarios.studies.job import write_files
from scenarios.studies.many.losses import (
    Burst,
    LossFreeScenario,
    LostMessage,
    RecordedRun,
    bursts_of,
    loss_free,
    read_run,
)
from scenarios.studies.many.trials import (
    MAX_ALONE,
    NEGLIGIBLE_M,
    Attribution,
    FigureName,
    RerunCriteria,
    RerunResult,
    Trials,
    losses_of,
    rank_losses,
    result_of,
    run_alone,
)
from scenarios.studies.workers import cores
from transport.log.errors import LogError
from vehicles.schedule import SECOND

Item = TypeVar("Item")
FirstFailing = Callable[[Sequence[tuple[Item, ...]]], int | None]
"""Returns the index of the first set with which the test fails, or None.

The result must not depend on the order of the tests.
"""


@dataclass(frozen=True, slots=True)
class SmallestSet(Generic[Item]):
    """The remaining items in their order.

    If `is_minimal`, the test passes as soon as any one item is removed.
    """

    items: tuple[Item, ...]
    is_minimal: bool


def ddmin(
    items: Sequence[Item],
    first_failing: FirstFailing[Item],
    is_exhausted: Callable[[], bool] = lambda: False,
) -> SmallestSet[Item]:
    """Remove items as long as the test, which fails with all of them, still fails.

    Removes chunks, at first of half the items, and halves their length when all were tried. Returns
    the current set once `is_exhausted`. The caller must know that the test passes without any
    items.
    """
    left = tuple(items)
    length = (len(left) + 1) // 2
    while len(left) > 1:
        before, start = left, 0
        while not is_exhausted():
            without = [left[:k] + left[k + length :] for k in range(start, len(left), length)]
            index = first_failing(list(filter(None, without)))
            if index is None:
                break
            left, start = without[index], start + index * length
        if is_exhausted():
            return SmallestSet(left, is_minimal=False)
        if length == 1 and left == before:
            break
        # Removed items can make others redundant, so single items are tried again.
        length = (length + 1) // 2
    return SmallestSet(left, is_minimal=True)


def smallest_set(
    trials: Trials, bursts: Sequence[Burst], rows: Sequence[Attribution]
) -> SmallestSet[LostMessage]:
    """Return the smallest set of losses that breaks the limit, which `bursts` break.

    Starts from the smallest row that breaks it alone, if any.
    """
    alone = [row for row in rows if row.alone is not None and trials.is_breach(row.alone)]
    start = min(alone, key=lambda row: (row.messages, row.span_s)).group if alone else bursts
    trials.engine.progress.stage = "reducing the set of messages"
    messages = [message for burst in start for message in burst.messages]

    def first_breaking(sets: Sequence[tuple[LostMessage, ...]]) -> int | None:
        return trials.first_breaking(list(map(frozenset, sets)))

    return ddmin(messages, first_breaking, lambda: trials.is_exhausted)


# ---- `convoy blame`: all steps in order


AFTER_NS = SECOND
"""Reruns continue this long after the worst instant: fewer losses may break the limit later."""
MAX_RUNS = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class BlameResult:
    """Results of the recorded run, of a run without losses, and of reruns.

    `best_restored` is the run with the first of the `rows` restored. `smallest` is None if the
    limit is kept or is broken without losses; `not_reduced_reason` is then the reason.
    """

    run: RecordedRun
    criteria: RerunCriteria
    convoy: LossFreeScenario
    recorded: RerunResult
    clean: RerunResult
    bursts: tuple[Burst, ...]
    rows: tuple[Attribution, ...]
    best_restored: RerunResult
    smallest: SmallestSet[LostMessage] | None = None
    smallest_result: RerunResult | None = None
    not_reduced_reason: str = ""
    runs: int = 0
    seconds: float = 0.0


def blame(
    log: Path, limit: Limit, figure: FigureName, engine: Engine, *, max_runs: int = MAX_RUNS
) -> BlameResult:
    """Find the losses that caused the worst figure of a log and the breach of `limit`.

    Raises LogError if the log is unusable, or if its losses do not reproduce the run.
    """
    run = read_run(log)
    criteria = RerunCriteria(figure=figure, limit=limit)
    recorded = result_of(run.tables, criteria, whole=True)
    if not recorded.vehicle:
        raise LogError(f"{log}: has no true {figure} of a follower")
    breach_at = recorded.broken_at or 0
    trials = Trials(
        convoy=loss_free(run),
        criteria=replace(criteria, until=max(recorded.worst_at, breach_at) + AFTER_NS),
        breaks_by=breach_at + AFTER_NS,
        engine=engine,
        parallel=cores(),
        max_runs=max_runs,
    )
    bursts = bursts_of(run.lost(trials.criteria.until))
    if not bursts:
        until_s = trials.criteria.until / SECOND
        raise LogError(
            f"{log}: no message was lost until {until_s:.2f} s, one second after the worst {figure}"
        )
    trials.engine.progress.stage = "repeating the run, with and without its losses"
    again, clean = trials.results([losses_of(bursts), frozenset()], whole=True)
    _check_same(run, result_of(run.tables, trials.criteria, whole=True), again)
    trials.engine.progress.stage = "restoring bursts"
    rows = rank_losses(trials, bursts, recorded, recorded.badness_m - clean.badness_m)
    trials.engine.progress.stage = "losing single bursts only"
    run_alone(trials, rows)
    not_reduced_reason = _reason_not_reduced(recorded, clean, limit)
    smallest = None if not_reduced_reason else smallest_set(trials, bursts, rows)
    trials.engine.progress.stage = "simulating the plotted runs"
    (best_restored,) = trials.results([losses_of(bursts) - rows[0].losses], whole=True)
    smallest_results = (
        trials.results([frozenset(smallest.items)], whole=True) if smallest else [None]
    )
    return BlameResult(
        run=run,
        criteria=trials.criteria,
        convoy=trials.convoy,
        recorded=recorded,
        clean=clean,
        bursts=bursts,
        rows=tuple(rows),
        best_restored=best_restored,
        smallest=smallest,
        smallest_result=smallest_results[0],
        not_reduced_reason=not_reduced_reason,
        runs=trials.runs,
        seconds=engine.progress.seconds,
    )


def _check_same(run: RecordedRun, recorded: RerunResult, again: RerunResult) -> None:
    """Raise LogError unless a rerun with the same losses has the same figures at all instants."""
    differences = [
        (min(before[0], after[0]), name)
        for name, points in again.series.items()
        for before, after in zip(recorded.series[name], points, strict=False)
        if before != after
    ]
    if differences:
        at_s, vehicle = min(differences)
        late = f" ({run.late} messages were late)" if run.late else ""
        raise LogError(
            f"{run.log}: not reproducible: in a rerun, {vehicle} differs from {at_s:.2f} s "
            f"on{late}; use the log of a run with `--clock virtual`"
        )


def _reason_not_reduced(recorded: RerunResult, clean: RerunResult, limit: Limit) -> str:
    if recorded.broken_at is None:
        return f"the limit {limit} was not broken: no set of losses to reduce"
    if clean.broken_at is not None:
        return f"the limit {limit} is broken without any loss: no set of losses to reduce"
    return ""


# ---- Files of `convoy blame`: a plot, JSON, and the smallest set as a scenario


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
