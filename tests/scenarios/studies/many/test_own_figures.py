"""Metrics of the user's functions in limits, sweeps, searches and comparisons."""

from collections.abc import Callable

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit, limits_of
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.results.summary import RunSummary
from scenarios.studies.comparison.metrics import metric_differences
from scenarios.studies.many.plan import figures_of, planned
from scenarios.studies.many.variant import Variant, limited_variant

CODE = """
def scaled(run, factor=1.0):
    return {name: factor * run.table(name, "truth")["distance_m"][-1] for name in run.names}

def ebbing(run):
    return {name: 4.0 - distance for name, distance in scaled(run).items()}

def faulty(run):
    return 1 / 0
"""
Module = Callable[[str], str]


def variant(name: str, limit: str = "lane", *more: str) -> tuple[Variant, Limit]:
    figures = f"figure=[{{use='{name}.scaled',factor=0.5}},'{name}.ebbing']"
    sets = ["convoy.vehicles=2", "duration_s=0.5", figures, *more]
    return limited_variant("lane_change", sets, limit)


def test_limits_bound_own_figures_of_the_convoy_and_of_a_vehicle(module: Module) -> None:
    bounds = "limits.own_figures={scaled_max=100,scaled_min=0.1}"
    of_one = "limits.v1.own_figures.scaled_max=0.1"
    run, _ = variant(module(CODE), "lane", bounds, of_one)
    assert [one.name for one in limits_of(run.scenario.tables.limits)] == [
        "own_figures.scaled_max", "own_figures.scaled_min", "v1.own_figures.scaled_max",
    ]  # fmt: skip
    summary = run.run()
    halves = {row.name: row.distance_m / 2 for row in summary.vehicles}
    assert [(one.limit, one.vehicle, one.value, one.broken) for one in summary.limits] == [
        ("own_figures.scaled_max", "v2", halves["v2"], False),
        ("own_figures.scaled_min", "v1", halves["v1"], False),
        ("own_figures.scaled_min", "v2", halves["v2"], False),
        ("v1.own_figures.scaled_max", "v1", halves["v1"], True),
    ]
    assert summary.reason.startswith("limits.v1.own_figures.scaled_max = 0.1: v1 had scaled ")


@pytest.mark.parametrize(
    ("limit", "broken"),
    [
        ("scaled_max=100", False), ("scaled_max=0.1", True), ("scaled_min=100", True),
        ("v2.scaled_max=0.1", True), ("v1.scaled_min=0.1", False), ("ebbing_max=0", False),
    ],
)  # fmt: skip
def test_searches_judge_own_figures_at_the_end(module: Module, limit: str, broken: bool) -> None:
    run, parsed = variant(module(CODE), limit)
    assert str(parsed) == limit
    assert run.breaks(parsed) == broken


def test_sweeps_and_comparisons_have_own_figures(module: Module) -> None:
    name = module(CODE)
    run, _ = variant(name)
    plan = planned(
        "lane_change",
        vary=["figure.0.factor=0.5,2"],
        seeds=1,
        sets=run.overrides,
        metrics=["own_figures.scaled", "v2.own_figures.scaled"],
        limits=["scaled_max=10"],
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
        if one.name == "v2.own_figures.scaled"
    )
    assert (found.a, found.b, found.is_main) == (of_v2, 4.0 * of_v2, True)
    with pytest.raises(ScenarioError, match=r"similar: own_figures\.scaled"):
        planned("lane_change", vary=[], seeds=1, sets=run.overrides, metrics=["scaled"])


def test_a_figure_that_fails_is_not_judged(module: Module) -> None:
    name = module(CODE)
    own = f"figure=['{name}.faulty']"
    run, limit = variant(name, "faulty_max=1", own, "limits.own_figures.faulty_max=1")
    summary = run.run()
    assert [(one.value, one.judged, one.broken) for one in summary.limits] == 2 * [
        (None, False, True)
    ]
    assert summary.outcome == "failed"
    with pytest.raises(PlugInError, match="faulty_max=1: v1 has no figure faulty"):
        run.breaks(limit)
    assert any("figure" in line and "ZeroDivisionError" in line for line in summary.warnings)
