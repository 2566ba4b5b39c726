"""Convoys behind leads that drive what a receiver recorded: clean links, eight cars."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.runs.virtual import drive_trial
from tests.made.scenarios.made_drives import DRIVES, convoy_on

WITHIN_M = 0.25
GROWTH_M = 0.03
"""By so much the second half of the convoy may be further off than the first half, at most: what
cars with receivers of their own differ by."""


@pytest.mark.campaign(1, 5)
@pytest.mark.spread(1)
@pytest.mark.parametrize("name", [name for name in DRIVES if name != "track"])
def test_followers_stay_on_the_path_of_a_lead_with_real_corners(
    name: str, campaign: int, tmp_path: Path
) -> None:
    for seed in range(1, campaign + 1):
        trial = drive_trial(convoy_on(name, tmp_path, seed=seed, vehicles=8 if campaign > 1 else 3))
        assert max(trial.cross_track) < WITHIN_M, (seed, trial.cross_track)
        half = len(trial.cross_track) // 2
        growth = np.mean(trial.cross_track[-half:]) - np.mean(trial.cross_track[:half])
        assert growth < GROWTH_M, (seed, trial.cross_track)


@pytest.mark.campaign(0, 1)
def test_followers_stay_on_the_path_of_a_race_track(campaign: int, tmp_path: Path) -> None:
    if not campaign:
        pytest.skip("five kilometres: only in a campaign")
    trial = drive_trial(convoy_on("track", tmp_path))
    assert max(trial.cross_track) < WITHIN_M
