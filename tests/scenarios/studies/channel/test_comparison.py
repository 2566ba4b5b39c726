"""Laws against samples: closed forms of bursts and delays, and samples that follow them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.channel.build import link_effects
from scenarios.definition.channel.expected import expected_channel
from scenarios.definition.channel.presets import presets
from scenarios.definition.check.link_sample import StraightDrive
from scenarios.definition.scenario import load_scenario
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.studies.channel.comparison import Comparison, compare
from scenarios.studies.channel.predictions import burst_shares, delay_quantiles
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
def test_bursts_beside_independent_losses_are_those_of_the_hidden_chain(
    p: float, r: float, q: float
) -> None:
    """By hand for one message: it was let through before, is lost, and the next one passes."""
    table = gilbert(p, r, q)
    shares = burst_shares(expected_channel(table), link_effects(table, 20.0))
    assert shares is not None
    assert shares.sum() == pytest.approx(1.0)
    # Before a burst the chain is good. To one lost message: bad, or good and lost by itself.
    begins = p + (1.0 - p) * q
    one = (p * r + (1.0 - p) * q * (1.0 - p)) * (1.0 - q) / begins
    assert shares[0] == pytest.approx(one, rel=1e-6)


@pytest.mark.parametrize(
    "settings",
    [
        ("links.collisions={loss_ratio=0.2}",),
        ('links.loss={kind="every_nth",every_messages=4}', "links.loss_ratio=0.1"),
        ("links.preset=tunnel",),
        ("links.preset=clear",),
    ],
)
def test_of_other_bursts_nothing_is_told(settings: tuple[str, ...]) -> None:
    one = drive(*settings)
    assert burst_shares(expected_channel(one.table), one.effects()) is None


@pytest.mark.parametrize(
    "setting",
    [
        "links.jitter_ms=12",
        'links.delay={kind="gamma",mean_ms=30.0,deviation_ms=20.0}',
        'links.delay={kind="normal",mean_ms=30.0,deviation_ms=20.0}',
    ],
)
def test_quantiles_of_one_law_are_those_of_its_messages(setting: str) -> None:
    one, shares = drive(setting), (0.1, 0.5, 0.9)
    told = delay_quantiles(expected_channel(one.table), one.effects(), shares)
    assert told is not None
    delays = one.sample(4000).delay_ms
    within = [float((delays <= most).mean()) for most in told]
    assert within == pytest.approx(shares, abs=0.03)
    both = drive(setting, "links.content={reorder_ratio=0.1}")
    assert delay_quantiles(expected_channel(both.table), both.effects(), shares) is None


@pytest.mark.spread(5)
@pytest.mark.parametrize("name", presets())
def test_samples_of_presets_follow_their_laws(name: str) -> None:
    """Within intervals of 95 %, twice as wide for good measure."""
    found = compared(f"links.preset={name}", messages=1500)
    for one in (*found.figures[:2], *found.distances):
        if one.law is None or one.sample is None or one.low is None or one.high is None:
            continue
        reach = 2.5 * max(one.high - one.sample, one.sample - one.low) + 0.02
        wavering = 0.35 if name.startswith("nlosv") else 0.0  # few decorrelation distances
        assert abs(one.sample - one.law) < reach + wavering, one
    assert len(found.distances) == (10 if name.startswith(("ieee", "lte", "nlosv")) else 0)


def test_a_sample_is_what_a_run_s_link_does() -> None:
    """The verdicts of the scenario's own link, one by one."""
    one = drive("links.preset=bursty", "links.jitter_ms=5")
    link = Link(one.effects(), one.scenario.seed, "v1", "v4")
    verdicts = [link.judge(context) for context in one._contexts(500)]
    sample = one.sample(500)
    assert sample.lost.tolist() == [bool(verdict.reason) for verdict in verdicts]
    assert sample.dropped == {"burst": int(sample.lost.sum())}


def test_what_the_rate_holds_back_is_not_lost_and_wrong_bits_are() -> None:
    sample = drive("links.rate_hz=5.0", "links.content={bit_error_ratio=0.001}").sample(800)
    assert len(sample.lost) == 200
    assert sample.dropped["rate"] == 600
    assert sample.dropped["corrupted"] == sample.lost.sum() > 80


def test_a_link_that_loses_all_has_no_delays() -> None:
    found = compared("links.loss_ratio=1.0")
    figures = {one.figure: one for one in found.figures}
    assert figures["loss"].sample == 1.0
    assert figures["mean delay"].sample is None
    assert figures["lost in a row"].law is None


def test_bursts_are_shares_of_all_bursts() -> None:
    found = compared("links.loss_ratio=0.5")
    assert sum(one.sample or 0.0 for one in found.bursts) == pytest.approx(1.0)
    assert sum(one.law or 0.0 for one in found.bursts) == pytest.approx(1.0, abs=1e-3)
    nearer = compare(replace(drive("links.preset=ieee80211p_jam"), distance_m=10.0), 500)[0]
    farther = compare(replace(drive("links.preset=ieee80211p_jam"), distance_m=200.0), 500)[0]
    assert (nearer.figures[0].sample or 0.0) < (farther.figures[0].sample or 0.0)
