"""Cars without a single message yet: a follower without a first message stops, too."""

import pytest

from tests.made.convoys.driven import collisions, driven, least_gap_m
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Reception
from vehicles.messages import TruePose

LOST_S = Reception(0.05, DegradationSettings()).lost_after
"""A source of twenty messages a second is lost after such a silence at the start."""
DARK_S = 8.0
CONTROL_HZ = 50


@pytest.mark.parametrize("gap_m", [3, 10])
def test_vehicles_without_messages_stop_together_and_drive_on_with_them(gap_m: float) -> None:
    dark = f"change=[{{kind='cut', at_s=0, for_s={DARK_S}}}]"
    run = driven("lane_change", f"convoy.gap_m={gap_m}", dark, "duration_s=24")
    for name in ("v2", "v3", "v4"):
        instants = (LOST_S, LOST_S + 1.5, DARK_S, 23.98)
        speeds = [run.speeds(name)[round(at * CONTROL_HZ)] for at in instants]
        assert speeds[0] == pytest.approx(30.0, abs=0.2)
        # 6 m/s² from then on, half a second later at most: the jerk is 12 m/s³.
        assert 30.0 - 6.0 * 1.5 - 0.1 < speeds[1] < 30.0 - 6.0 * 1.2
        assert speeds[2] < 0.05
        assert speeds[3] > 5.0
        blind = run.of(name, TruePose)[: round(DARK_S * CONTROL_HZ)]
        assert all(abs(pose.steering_rad) < 0.01 for pose in blind)
    assert collisions(run.summary) == 0
    assert least_gap_m(run.summary) > 0.7 * gap_m
