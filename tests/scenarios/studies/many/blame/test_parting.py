"""Runs that go on from copies of others come to the same as runs from the start, bit for bit."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.runs.forked import can_fork
from scenarios.runs.pool import in_this_process
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged import run_virtual
from scenarios.studies.many.blame import parting
from scenarios.studies.many.blame.imposed import loss_free
from scenarios.studies.many.blame.losses import Losses
from scenarios.studies.many.blame.parting import drive_parting, end_parting
from scenarios.studies.many.blame.report import machine_readable
from scenarios.studies.many.blame.rerun import EVER, Asked, BlameQuestion, run_anew
from scenarios.studies.many.blame.study import blame
from scenarios.studies.many.limit import Limit
from tests.made.many.lossy_logs import LAWS, recorded
from tests.made.many.planted_losses import LANE, TINY, planted
from vehicles.schedule import SECOND

pytestmark = [
    pytest.mark.skipif(not can_fork(), reason="only where runs are forked"),
    pytest.mark.forks,
]


ALL_QUESTIONS = ("independent", "changes")
"""Laws with which runs are asked everything; when they may end has nothing to do with the law."""


@pytest.fixture(autouse=True)
def copies(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Copies that stay at short intervals, and none afterwards."""
    monkeypatch.setattr(parting, "STAY_EVERY", SECOND // 2)
    yield
    end_parting()


@pytest.mark.parametrize("law", LAWS)
def test_parted_runs_come_to_what_they_do_from_the_start(law: str, tmp_path: Path) -> None:
    run = recorded(law, tmp_path)
    convoy, lost = loss_free(run), run.lost(EVER)
    every = frozenset(lost)
    question = BlameQuestion(figure="error", limit=Limit("error_m", 0.05))
    whole = Asked(question=question, whole=True)
    until = Asked(question=replace(question, until=SECOND), whole=True)
    broken = Asked(question=replace(question, until=int(1.2 * SECOND)), ends_when_broken=True)
    middle, last = lost[len(lost) // 2], lost[-1]
    sets: list[Losses] = [
        every,
        every - {lost[0]},  # parts from the first message on
        every - {middle},
        every - {middle},  # at the same instant, and never
        every - {middle, last},
        frozenset(),
        frozenset(lost[-2:]),
    ]
    for asked in (whole, broken, until) if law in ALL_QUESTIONS else (whole,):
        found = drive_parting(convoy, [(one, asked) for one in sets], 2)
        anew = {one: run_anew(convoy.losing(one), asked) for one in set(sets)}
        assert found == [anew[one] for one in sets]


def test_of_another_convoy_other_runs_are_driven(tmp_path: Path) -> None:
    one, other = (recorded(law, tmp_path / law) for law in ("independent", "a preset"))
    for run in (one, other, one):
        asked = Asked(question=BlameQuestion(figure="gap", limit=LANE), whole=True)
        (found,) = drive_parting(loss_free(run), [(frozenset(run.lost(EVER)), asked)], 2)
        assert found.truth == run.truth


@pytest.mark.parametrize(("limit", "abreast"), [(LANE, 1), (Limit("error_m", 0.3), 3)])
def test_all_that_is_found_is_the_same(limit: Limit, abreast: int, tmp_path: Path) -> None:
    run_virtual(planted(TINY, 3).scenario, tmp_path, Stop())
    log, said = tmp_path / "run.mcap", lambda _: None
    anew = blame(log, limit, "error", said, in_this_process)
    assert machine_readable(anew, tmp_path)["rows"]
    found = blame(log, limit, "error", said, in_this_process, abreast=abreast)
    assert machine_readable(found, tmp_path) == machine_readable(anew, tmp_path)
    assert (found.mended, found.smallest_answer) == (anew.mended, anew.smallest_answer)
