"""False alarms of the links of a scenario, counted in a sample of a run's own draws."""

import pytest

from scenarios.definition.check.false_alarms import (
    Alarms,
    all_lost_per_h,
    longest_silence_s,
    sampled_alarms,
)
from scenarios.definition.scenario import load_scenario

BURSTS = "links.loss={kind='gilbert_elliott',loss_ratio=0.4,burst_messages_mean=4}"
LINK = ("v1", "v3")


def alarms_of(*overrides: str, messages: int = 20_000) -> Alarms:
    found = sampled_alarms(load_scenario("lane_change", overrides), LINK, messages)
    assert found is not None
    return found


def test_without_loss_there_are_none() -> None:
    assert alarms_of(messages=1000) == Alarms(0.0, 0.0)


def test_the_threshold_is_the_receivers_own_and_counted_in_the_senders_periods() -> None:
    """Ten periods at 20 Hz, or two seconds; at 10 Hz one second is ten periods."""
    for limit_s, *overrides in (
        (0.5, "links.loss_ratio=0.4"),
        (1.0, "vehicle.v3.control.degradation.lost_s=1.0"),
        (0.5, "vehicle.v2.control.degradation.lost_s=1.0"),
        (1.0, "gnss.rate_hz=10", "vehicle.v3.gnss.rate_hz=20"),
    ):
        scenario = load_scenario("lane_change", overrides)
        assert longest_silence_s(*map(scenario.vehicle, LINK)) == limit_s


def test_independent_losses_have_the_alarms_of_ten_losses_in_a_row() -> None:
    """20 messages a second, of which 0.4 · 0.6^10 pass before ten that are lost."""
    expected = 20.0 * 0.4 * 0.6**10
    assert alarms_of("links.loss_ratio=0.6", messages=100_000).per_s == pytest.approx(
        expected, rel=4.0 * (expected * 5000.0) ** -0.5
    )


def test_bursts_of_four_have_the_alarms_that_follow_from_their_law() -> None:
    """Messages pass with 0.6; of 1 in 24 passes a burst begins, which lasts with 0.75 each."""
    expected = 20.0 * 0.6 * (0.4 / 0.6 / 4.0) * 0.75**9
    assert alarms_of(BURSTS, messages=100_000).per_s == pytest.approx(
        expected, rel=5.0 * (expected * 5000.0) ** -0.5
    )


def test_both_sources_are_lost_at_once_as_often_as_chance_has_it() -> None:
    """A second link that is lost for a quarter of the time, each time for long."""
    one, other = Alarms(0.01, 0.001), Alarms(0.002, 0.25)
    assert all_lost_per_h([one]) == pytest.approx(36.0)
    assert all_lost_per_h([one, other]) == pytest.approx(3600.0 * (0.01 * 0.25 + 0.002 * 0.001))
    assert all_lost_per_h([one, None]) is None
