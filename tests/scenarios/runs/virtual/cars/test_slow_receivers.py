"""Lane changes with receivers from 1 to 20 Hz at 10 to 36 m/s, with warnings of `convoy check`."""

import re
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import pytest

from scenarios.definition.check.findings import warnings
from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual

SPEEDS, RATES = (30.0, 10.0, 36.0, 20.0), (5.0, 1.0, 20.0, 2.0, 10.0)
CASES = tuple(product((True, False), RATES, SPEEDS))
"""Whether the inertial sensor measures with control, or only with the fixes; rates and speeds."""
GROWTH = re.compile(r"errors grow by ([\d.e-]+) 1/s")
SLOWLY = 4.0
"""Growth times time up to which a centimetre stays within the lane: ln 50."""
LANE = 0.5
"""How far (m) a car may be off."""


@dataclass(frozen=True)
class Outcome:
    """Largest self-estimated error (m) of the lead and true error (m) of the followers.

    `growth` (1/s) of errors is the one that check predicts, 0 without any.
    """

    lead: float
    followers: float
    growth: float
    seconds: float
    short_of_poses: bool


def outcome(case: int) -> Outcome:
    """Run a case: three cars, the first of the two lane changes."""
    with_control, rate, speed = CASES[case]
    imu = [] if with_control else [f"imu.rate_hz={rate}"]
    scenario = load_scenario(
        "lane_change",
        [
            f"gnss.rate_hz={rate}", f"speed.set_mps={speed}", "convoy.vehicles=3",
            f"duration_s={min(330.0 / speed, 30.0):.1f}", *imu,
        ],
    )  # fmt: skip
    reported = warnings(scenario)
    with tempfile.TemporaryDirectory() as folder:
        lead, *followers = run_virtual(scenario, Path(folder) / "run", Stop()).vehicles
    off = [one.cross_track_error_m_max for one in followers]
    assert lead.lateral_error_m_max is not None
    return Outcome(
        lead=lead.lateral_error_m_max,
        followers=max(error for error in off if error is not None),
        growth=max(
            (float(found[1]) for found in map(GROWTH.search, reported) if found), default=0.0
        ),
        seconds=scenario.duration_s,
        short_of_poses=any("poses" in line and "preview" in line for line in reported),
    )


@pytest.mark.campaign(1, len(CASES))
def test_cars_stay_in_their_lane_or_a_warning_predicts_it(case: int) -> None:
    found = outcome(case)
    if found.growth > 0.0:
        # What grows slowly has not come far by the end of the run.
        assert found.lead > LANE or found.growth * found.seconds < SLOWLY
        return
    assert found.lead < LANE
    assert found.followers < LANE or found.short_of_poses
