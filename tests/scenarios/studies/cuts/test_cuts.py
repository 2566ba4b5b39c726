"""Limits of followers when all links are cut during a double lane change.

`pytest --campaign` simulates 1000 cuts.
"""

from functools import partial
from itertools import pairwise
from math import isfinite
from pathlib import Path

import pytest

from scenarios.studies.cuts.campaign import LONG_S, draw_cuts, run_cuts
from scenarios.studies.cuts.cut import LinkCut, run_cut
from scenarios.studies.engine.engine import study_engine
from scenarios.studies.engine.workers import open_workers

FEW, ALL = 2, 1000
INSIDE_M = 0.3
BLIND_SHARE, BLIND_M = 0.05, 0.5
"""Allowed error of the predicted blind distance: a ratio, or at least a distance."""
STEERING_RATE, CONTROL_S = 1.18, 0.02
PROBATION_S = 1.0
ROUNDING = 1e-9
CUTS = list(draw_cuts(ALL, "degrade"))


@pytest.mark.campaign(FEW, ALL)
def test_followers_stop_within_the_known_path_or_the_predicted_blind_distance(
    case: int,
) -> None:
    cut = CUTS[case]
    for row in run_cut(cut):
        case_text = f"{row.vehicle} in {cut}: {row.changes}"
        assert row.error_on_known_path <= INSIDE_M, case_text
        assert row.error_after_recovery <= INSIDE_M, case_text
        assert row.friction <= 1.0 + ROUNDING, case_text
        assert row.command_step <= STEERING_RATE * CONTROL_S + ROUNDING, case_text
        assert 0 <= row.ticks_late <= 1, case_text
        assert isfinite(row.resumed_after), case_text
        assert all(change.reason for change in row.changes if change.mode in {"coast", "stop"}), (
            case_text
        )
        for first, later in pairwise(row.changes):
            assert later.mode != first.mode, case_text
        for mode in ("coast", "stop", "lead", "predecessor", "composite"):
            at = [change.at_s for change in row.changes if change.mode == mode]
            assert all(b - a >= PROBATION_S for a, b in pairwise(at)), case_text
        if cut.for_s == LONG_S:
            assert row.stopped, case_text
            off = abs(row.blind - row.predicted_blind)
            assert off <= max(BLIND_M, BLIND_SHARE * row.predicted_blind), case_text


def test_cuts_are_the_same_for_each_reaction() -> None:
    ours = [(cut.speed_mps, cut.at_s, cut.for_s, cut.seed) for cut in draw_cuts(20, "degrade")]
    theirs = [(cut.speed_mps, cut.at_s, cut.for_s, cut.seed) for cut in draw_cuts(20, "hold")]
    assert ours == theirs


def test_figures_from_a_journal_equal_those_of_the_run(tmp_path: Path) -> None:
    cut = LinkCut(reaction="hold", speed_mps=8.0, at_s=1.0, for_s=1.0, seed=1, vehicles=2)
    with study_engine(partial(open_workers, 0), print, out=tmp_path, identity={}) as engine:
        assert run_cuts([cut], engine) == list(run_cut(cut))
        assert run_cuts([cut], engine) == list(run_cut(cut))
        assert engine.progress.done == 2


def test_an_extrapolating_follower_leaves_the_road() -> None:
    cut = LinkCut(reaction="extrapolate", speed_mps=20.0, at_s=6.5, for_s=8.0, seed=1)
    (first, *_) = run_cut(cut)
    assert first.error > 3.0
    assert not first.stopped
