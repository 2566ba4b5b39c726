"""Random cuts of links on all roads, with path history and without.

`pytest --campaign` simulates 1000 cuts with each.
"""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest

from scenarios.definition.road.route import longest_run
from scenarios.definition.scenario import scenario_from_text
from scenarios.definition.schema.change_tables import CutTable
from scenarios.studies.cuts import campaign
from scenarios.studies.cuts.campaign import JSON_FILE, VARIANTS, draw_cuts, failures, run_cuts
from scenarios.studies.cuts.cut import AFTERWARDS_S, LINKS, LinkCut, Variant
from scenarios.studies.cuts.cut_figures import run_cut
from scenarios.studies.cuts.roads import ROADS, Road
from scenarios.studies.cuts.run_figures import figures_of_runs
from scenarios.studies.engine.engine import study_engine
from scenarios.studies.engine.workers import open_workers

ALL = 1000
HISTORY: tuple[Variant, ...] = VARIANTS["history"]
PAIRS = list(zip(*(draw_cuts(ALL, one) for one in HISTORY), strict=True))
DRAWN = [pair[(number + turn) % 2] for turn in (0, 1) for number, pair in enumerate(PAIRS)]
CASES = sorted(DRAWN, key=lambda cut: cut.vehicles > 3)
"""All cuts with each variant, first the cheapest convoys, with the variants in turn."""
SHORT = LinkCut(variant="hold", speed_mps=8.0, at_s=1.0, for_s=1.0, seed=1, vehicles=2)


@pytest.mark.campaign(2, len(CASES))
def test_a_convoy_survives_a_cut(case: int) -> None:
    """No collision, no departure from the lane that was avoidable, no mispredicted blind drive."""
    cut = CASES[case]
    (run,) = figures_of_runs(run_cut(cut))
    assert run.collisions == 0, run
    assert run.blind_deviation == 0.0, run
    if not cut.fix:  # a car with a failed receiver does not know its own position
        assert run.departures_avoidable == 0, run


def test_a_run_without_path_history_sends_none() -> None:
    with_history, without = (replace(SHORT, variant=variant).scenario() for variant in HISTORY)
    assert without.vehicle("v1").sending.path_history == 0.0
    assert with_history.vehicle("v1").sending.path_history > 0.0


def test_cuts_are_the_same_for_each_variant_and_count() -> None:
    ours, theirs = draw_cuts(60, "history"), draw_cuts(90, "hold")
    assert [replace(cut, variant="hold") for cut in ours] == list(theirs)[:60]


def test_all_kinds_of_cuts_are_drawn() -> None:
    cuts = list(draw_cuts(120, "history"))
    assert Counter(cut.road for cut in cuts) == dict.fromkeys(ROADS, 20)
    assert {cut.links for cut in cuts} == set(LINKS)
    assert {cut.vehicles for cut in cuts} == set(range(3, 9))
    assert {cut.fix for cut in cuts} == {"", "float", "none"}
    assert {cut.flapping for cut in cuts} == {cut.for_s is None for cut in cuts} == {True, False}
    assert all(2 <= cut.vehicle <= cut.vehicles for cut in cuts)


@pytest.mark.parametrize("road", ROADS)
def test_a_road_lasts_until_the_end_of_the_run(road: Road) -> None:
    cut = LinkCut(variant="degrade", road=road, speed_mps=30.0, at_s=17.0, for_s=8.0, seed=1)
    assert longest_run(cut.scenario().route) > cut.ends_at_s + AFTERWARDS_S


def test_flapping_links_are_cut_and_restored_until_the_end() -> None:
    cut = replace(SHORT, flapping=True, for_s=6.0)
    changes = cut.scenario().tables.change
    spans = [
        (change.at_s, change.at_s + (change.for_s or 0.0))
        for change in changes
        if isinstance(change, CutTable)
    ]
    assert len(spans) > 2
    assert all(end < start for (_, end), (start, _) in pairwise(spans))
    assert spans[0][0] == cut.at_s
    assert spans[-1][1] <= cut.at_s + 6.0


def test_figures_from_a_journal_equal_those_of_the_run(tmp_path: Path) -> None:
    with study_engine(partial(open_workers, 0), print, out=tmp_path, identity={}) as engine:
        assert run_cuts([SHORT], engine) == list(run_cut(SHORT))
        assert run_cuts([SHORT], engine) == list(run_cut(SHORT))
        assert engine.progress.done == 2


def test_the_campaign_writes_its_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "draw_cuts", short_cuts)
    summaries = campaign.run_campaign(2, tmp_path, print, workers=0)
    assert [summary.variant for summary in summaries] == list(HISTORY)
    assert [summary.runs for summary in summaries] == [2, 2]
    results = json.loads((tmp_path / JSON_FILE).read_text())
    assert {row["cut"]["variant"] for row in results["rows"]} == set(HISTORY)
    assert (tmp_path / "cuts.png").stat().st_size > 10_000


def short_cuts(count: int, variant: Variant, _: Sequence[Road]) -> Iterator[LinkCut]:
    for seed in range(count):
        yield replace(SHORT, variant=variant, for_s=None, seed=seed)


def test_the_scenario_of_a_failed_run_repeats_it() -> None:
    cut = LinkCut(variant="extrapolate", speed_mps=20.0, at_s=6.5, for_s=None, seed=1, vehicles=2)
    rows = run_cut(cut)
    ((name, text),) = failures([replace(rows[0], collisions=1)])
    assert name == "extrapolate_1.toml"
    assert scenario_from_text(text, label=name).tables == cut.scenario().tables
    assert not list(failures([replace(rows[0], collisions=0, departures_avoidable=0)]))
