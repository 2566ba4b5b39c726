"""The runs of a sweep, with the figures and limits to evaluate."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.extends import merged
from scenarios.definition.library import ScenarioFile
from scenarios.definition.overrides import OverrideError, override, parse_override, value_at
from scenarios.definition.run_limits import Limit, parsed_limit
from scenarios.definition.scenario import Scenario
from scenarios.results.limits.evaluation import broken_by
from scenarios.studies.engine.job import Job
from scenarios.studies.many.sweeps.axis import SweepAxis, cells, parsed_axes
from scenarios.studies.many.sweeps.figure import SweepFigure, parsed_figure
from scenarios.studies.many.variant import Variant, identity_of, variant_of

DEFAULT_FIGURE = "cross_track_error_m_max"
MAX_RUNS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPlan:
    """A scenario, the keys that vary, the seeds 1 to `seeds`, the figures and limits.

    A seed gives the same random numbers in every cell. `base` is the scenario with the overrides of
    all runs.
    """

    base: Variant
    axes: tuple[SweepAxis, ...]
    seeds: int
    figures: tuple[SweepFigure, ...]
    limits: tuple[Limit, ...]
    plug_ins: tuple[str, ...] = ()
    """Controllers of all runs."""
    contents: str = ""
    """Digest of the scenarios of all values, with the files that they name."""

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """The overrides of each cell, one per axis."""
        return cells(self.axes)

    @property
    def runs(self) -> int:
        return len(self.cells) * self.seeds

    def variants(self, cell: Sequence[str]) -> list[Variant]:
        overrides = (*self.base.overrides, *cell)
        return [
            replace(self.base, overrides=overrides, seed=seed) for seed in range(1, self.seeds + 1)
        ]

    def jobs(self) -> list[Job]:
        return [
            Job(
                key=run_key(place, variant.seed),
                work=partial(figures_of, variant, self.figures, self.limits),
                command=variant.command,
            )
            for place, cell in enumerate(self.cells)
            for variant in self.variants(cell)
        ]

    def identity(self) -> dict[str, Any]:
        return identity_of(
            self.base,
            self.plug_ins,
            vary=[f"{axis.key}={','.join(axis.texts)}" for axis in self.axes],
            seeds=self.seeds,
            metric=[figure.name for figure in self.figures],
            limit=[str(limit) for limit in self.limits],
        ) | {"contents digest": self.contents}


def run_key(cell: int, seed: int) -> str:
    return f"{cell}/{seed}"


def figures_of(
    variant: Variant, figures: Sequence[SweepFigure], limits: Sequence[Limit]
) -> dict[str, Any]:
    """Simulate a run; return its journal entry, in the order of figures and limits."""
    summary = variant.run()
    return {
        "outcome": summary.outcome,
        "reason": summary.reason,
        "figures": [figure.of(summary) for figure in figures],
        "broken": [broken_by(limit, summary) for limit in limits],
    }


def planned(
    name: str,
    *,
    vary: Sequence[str],
    seeds: int,
    sets: Sequence[str] = (),
    metrics: Sequence[str] = (),
    limits: Sequence[str] = (),
) -> SweepPlan:
    """Build a sweep from the texts of the command line.

    Each value of each key is validated with the first values of the other keys. Raises
    ScenarioError with a line for each problem.
    """
    axes = parsed_axes(vary)
    fixed = {text.partition("=")[0].strip() for text in sets}
    if both := [axis.key for axis in axes if axis.key in fixed]:
        raise ScenarioError([f"--vary: {both[0]}: given by --set as well; use one of them"])
    plan = SweepPlan(
        base=variant_of(name, sets),
        axes=axes,
        seeds=seeds,
        figures=(),
        limits=(),
    )
    if plan.runs > MAX_RUNS:
        raise ScenarioError([f"{name}: given {plan.runs} runs, allowed {MAX_RUNS}"])
    _refuse_missing_entries(plan)
    scenarios = list(_scenarios(plan))
    vehicles = max((scenario.vehicle_names for scenario in scenarios), key=len)
    own = tuple(dict.fromkeys(name for scenario in scenarios for name in scenario.own_figures))
    pairs = dict.fromkeys(pair for scenario in scenarios for pair in scenario.links)
    digests = " ".join(scenario.digest for scenario in scenarios)
    names = dict.fromkeys(metrics or [DEFAULT_FIGURE])
    return replace(
        plan,
        plug_ins=tuple(sorted({name for one in scenarios for name in one.plug_ins})),
        contents=sha256(digests.encode()).hexdigest()[:12],
        figures=tuple(parsed_figure(text, vehicles, own, pairs) for text in names),
        limits=tuple(dict.fromkeys(parsed_limit(text, vehicles, own) for text in limits)),
    )


def refuse_picture(plan: SweepPlan) -> None:
    """Raise ScenarioError if the keys of a sweep cannot be drawn."""
    axes = plan.axes
    if len(axes) not in {1, 2}:
        wrong = f"{len(axes) or 'no'} keys vary, a picture needs one or two; fix others by --set"
    elif len(axes) == 2 and not any(axis.numbers for axis in axes):
        wrong = f"neither {axes[0].key} nor {axes[1].key} has only numbers, a picture needs one"
    else:
        return
    raise ScenarioError([f"--output: {wrong}"])


def _refuse_missing_entries(plan: SweepPlan) -> None:
    """Raise ScenarioError for a key inside a list entry that neither scenario nor axes have."""
    base = plan.base
    tables = merged(ScenarioFile(base.name, Path(), base.text), base.overrides).raw
    for axis in plan.axes:
        try:
            value_at(tables, axis.key)
            override(tables, *parse_override(axis.overrides[0]))
        except OverrideError as error:
            raise ScenarioError([f"--vary: {axis.key}: {error}"]) from error


def _scenarios(plan: SweepPlan) -> Iterator[Scenario]:
    """Load the first run of each value."""
    first = [axis.overrides[0] for axis in plan.axes]
    combinations = [first] + [
        [*first[:index], override, *first[index + 1 :]]
        for index, axis in enumerate(plan.axes)
        for override in axis.overrides[1:]
    ]
    for cell in combinations:
        try:
            yield plan.variants(cell)[0].scenario
        except ScenarioError as error:
            raise ScenarioError(_as_varied(line, plan.axes) for line in error.lines) from error


def _as_varied(line: str, axes: Sequence[SweepAxis]) -> str:
    """Name the option that holds the refused value."""
    by_set = "--set: "
    if any(line.startswith(f"{by_set}{axis.key}") for axis in axes):
        return line.replace(by_set, "--vary: ", 1)
    return line
