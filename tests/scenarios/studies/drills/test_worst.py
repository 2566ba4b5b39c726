"""The search for the worst time of a burst finds planted peaks, and writes a drill."""

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.results.summary import to_json
from scenarios.runs.virtual.unlogged_run import run_unlogged
from scenarios.studies.drills.worst import (
    BurstLoss,
    SearchSpan,
    WorstInstant,
    WorstSearch,
    base_variant,
    parsed_burst,
    search_span,
)
from scenarios.studies.drills.worst_files import drill_text, machine_readable, write_drill
from scenarios.studies.engine.job import Job
from tests.made.many.engines import SyntheticEngine, engine_here

FIELD = "cross_track_error_m_max"
SHORT = ("duration_s=6.0", "convoy.vehicles=2")
BASE = base_variant("lane_change", SHORT, None)
SCENARIO = BASE.scenario
UNUSED_ENGINE = SyntheticEngine(lambda job: pytest.fail(job.key))


def instant_and_seed(job: Job) -> tuple[float, int]:
    at, seed = job.key.split("/")
    return float(at), int(seed)


def searched(figure: Any, span: SearchSpan, word: str = "error_m") -> WorstInstant:
    """Search a synthetic figure, given by time."""

    def severity(job: Job) -> float:
        at, _ = instant_and_seed(job)
        return float(figure(at) if word == "error_m" else -figure(at))

    return WorstSearch(BASE, BurstLoss(for_s=1.0), word, SyntheticEngine(severity)).run(span)


def test_several_seeds_give_the_worst_mean_and_its_worst_run() -> None:
    """One seed has a large random value at 3 s; all seeds share a peak at 8 s."""

    def severity(job: Job) -> float:
        at, seed = instant_and_seed(job)
        noise = 1.0 if (at, seed) == (3.0, 4) else 0.1 * seed
        return noise + max(0.5 - abs(at - 8.0), 0.0)

    base = base_variant("lane_change", SHORT, 4)
    burst = BurstLoss(for_s=1.0)
    engine = SyntheticEngine(severity)
    found = WorstSearch(base, burst, "error_m", engine, seeds=3).run(SPAN)
    assert found.at_s == 8.0
    assert found.mean == pytest.approx(0.5 + 0.1 * 5)
    assert found.variant.seed == 6
    assert found.figure == pytest.approx(0.5 + 0.1 * 6)
    alone = WorstSearch(base, burst, "error_m", engine).run(SPAN)
    assert (alone.at_s, alone.mean, alone.figure) == (3.0, 1.0, 1.0)


SPAN = SearchSpan(from_s=1.0, to_s=11.0, step_s=0.5, finest_s=0.05)


@given(peak=st.floats(1.0, 11.0), width=st.floats(0.5, 3.0))
@example(peak=1.0, width=0.5)
@example(peak=11.0, width=0.5)
def test_a_single_peak_is_found(peak: float, width: float) -> None:
    """The peak is at least as wide as the grid."""
    found = searched(lambda at: math.exp(-(((at - peak) / width) ** 2)), SPAN)
    assert abs(found.at_s - peak) <= 0.05
    assert found.figure == max(found.figures.values())


def test_the_higher_of_two_peaks_is_found_although_it_is_lower_on_the_grid() -> None:
    def figure(at: float) -> float:
        return max(1.0 - abs(at - 3.0), 1.5 - 4.0 * abs(at - 8.25))  # 0.5 on the grid

    assert searched(figure, SPAN).at_s == pytest.approx(8.25, abs=0.05)


def test_a_gap_is_minimized() -> None:
    found = searched(lambda at: 5.0 + abs(at - 4.3), SPAN, "gap_m")
    assert found.at_s == pytest.approx(4.3, abs=0.05)
    assert found.figure == pytest.approx(5.0, abs=0.05)


def test_the_earliest_of_equal_times_is_returned() -> None:
    assert searched(lambda _: 1.0, SPAN).at_s == 1.0


def test_the_search_includes_both_ends_and_nothing_beyond() -> None:
    span = SearchSpan(from_s=1.0, to_s=2.2, step_s=0.5, finest_s=0.1)
    assert span.grid() == [1.0, 1.5, 2.0, 2.2]
    found = searched(lambda at: at, span)
    assert found.at_s == 2.2
    assert all(1.0 <= at <= 2.2 for at in found.figures)


def test_a_burst_is_added_to_other_changes() -> None:
    base = base_variant("lane_change", (*SHORT, 'change=[{kind="heal", at_s=1.0}]'), 4)
    burst = BurstLoss(for_s=1.5, links=(("lead", "*"), ("v1", "v2")))
    search = WorstSearch(base, burst, "error_m", UNUSED_ENGINE, changes=1)
    scenario = search.variant(2.25).scenario
    assert scenario.seed == 4
    assert [one.kind for one in scenario.tables.change] == ["heal", "cut", "cut"]
    cut = scenario.tables.change[1].model_dump()
    assert cut == {"kind": "cut", "at_s": 2.25, "for_s": 1.5, "sender": "lead", "receiver": "*"}


def test_links_are_parsed() -> None:
    assert parsed_burst((), 1.0, SCENARIO).links == (("*", "*"),)
    found = parsed_burst(("lead:*", "v1:v2"), 1.0, SCENARIO)
    assert found.links == (("lead", "*"), ("v1", "v2"))
    for wrong in ("v1", "v1:v9", "v1-v2", ""):
        with pytest.raises(ScenarioError, match=r"--link: given .* allowed SENDER:RECEIVER"):
            parsed_burst((wrong,), 1.0, SCENARIO)


REFUSED = {
    "no burst": (0.0, {}, "--burst: given 0 s"),
    "as long as the run": (6.0, {}, "--burst: given 6 s"),
    "no steps": (1.0, {"step_s": 0.0, "finest_s": 0.0}, "--step, --finest: given 0 and 0 s"),
    "finer first": (1.0, {"step_s": 0.1, "finest_s": 0.2}, "--step, --finest"),
    "backwards": (1.0, {"from_s": 3.0, "to_s": 2.0}, "--from, --to: given 3 to 2 s"),
    "beyond the end": (1.0, {"to_s": 5.5}, "--from, --to: given 1 to 5.5 s"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_invalid_spans_are_refused(case: str) -> None:
    for_s, more, words = REFUSED[case]
    options: dict[str, Any] = {"from_s": None, "to_s": None, "step_s": 0.5, "finest_s": 0.05}
    with pytest.raises(ScenarioError, match=words):
        search_span(SCENARIO, BurstLoss(for_s=for_s), **(options | more))


def test_the_drill_is_the_worst_run_with_a_limit(tmp_path: Path) -> None:
    found = searched(lambda at: 0.3 - abs(at - 3.0) / 100.0, SPAN)
    file = tmp_path / "hurts.toml"
    write_drill(found, file)
    given_keys = tomllib.loads(file.read_text())
    assert given_keys["extends"] == "lane_change"
    assert given_keys["limits"] == {"cross_track_error_m_max": 0.45}
    written, expected = load_scenario(file), found.variant.scenario
    assert written.name == "hurts"
    for key in ("change", "convoy", "links", "speed", "control", "seed", "duration_s"):
        assert getattr(written.tables, key) == getattr(expected.tables, key), key
    with pytest.raises(ScenarioError, match="exists"):
        write_drill(found, file)


def test_a_drill_of_a_file_extends_the_file(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    own = tmp_path / "mine" / "road.toml"
    own.write_text('extends = "lane_change"\nname = "road"\nduration_s = 8.0\n')
    base = base_variant(
        str(own), ["links.loss_ratio=0.2", "link.0={sender='v1', receiver='v2'}"], 3
    )
    search = WorstSearch(base, BurstLoss(for_s=1.0), "gap_m", UNUSED_ENGINE)
    found = WorstInstant(
        word="gap_m", at_s=2.0, figure=6.0, figures={2.0: 6.0}, variant=search.variant(2.0)
    )
    text = drill_text(found, tmp_path / "worst.toml")
    assert tomllib.loads(text)["extends"] == "mine/road.toml"
    written = scenario_from_text(text, folder=tmp_path)
    assert (written.seed, written.duration_s, written.tables.links.loss_ratio) == (3, 8.0, 0.2)
    assert len(written.tables.link) == 1
    assert written.tables.limits.true_gap_m_min == 4.0


def test_json_has_all_times() -> None:
    found = searched(lambda at: at, SearchSpan(from_s=1.0, to_s=2.0, step_s=0.5, finest_s=0.5))
    table = json.loads(json.dumps(machine_readable(found, BurstLoss(for_s=1.0))))
    assert (table["schema"], table["figure"], table["at_s"]) == ("convoy.worst/1", FIELD, 2.0)
    assert table[FIELD] == 2.0
    assert table["simulated"] == [{"at_s": at, FIELD: at} for at in (1.0, 1.5, 2.0)]


def test_the_command_repeats_the_figure() -> None:
    """A real search with two times, in this process."""
    base = base_variant("lane_change", ("duration_s=2.5", "convoy.vehicles=2"), None)
    span = SearchSpan(from_s=1.0, to_s=1.5, step_s=0.5, finest_s=0.5)
    with engine_here() as engine:
        found = WorstSearch(base, BurstLoss(for_s=1.0), "error_m", engine).run(span)
    again = load_scenario("lane_change", found.variant.overrides, found.variant.seed)
    summary = run_unlogged(again)
    assert to_json(summary) == to_json(found.variant.run())
    assert found.figure == summary.vehicles[1].cross_track_error_m_max
