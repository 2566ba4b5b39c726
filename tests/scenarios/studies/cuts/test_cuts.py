"""All messages stop at some instant of a double lane change: what followers must make of it.

`pytest --campaign` makes 1000 cuts.
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
"""Blind metres are what was predicted to so much of them, or so many metres where they are few."""
STEERING_RATE, CONTROL_S = 1.18, 0.02
PROBATION_S = 1.0
ROUNDING = 1e-9
CUTS = list(draw_cuts(ALL, "degrade"))


@pytest.mark.campaign(FEW, ALL)
def test_a_follower_stops_within_what_it_knows_or_drives_blind_as_far_as_it_said(
    case: int,
) -> None:
    cut = CUTS[case]
    for one in run_cut(cut):
        what = f"{one.vehicle} in {cut}: {one.changes}"
        assert one.error_on_known_path <= INSIDE_M, what
        assert one.error_after_recovery <= INSIDE_M, what
        assert one.friction <= 1.0 + ROUNDING, what
        assert one.command_step <= STEERING_RATE * CONTROL_S + ROUNDING, what
        assert 0 <= one.ticks_late <= 1, what
        assert isfinite(one.resumed_after), what
        assert all(change.reason for change in one.changes if change.mode in {"coast", "stop"}), (
            what
        )
        for first, later in pairwise(one.changes):
            assert later.mode != first.mode, what
        for mode in ("coast", "stop", "lead", "predecessor", "composite"):
            at = [change.at_s for change in one.changes if change.mode == mode]
            assert all(b - a >= PROBATION_S for a, b in pairwise(at)), what
        if cut.for_s == LONG_S:
            assert one.stopped, what
            off = abs(one.blind - one.predicted_blind)
            assert off <= max(BLIND_M, BLIND_SHARE * one.predicted_blind), what


def test_cuts_are_the_same_for_each_reaction() -> None:
    ours = [(cut.speed_mps, cut.at_s, cut.for_s, cut.seed) for cut in draw_cuts(20, "degrade")]
    theirs = [(cut.speed_mps, cut.at_s, cut.for_s, cut.seed) for cut in draw_cuts(20, "hold")]
    assert ours == theirs


def test_figures_from_a_journal_are_those_of_the_run(tmp_path: Path) -> None:
    cut = LinkCut(reaction="hold", speed_mps=8.0, at_s=1.0, for_s=1.0, seed=1, vehicles=2)
    with study_engine(partial(open_workers, 0), print, out=tmp_path, identity={}) as engine:
        assert run_cuts([cut], engine) == list(run_cut(cut))
        assert run_cuts([cut], engine) == list(run_cut(cut))
        assert engine.progress.done == 2


def test_a_follower_that_extrapolates_leaves_the_road_at_full_speed() -> None:
    cut = LinkCut(reaction="extrapolate", speed_mps=20.0, at_s=6.5, for_s=8.0, seed=1)
    (first, *_) = run_cut(cut)
    assert first.error > 3.0
    assert not first.stopped
