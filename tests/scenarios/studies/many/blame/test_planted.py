"""One decisive burst among harmless losses is found again.

`pytest --campaign` plants 50 in the double lane change of 35 s, and 20 in shorter ones.
"""

import time
from pathlib import Path

import pytest

from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from scenarios.studies.many.blame.rerun import RerunCriteria, rerun
from scenarios.studies.many.blame.study import BlameResult, blame
from tests.made.many.engines import engine_here
from tests.made.many.planted_losses import FULL, LANE, SHORT, TINY, Convoy, planted


def found_again(convoy: Convoy, case: int, folder: Path, workers: int | None) -> BlameResult:
    """Blame the log of a planted run, and check that it is the burst and nothing else."""
    cause = planted(convoy, case)
    run_virtual(cause.scenario, folder, Stop())
    with engine_here(workers) as engine:
        found = blame(folder / "run.mcap", LANE, "error", engine)
    worst = {(one.link, one.number) for one in found.rows[0].losses}
    assert worst & cause.messages, f"case {case}: blames {found.rows[0]}"
    assert found.smallest is not None
    assert found.smallest.is_minimal
    smallest = {(one.link, one.number) for one in found.smallest.items}
    assert smallest <= cause.messages, f"case {case}: {sorted(smallest - cause.messages)} as well"
    return found


@pytest.mark.campaign(1, 20)
def test_a_burst_is_found_and_shrunk_until_no_message_can_be_spared(
    case: int, tmp_path: Path
) -> None:
    found = found_again(TINY, case, tmp_path, workers=0)
    assert found.smallest is not None
    criteria = RerunCriteria(figure="error", limit=LANE, until=found.smallest_result.broken_at)  # type: ignore[union-attr,arg-type]
    every = frozenset(found.smallest.items)
    assert rerun(found.convoy.with_losses(every), found.criteria).broken_at is not None
    for one in every:
        assert rerun(found.convoy.with_losses(every - {one}), criteria).broken_at is None


@pytest.mark.campaign(0, 20)
def test_a_burst_on_two_links_is_found(case: int, tmp_path: Path) -> None:
    found_again(SHORT, case, tmp_path, workers=0)


@pytest.mark.campaign(0, 50)
def test_a_burst_in_a_double_lane_change_of_35_s_is_found_within_two_minutes(
    case: int, tmp_path: Path
) -> None:
    began = time.monotonic()
    found = found_again(FULL, case, tmp_path, workers=None)
    print(f"case {case}: {found.runs} runs, {found.seconds:.1f} s")
    assert time.monotonic() - began < 180.0
    assert found.seconds < 120.0
