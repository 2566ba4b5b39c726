"""A planted decisive burst among harmless losses is found.

`pytest --campaign` plants 50 bursts in the double lane change of 35 s, and 20 in shorter runs.
"""

import time
from pathlib import Path

import pytest

from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.many.blame import BlameResult, blame
from scenarios.studies.many.trials import RerunCriteria, rerun
from tests.made.many.engines import engine_here
from tests.made.many.planted_losses import FULL, LANE, SHORT, TINY, Convoy, planted


def blame_planted(convoy: Convoy, case: int, folder: Path, workers: int | None) -> BlameResult:
    cause = planted(convoy, case)
    run_virtual(cause.scenario, folder, Stop())
    with engine_here(workers) as engine:
        result = blame(folder / "run.mcap", LANE, "error", engine)
    worst = {(one.link, one.number) for one in result.rows[0].losses}
    assert worst & cause.messages, f"case {case}: blames {result.rows[0]}"
    assert result.smallest is not None
    assert result.smallest.is_minimal
    smallest = {(one.link, one.number) for one in result.smallest.items}
    assert smallest <= cause.messages, f"case {case}: {sorted(smallest - cause.messages)} as well"
    return result


@pytest.mark.campaign(1, 20)
def test_a_burst_is_found_and_reduced_to_a_minimal_set(case: int, tmp_path: Path) -> None:
    result = blame_planted(TINY, case, tmp_path, workers=0)
    assert result.smallest is not None
    criteria = RerunCriteria(figure="error", limit=LANE, until=result.smallest_result.broken_at)  # type: ignore[union-attr,arg-type]
    every = frozenset(result.smallest.items)
    assert rerun(result.convoy.with_losses(every), result.criteria).broken_at is not None
    for one in every:
        assert rerun(result.convoy.with_losses(every - {one}), criteria).broken_at is None


@pytest.mark.campaign(0, 20)
def test_a_burst_on_two_links_is_found(case: int, tmp_path: Path) -> None:
    blame_planted(SHORT, case, tmp_path, workers=0)


@pytest.mark.campaign(0, 50)
def test_a_burst_in_a_double_lane_change_of_35_s_is_found_within_two_minutes(
    case: int, tmp_path: Path
) -> None:
    began = time.monotonic()
    result = blame_planted(FULL, case, tmp_path, workers=None)
    print(f"case {case}: {result.runs} runs, {result.seconds:.1f} s")
    assert time.monotonic() - began < 180.0
    assert result.seconds < 120.0
