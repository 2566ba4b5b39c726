"""Closed forms of bursts and delays, and samples that follow them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.channel.build import expected_channel, link_effects
from scenarios.definition.channel.presets import presets
from scenarios.definition.check.link_forecast import StraightDrive
from scenarios.definition.scenario import load_scenario
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.studies.channel.comparison import Comparison, burst_shares, compare, delay_quantiles
from transport.links.link import Link

RATIOS = st.floats(0.05, 0.95)


def drive(*settings: str, link: tuple[str, str] = ("v1", "v4")) -> StraightDrive:
    return StraightDrive(load_scenario("lane_change", settings), link, 50.0)


def compared(*settings: str, messages: int = 2000) -> Comparison:
    return compare(drive(*settings), messages)[0]


def gilbert(p: float, r: float, q: float) -> LinkTable:
    law = {"kind": "gilbert_elliott", "good_to_bad_ratio": p, "bad_to_good_ratio": r}
    return LinkTable.model_validate({"loss": law, "loss_ratio": q})


@given(RATIOS, st.floats(0.1, 0.95))
def test_bursts_of_gilbert_s_chain_are_geometric(p: float, r: float) -> None:
    table = gilbert(p, r, 0.0)
    shares = burst_shares(expected_channel(table), link_effects(table, 20.0))
    assert shares is not None
    lengths = np.arange(10)
    assert shares[:10] == pytest.approx(r * (1.0 - r) ** lengths, abs=1e-9)


@given(RATIOS, st.floats(0.2, 0.95), st.floats(0.05, 0.6))
def test_bursts_of_a_chain_with_independent_losses_are_those_of_a_hidden_chain(
    p: float, r: float, q: float
) -> None:
    table = gilbert(p, r, q)
    shares = burst_shares(expected_channel(table), link_effects(table, 20.0))
    assert shares is not None
    assert shares.sum() == pytest.approx(1.0)
    # The chain is good before a burst. The lost message finds it bad, or good and is lost anyway.
    begins = p + (1.0 - p) * q
    single = (p * r + (1.0 - p) * q * (1.0 - p)) * (1.0 - q) / begins
    assert shares[0] == pytest.approx(single, rel=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        ("links.collisions={loss_ratio=0.2}",),
        ('links.loss={kind="every_nth",every_messages=4}', "links.loss_ratio=0.1"),
        ("links.preset=tunnel",),
        ("links.preset=clear",),
    ],
)
def test_other_laws_have_no_closed_form_of_bursts(settings: tuple[str, ...]) -> None:
    link = drive(*settings)
    assert burst_shares(expected_channel(link.table), link.effects()) is None


@pytest.mark.parametrize(
    "setting",
    [
        "links.jitter_ms=12",
        'links.delay={kind="gamma",mean_ms=30.0,deviation_ms=20.0}',
        'links.delay={kind="normal",mean_ms=30.0,deviation_ms=20.0}',
    ],
)
def test_delay_quantiles_of_one_law_agree_with_its_messages(setting: str) -> None:
    link, shares = drive(setting), (0.1, 0.5, 0.9)
    quantiles = delay_quantiles(expected_channel(link.table), link.effects(), shares)
    assert quantiles is not None
    delays = link.sample(4000).delay_ms
    within = [float((delays <= quantile).mean()) for quantile in quantiles]
    assert within == pytest.approx(shares, abs=0.03)
    both = drive(setting, "links.content={reorder_ratio=0.1}")
    assert delay_quantiles(expected_channel(both.table), both.effects(), shares) is None


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
    assert sum(row.law or 0.0 for row in rows) == pytest.approx(1.0, abs=1e-3)
    nearer = compare(replace(drive("links.preset=ieee80211p_jam"), distance_m=10.0), 500)[0]
    farther = compare(replace(drive("links.preset=ieee80211p_jam"), distance_m=200.0), 500)[0]
    assert (nearer.figures[0].sample or 0.0) < (farther.figures[0].sample or 0.0)
