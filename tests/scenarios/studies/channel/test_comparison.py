"""Closed forms of bursts and delays, and samples that follow them."""

from dataclasses import replace

import pytest
from hypothesis import strategies as st

from scenarios.definition.channel.presets import presets
from scenarios.definition.check.link_forecast import StraightDrive
from scenarios.definition.scenario import load_scenario
from scenarios.studies.channel.comparison import Comparison, compare
from transport.links.link import Link

RATIOS = st.floats(0.05, 0.95)


def drive(*settings: str, link: tuple[str, str] = ("v1", "v4")) -> StraightDrive:
    return StraightDrive(load_scenario("lane_change", settings), link, 50.0)


def compared(*settings: str, messages: int = 2000) -> Comparison:
    return compare(drive(*settings), messages)[0]


@pytest.mark.spread(5)
@pytest.mark.parametrize("name", presets())
def test_samples_of_presets_follow_their_laws(name: str) -> None:
    comparison = compared(f"links.preset={name}", messages=1500)
    for row in (*comparison.figures[:2], *comparison.distances):
        if row.law is None or row.sample is None or row.low is None or row.high is None:
            continue
        tolerance = 2.5 * max(row.high - row.sample, row.sample - row.low) + 0.02
        shadowing = 0.35 if name.startswith("nlosv") else 0.0  # few decorrelation distances
        assert abs(row.sample - row.law) < tolerance + shadowing, row
    assert len(comparison.distances) == (10 if name.startswith(("ieee", "lte", "nlosv")) else 0)


def test_a_sample_consists_of_the_verdicts_of_the_scenario_s_link() -> None:
    straight = drive("links.preset=bursty", "links.jitter_ms=5")
    link = Link(straight.effects(), straight.scenario.seed, "v1", "v4")
    verdicts = [link.judge(context) for context in straight._contexts(500)]
    sample = straight.sample(500)
    assert sample.lost.tolist() == [bool(verdict.reason) for verdict in verdicts]
    assert sample.dropped == {"burst": int(sample.lost.sum())}


def test_corrupted_messages_count_as_lost_and_rate_limited_ones_do_not() -> None:
    sample = drive("links.rate_hz=5.0", "links.content={bit_error_ratio=0.001}").sample(800)
    assert len(sample.lost) == 200
    assert sample.dropped["rate"] == 600
    assert sample.dropped["corrupted"] == sample.lost.sum() > 80


def test_a_link_that_loses_all_has_no_delays() -> None:
    figures = {row.figure: row for row in compared("links.loss_ratio=1.0").figures}
    assert figures["loss"].sample == 1.0
    assert figures["mean delay"].sample is None
    assert figures["lost in a row"].law is None


def test_bursts_are_shares_of_all_bursts() -> None:
    rows = compared("links.loss_ratio=0.5").bursts
    assert sum(row.sample or 0.0 for row in rows) == pytest.approx(1.0)
    assert rows[0].sample == pytest.approx(0.5, abs=0.05)  # geometric
    nearer = compare(replace(drive("links.preset=ieee80211p_jam"), distance_m=10.0), 500)[0]
    farther = compare(replace(drive("links.preset=ieee80211p_jam"), distance_m=200.0), 500)[0]
    assert (nearer.figures[0].sample or 0.0) < (farther.figures[0].sample or 0.0)
