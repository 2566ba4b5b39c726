"""Small sweeps give the same bytes when resumed, on several executors, and with errors."""

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.versions import _module_digest
from scenarios.studies.many.files import run_sweep
from scenarios.studies.many.plan import DEFAULT_FIGURE, planned
from scenarios.studies.workers import WorkerGroup
from tests.made.many.small_sweeps import SETS, run_sweep_here, small_plan, tables


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sweep")
    run_sweep_here(small_plan(), out)
    return out


def test_each_run_equals_that_of_its_variant(whole: Path) -> None:
    plan = small_plan()
    runs = json.loads((whole / "sweep.json").read_text())["runs"]
    for place, seed in ((0, 1), (3, 2)):
        variant = plan.variants(plan.cells[place])[seed - 1]
        summary = variant.run()
        run = runs[2 * place + seed - 1]
        assert run["command"] == variant.command
        errors = [row.cross_track_error_m_max for row in summary.vehicles[1:]]
        assert run["cross_track_error_m_max"] == max(filter(None, errors))
    figures = {run[DEFAULT_FIGURE] for run in runs}
    assert len(figures) == plan.runs, "all runs differ"


def test_seeds_are_shared_between_cells() -> None:
    plan = small_plan()
    seeds = [[one.seed for one in plan.variants(cell)] for cell in plan.cells]
    assert seeds == [[1, 2]] * 4


@pytest.mark.parametrize("place", ["set", "vary"])
def test_a_changed_controller_or_file_is_another_sweep(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    law = "from vehicles.driver.steering import Stanley\nclass Mine(Stanley):\n    sign = {}\n"
    losses = tmp_path / "losses.csv"
    settings = [
        f"control.controller=law_of_{place}.Mine",
        f'links.loss={{kind="pattern", file="{losses}"}}',
    ]
    sets, vary = (settings, ["convoy.gap_m=3,10"]) if place == "set" else ([], settings)
    identities = []
    for sign, received in ((1, 0), (-1, 0), (-1, 1)):
        (tmp_path / f"law_of_{place}.py").write_text(law.format(sign))
        losses.write_text(f"number,received\n0,1\n1,{received}\n")
        _module_digest.cache_clear()  # as in another process
        identities.append(planned("lane_change", vary=vary, seeds=1, sets=sets).identity())
    first, second, third = identities
    assert first["plug_ins"] != second["plug_ins"]
    assert first | {"plug_ins": {}} == second | {"plug_ins": {}}
    assert second["plug_ins"] == third["plug_ins"]
    assert second != third


@contextmanager
def three_threads() -> Iterator[WorkerGroup]:
    with ThreadPoolExecutor(3) as pool:
        yield WorkerGroup(executor=pool, slots=lambda: 5)


def test_another_executor_gives_the_same_tables(whole: Path, tmp_path: Path) -> None:
    run_sweep(small_plan(), tmp_path, three_threads, lambda _: None)
    assert tables(tmp_path) == tables(whole)


def test_an_error_is_counted_in_its_cell(tmp_path: Path) -> None:
    vary = ("convoy.vehicles=3,2", "vehicle={},{v3={clock={offset_ms=3.0}}}")
    plan = planned("lane_change", vary=vary, seeds=1, sets=SETS[:1], limits=["lane"])
    table = run_sweep_here(plan, tmp_path)
    assert [cell.errors for cell in table.cells] == [0, 0, 0, 1]
    run = table.cells[3].runs[0]
    assert "vehicle.v3: no such vehicle, allowed v1, v2" in run.error
    assert run.figures == ()
    assert "vehicle.v3: no such vehicle" in (tmp_path / "runs.csv").read_text()
    before = tables(tmp_path)
    run_sweep_here(plan, tmp_path)
    assert tables(tmp_path) == before


def test_other_files_are_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "runs.csv").write_text("mine")
    with pytest.raises(ScenarioError, match=r"runs.csv: exists; give another folder by --out$"):
        run_sweep_here(small_plan(), tmp_path)
    assert (tmp_path / "runs.csv").read_text() == "mine"
    assert len(list(tmp_path.iterdir())) == 1


CUT = "change=[{kind='cut', at_s=0.1, for_s=0.1}]"


@pytest.mark.parametrize(
    ("given", "fact"),
    [
        ({"vary": ["links.loss_ratio=0:1.2:0.3"]}, "--vary: links.loss_ratio: given 1.2, allowed"),
        ({"vary": ["links.loss_ratio=0..0.5"]}, "START:STOP:STEP, such as 0:0.5:0.1"),
        ({"vary": ["links.los_ratio=0,1"]}, "unknown key, did you mean links.loss_ratio?"),
        ({"vary": ["convoy.gap_m=3,10", "convoy.vehicles=2,none"]}, "--vary: convoy.vehicles: giv"),
        (
            {"vary": ["convoy.gap_m=3,10"], "sets": ["convoy.gap_m=4"]},
            "--vary: convoy.gap_m: given by --set",
        ),
        ({"vary": [], "sets": ["convoy.gap_m=no"]}, "--set: convoy.gap_m: given"),
        ({"vary": [], "limits": ["lanes"]}, "--limit: given 'lanes', allowed"),
        ({"vary": [], "metrics": ["v9.distance_m"]}, "--metric: unknown metric 'v9.distance_m'"),
        (
            {"vary": ["change.0.at_s=1,2"]},
            "--vary: change.0.at_s: given index 0 of change, which has no entries",
        ),
        (
            {"vary": ["change.1.at_s=1,2"], "sets": [CUT]},
            "--vary: change.1.at_s: given index 1 of change, allowed 0",
        ),
        ({"vary": ["convoy.gap_m=6:900:1"], "seeds": 1000}, "given 895000 runs, allowed 100000"),
    ],
)
def test_invalid_sweeps_are_refused_before_anything_runs(
    given: dict[str, list[str]], fact: str
) -> None:
    with pytest.raises(ScenarioError) as error:
        planned("lane_change", **({"seeds": 2} | given))  # type: ignore[arg-type]
    (line,) = error.value.lines
    assert fact in line


def test_a_key_of_a_list_entry_varies() -> None:
    times = "change[0].at_s=0.2,0.4"
    for sets, vary in (([CUT], [times]), ([], [CUT, times])):
        plan = planned("lane_change", vary=vary, seeds=1, sets=sets)
        cuts = [plan.variants(cell)[0].scenario.tables.change[0] for cell in plan.cells]
        assert [(one.kind, one.at_s) for one in cuts] == [("cut", 0.2), ("cut", 0.4)]
        assert plan.axes[-1].key == "change.0.at_s"
