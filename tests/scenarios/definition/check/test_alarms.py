"""False alarms of the links of a scenario: by closed form, and by a sample of a run's own draws."""

from math import sqrt

import pytest

from scenarios.definition.check.alarms import FalseAlarms, deaf_per_h, false_alarms, sampled_alarms
from scenarios.definition.check.links import asked_links
from scenarios.definition.scenario import load_scenario

BURSTS = "links.loss={kind='gilbert_elliott',loss_ratio=0.4,burst_messages_mean=4}"
PATTERN = "links.loss={kind='pattern',lost_numbers='2-10',length_messages=50}"
LINK = ("v1", "v3")


def alarms_of(*overrides: str) -> FalseAlarms:
    return false_alarms(load_scenario("lane_change", overrides), LINK)


def per_h(found: FalseAlarms) -> float:
    assert found.per_h is not None
    return found.per_h


def test_without_loss_there_are_none() -> None:
    assert alarms_of().per_h == 0.0
    assert alarms_of().of_run(1000) == 0.0


def test_the_threshold_is_the_receivers_own_and_counted_in_the_senders_periods() -> None:
    """Ten periods at 20 Hz, or two seconds; at 10 Hz one second is ten periods."""
    found = alarms_of("links.loss_ratio=0.4")
    assert [found.limit_s, per_h(found)] == pytest.approx([0.5, 72_000 * 0.6 * 0.4**10])
    later = alarms_of("links.loss_ratio=0.4", "vehicle.v3.control.degradation.lost_s=1.0")
    assert [later.limit_s, per_h(later)] == pytest.approx([1.0, 72_000 * 0.6 * 0.4**20])
    other = alarms_of("links.loss_ratio=0.4", "vehicle.v2.control.degradation.lost_s=1.0")
    assert other.limit_s == 0.5
    slow = alarms_of("links.loss_ratio=0.4", "gnss.rate_hz=10", "vehicle.v3.gnss.rate_hz=20")
    assert [slow.limit_s, per_h(slow)] == pytest.approx([1.0, 36_000 * 0.6 * 0.4**10])


@pytest.mark.parametrize(
    "overrides",
    [
        [BURSTS],
        [BURSTS, "links.loss_ratio=0.2", "links.rate_hz=12", "links.jitter_ms=90"],
        ["links.loss_ratio=0.6", "links.delay={kind='gamma',mean_ms=40,deviation_ms=60}"],
        ["links.outages=[{kind='random',mean_on_s=4,mean_off_s=0.6}]"],
        [BURSTS, "links.content.bit_error_ratio=0.0004"],
        [PATTERN, "links.loss_ratio=0.1"],
    ],
)  # fmt: skip
def test_a_sample_of_the_runs_own_draws_agrees(overrides: list[str]) -> None:
    scenario, messages = load_scenario("lane_change", overrides), 20_000
    found = false_alarms(scenario, LINK)
    sample = sampled_alarms(scenario, LINK, messages)
    assert found.silences is not None
    assert sample is not None
    expected = found.silences.alarms * messages
    assert expected > 20.0
    deviation = sqrt(found.dispersion * expected)
    assert sample.alarms * messages == pytest.approx(expected, abs=4.0 * deviation)


def test_what_no_closed_form_knows_is_sampled_and_said_so() -> None:
    reserved = "links.collisions={loss_ratio=0.3}"
    scenario = load_scenario("lane_change", [reserved])
    assert false_alarms(scenario, LINK).silences is None
    links, deaf = asked_links(scenario)
    assert all(one.is_sampled and one.false_alarms_per_h for one in links)
    assert all(one.deaf_per_h is not None for one in deaf)
    links, deaf = asked_links(load_scenario("lane_change", ["links.preset=tunnel"]))
    assert {one.false_alarms_per_h for one in links} == {None}
    assert {one.deaf_per_h for one in deaf} == {None}


@pytest.mark.parametrize("overrides", ["sending={kind='cam'}", "gnss.fix='none'"])
def test_of_a_sender_that_sends_by_no_schedule_nothing_is_said(overrides: str) -> None:
    scenario = load_scenario("lane_change", ["links.loss_ratio=0.4", overrides])
    assert false_alarms(scenario, LINK).per_h is None
    assert sampled_alarms(scenario, LINK, 100) is None


def test_losses_at_times_of_their_own_are_those_of_the_run_alone() -> None:
    found = alarms_of(
        "links.outages=[{kind='window',from_s=5,to_s=7},{kind='window',from_s=9,to_s=9.3}]"
    )
    assert found.per_h is None
    assert found.of_run(20 * 20) == 1.0
    assert found.of_run(20 * 5) == 0.0


def test_both_sources_are_lost_at_once_as_often_as_two_links_of_their_own_are() -> None:
    """Of each the share of time q it is lost, r times an hour: 2 r q."""
    found = alarms_of(BURSTS)
    assert found.silences is not None
    share = found.silences.silent_ns * found.sent_hz / 1e9
    assert deaf_per_h([found]) == pytest.approx(per_h(found))
    assert deaf_per_h([found, found]) == pytest.approx(2.0 * per_h(found) * share)
