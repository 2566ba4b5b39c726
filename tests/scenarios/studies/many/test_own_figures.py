"""Figures of the user's classes in limits, sweeps, searches and comparisons."""

from collections.abc import Callable
from functools import partial

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit, limits_of
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.results.limits import broken_by
from scenarios.results.summary import RunSummary
from scenarios.studies.comparison.metrics import metric_differences
from scenarios.studies.many.plan import figures_of, planned
from scenarios.studies.many.variant import Variant, limited_variant

CODE = """
from dataclasses import dataclass

class Scaled:
    @dataclass
    class Settings:
        factor: float = 1.0

    def __init__(self, settings):
        self.factor, self.last = settings.factor, None

    def add(self, pose):
        self.last = self.factor * pose.distance_m

    def value(self):
        return self.last

class Faulty(Scaled):
    def add(self, pose):
        1 / (pose.seq - 20)

class Ebbing(Scaled):
    def value(self):
        return None if self.last is None else 4.0 - self.last
"""
Module = Callable[[str], str]


def variant(name: str, limit: str = "lane", *more: str) -> tuple[Variant, Limit]:
    figures = f"figure=[{{use='{name}.Scaled',factor=0.5}},'{name}.Ebbing']"
    sets = ["convoy.vehicles=2", "duration_s=0.5", figures, *more]
    return limited_variant("lane_change", sets, limit)


def test_limits_bound_own_figures_of_the_convoy_and_of_a_vehicle(module: Module) -> None:
    bounds = "limits.own_figures={Scaled_max=100,Scaled_min=0.1}"
    of_one = "limits.v1.own_figures.Scaled_max=0.1"
    run, _ = variant(module(CODE), "lane", bounds, of_one)
    assert [one.name for one in limits_of(run.scenario.tables.limits)] == [
        "own_figures.Scaled_max", "own_figures.Scaled_min", "v1.own_figures.Scaled_max",
    ]  # fmt: skip
    summary = run.run()
    halves = {row.name: row.distance_m / 2 for row in summary.vehicles}
    assert [(one.limit, one.vehicle, one.value, one.broken) for one in summary.limits] == [
        ("own_figures.Scaled_max", "v2", halves["v2"], False),
        ("own_figures.Scaled_min", "v1", halves["v1"], False),
        ("own_figures.Scaled_min", "v2", halves["v2"], False),
        ("v1.own_figures.Scaled_max", "v1", halves["v1"], True),
    ]
    assert summary.reason.startswith("limits.v1.own_figures.Scaled_max = 0.1: v1 had Scaled ")


@pytest.mark.parametrize(
    ("limit", "broken"),
    [
        ("Scaled_max=100", False), ("Scaled_max=0.1", True), ("Scaled_min=100", True),
        ("v2.Scaled_max=0.1", True), ("v1.Scaled_min=0.1", False), ("Ebbing_max=0", False),
    ],
)  # fmt: skip
def test_searches_judge_own_figures_at_the_end(module: Module, limit: str, broken: bool) -> None:
    run, parsed = variant(module(CODE), limit)
    assert str(parsed) == limit
    summary = run.run()
    assert (broken_by(parsed, summary), run.breaks(parsed)) == (broken, broken)


def test_sweeps_and_comparisons_have_own_figures(module: Module) -> None:
    name = module(CODE)
    run, _ = variant(name)
    plan = planned(
        "lane_change",
        vary=["figure.0.factor=0.5,2"],
        seeds=1,
        sets=run.overrides,
        metrics=["own_figures.Scaled", "v2.own_figures.Scaled"],
        limits=["Scaled_max=10"],
    )
    cells = [figures_of(plan.variants(cell)[0], plan.figures, plan.limits) for cell in plan.cells]
    (low, of_v2), (high, _) = (cell["figures"] for cell in cells)
    assert high == 4.0 * low
    assert of_v2 <= low < 10.0 < high
    assert [cell["broken"] for cell in cells] == [[False], [True]]
    summaries: list[RunSummary] = [plan.variants(cell)[0].run() for cell in plan.cells]
    (found,) = (
        one
        for one in metric_differences("B", summaries[:1], summaries[1:], 1e-9)[1]
        if one.name == "v2.own_figures.Scaled"
    )
    assert (found.a, found.b, found.is_main) == (of_v2, 4.0 * of_v2, True)
    with pytest.raises(ScenarioError, match=r"similar: own_figures\.Scaled"):
        planned("lane_change", vary=[], seeds=1, sets=run.overrides, metrics=["Scaled"])


def test_a_figure_that_fails_is_not_judged(module: Module) -> None:
    name = module(CODE)
    own = f"figure=['{name}.Faulty']"
    run, limit = variant(name, "Faulty_max=1", own, "limits.own_figures.Faulty_max=1")
    summary = run.run()
    assert [(one.value, one.judged, one.broken) for one in summary.limits] == 2 * [
        (None, False, True)
    ]
    assert summary.outcome == "failed"
    for breaks in (run.breaks, partial(broken_by, summary=summary)):
        with pytest.raises(PlugInError, match="Faulty_max=1: v1 has no figure Faulty"):
            breaks(limit)
    assert any("v1: figure" in line and "ZeroDivisionError" in line for line in summary.warnings)
