"""A figure of several sweeps: lines with 95 % intervals over the seeds."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import isfinite
from statistics import fmean, geometric_mean
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.overrides import parse_override
from scenarios.studies.many.statistics import geometric_mean_of, mean_of
from scenarios.studies.many.sweeps.axis import parsed_axes
from scenarios.studies.many.sweeps.cell_table import SweepRun, SweepTable
from scenarios.studies.many.sweeps.plan import SweepPlan

LEAST_VEHICLES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class FigurePanel:
    """One plot: its title, its axes, and a value to mark.

    With `is_log` the axis is logarithmic and the means of the seeds are geometric.
    """

    title: str
    x_label: str
    y_label: str
    is_log: bool = False
    bound: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FigurePoint:
    """A point of a line: mean over the seeds with its 95 % interval, from `count` runs of `runs`.

    Runs without the quantity do not count. The interval needs two of them.
    """

    panel: int
    series: str
    x: float
    runs: int
    count: int
    mean: float | None = None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureStudy:
    """Sweeps by label, the panels of the figure, and the points that the tables give."""

    name: str
    title: str
    sweeps: Mapping[str, SweepPlan]
    panels: Sequence[FigurePanel]
    points: Callable[[Mapping[str, SweepTable]], list[FigurePoint]]
    outcome: Callable[[Sequence[FigurePoint]], str]

    @property
    def runs(self) -> int:
        return sum(plan.runs for plan in self.sweeps.values())

    @property
    def commands(self) -> list[str]:
        """The sweeps as commands."""
        return [sweep_command(plan) for plan in self.sweeps.values()]


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureOptions:
    """Settings of a figure; an empty or missing one has the default of the figure.

    `vary` replaces values of its axes, as `KEY=START:STOP:STEP` or `KEY=a,b,c`; `sets` apply to all
    runs.
    """

    scenario: str = ""
    seeds: int | None = None
    vary: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()

    def vehicles(self, default: int) -> int:
        """Return the number of vehicles: that of `sets`, or the default of the figure.

        Raises ScenarioError for less than three: a string has two followers or more.
        """
        sets = {".".join(keys): value for keys, value in map(parse_override, self.sets)}
        given = sets.get("convoy.vehicles", default)
        if not isinstance(given, int) or given < LEAST_VEHICLES:
            allowed = f"allowed a whole number of at least {LEAST_VEHICLES}"
            raise ScenarioError([f"--set: convoy.vehicles: given {given}, {allowed}"])
        return given

    def settings(self, *defaults: str) -> tuple[str, ...]:
        """Return `sets`, and the defaults of the figure for keys that they lack."""
        given = {text.partition("=")[0].strip() for text in self.sets}
        kept = [text for text in defaults if text.partition("=")[0] not in given]
        return (*kept, *self.sets)

    def axes(self, *defaults: str) -> list[str]:
        """Return the axes of a figure with the values of `vary`; raises ScenarioError."""
        given = {
            axis.key: text for axis, text in zip(parsed_axes(self.vary), self.vary, strict=True)
        }
        known = {text.partition("=")[0]: text for text in defaults}
        if unknown := [key for key in given if key not in known]:
            allowed = ", ".join(known) or "none, the figure has no axis to vary"
            raise ScenarioError([f"--vary: given {unknown[0]}, allowed {allowed}"])
        return [given.get(key, text) for key, text in known.items()]


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureResult:
    """Points of a figure, the outcome in a line, and the sweeps as commands."""

    study: FigureStudy
    points: tuple[FigurePoint, ...]
    outcome: str

    def rows(self) -> list[dict[str, Any]]:
        panels = self.study.panels
        return [
            {"panel": panels[one.panel].title, "quantity": panels[one.panel].y_label}
            | {name: value for name, value in asdict(one).items() if name != "panel"}
            for one in self.points
        ]


def sweep_command(plan: SweepPlan) -> str:
    """Return the command with the same runs."""
    parts = ["convoy", "sweep", plan.base.name]
    parts += [f"--set={text}" for text in plan.base.overrides]
    parts += [f"--vary={axis.key}={','.join(axis.texts)}" for axis in plan.axes]
    parts += ["--seeds", str(plan.seeds)]
    parts += [f"--figure={figure.name}" for figure in plan.figures]
    return shlex.join(parts)


COLLISIONS = "events.collision"
"""Figure that each plan has, so that a series with collisions does not pass as a good one."""


def collisions_in(tables: Mapping[str, SweepTable]) -> str:
    """Name the sweeps with collisions, and in how many runs; empty without any."""
    parts = []
    for label, table in tables.items():
        runs = [run for cell in table.cells for run in cell.runs]
        collided = sum(bool(value_of(table, run, COLLISIONS)) for run in runs)
        if collided:
            parts.append(f"{label} ({collided} of {len(runs)} runs)")
    return f"; collisions: {', '.join(parts)}" if parts else ""


def value_of(table: SweepTable, run: SweepRun, figure: str) -> float | None:
    """Figure of a run by its name."""
    names = [one.name for one in table.plan.figures]
    return run.figures[names.index(figure)] if run.figures else None


def point(
    panel: int,
    series: str,
    x: float,
    values: Sequence[float | None],
    *,
    is_log: bool = False,
) -> FigurePoint:
    """Summarize the values of the seeds; those that are None do not count."""
    known = [value for value in values if value is not None and isfinite(value)]
    is_log = is_log and min(known, default=0.0) > 0.0
    whole = FigurePoint(panel=panel, series=series, x=x, runs=len(values), count=len(known))
    if not known:
        return whole
    if len(known) == 1:
        return replace(whole, mean=geometric_mean(known) if is_log else fmean(known))
    mean = geometric_mean_of(known) if is_log else mean_of(known)
    return replace(whole, mean=mean.value, low=mean.low, high=mean.high)
