"""Limits of followers when all links are cut during a double lane change.

`pytest --campaign` simulates 1000 cuts.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import inf, isfinite

import numpy as np
import pytest

from scenarios.studies.cuts.cut import FOR_GOOD_S, LinkCut
from scenarios.studies.cuts.cut_figures import run_cut
from scenarios.studies.cuts.run_figures import blind_deviation

FEW, ALL = 2, 1000
INSIDE_M = 0.3
LANE_CHANGE_AT_S = 6.5
STEERING_RATE, CONTROL_S = 1.18, 0.02
PROBATION_S = 1.0
ROUNDING = 1e-9


def lane_change_cuts(count: int) -> Iterator[LinkCut]:
    """Cuts of all links in a double lane change; half of them last until all cars have stopped."""
    random = np.random.Generator(np.random.PCG64(1))
    for number in range(count):
        yield LinkCut(
            variant="degrade",
            speed_mps=round(float(random.uniform(8.0, 30.0)), 2),
            at_s=round(float(random.uniform(3.0, 17.0)), 3),
            for_s=FOR_GOOD_S if number % 2 else round(float(random.uniform(0.3, 4.0)), 3),
            seed=number + 1,
        )


HISTORY_M = 150.0
"""At least this much of its path a car sends at these speeds."""
LANE_CHANGES = sorted(lane_change_cuts(ALL), key=lambda cut: abs(cut.at_s - LANE_CHANGE_AT_S))


@pytest.mark.campaign(FEW, ALL)
def test_followers_stop_within_the_known_path_or_the_predicted_blind_distance(
    case: int,
) -> None:
    cut = LANE_CHANGES[case]
    for row in run_cut(cut):
        case_text = f"{row.vehicle} in {cut}: {row.changes}"
        assert row.error_on_known_path <= INSIDE_M, case_text
        assert row.error_after_recovery <= INSIDE_M, case_text
        assert row.friction <= 1.0 + ROUNDING, case_text
        assert row.command_step <= STEERING_RATE * CONTROL_S + ROUNDING, case_text
        assert 0 <= row.ticks_late <= 1, case_text
        if cut.speed_mps * (cut.for_s or inf) < HISTORY_M:  # the lead's history closes the hole
            assert isfinite(row.resumed_after), case_text
        assert all(change.reason for change in row.changes if change.mode in {"coast", "stop"}), (
            case_text
        )
        for first, later in pairwise(row.changes):
            assert later.mode != first.mode, case_text
        for mode in ("coast", "stop", "lead", "predecessor", "composite"):
            at = [change.at_s for change in row.changes if change.mode == mode]
            assert all(b - a >= PROBATION_S for a, b in pairwise(at)), case_text
        if cut.for_s == FOR_GOOD_S:
            assert row.stopped, case_text
            assert row.blind is not None, case_text
            assert blind_deviation(row) == 0.0, case_text


def test_an_extrapolating_follower_leaves_the_road() -> None:
    cut = LinkCut(variant="extrapolate", speed_mps=20.0, at_s=6.5, for_s=None, seed=1, vehicles=2)
    (first, *_) = run_cut(cut)
    assert first.error > 3.0
    assert first.departures
    assert not first.stopped
