"""What links should achieve: by closed forms, by drawn chains, and by the very effects."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from scenarios.definition.channel.build import (
    USUAL_MESSAGE_BYTES,
    expected_channel,
    link_effects,
)
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.links import bursts
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import Link
from vehicles.schedule import MILLISECOND

GILBERT = {"kind": "gilbert_elliott", "loss_ratio": 0.2, "burst_messages_mean": 8.0}
FOUR = {
    "kind": "four_state", "gap_to_burst_ratio": 0.05, "burst_to_gap_ratio": 0.3,
    "lost_to_sent_ratio": 0.2, "sent_to_lost_ratio": 0.5, "isolated_loss_ratio": 0.02,
}  # fmt: skip
COLLISIONS = {"loss_ratio": 0.1, "keep_ratio": 0.4}
RATIOS = st.floats(0.02, 0.98)


def link_table(**keys: object) -> LinkTable:
    return LinkTable.model_validate(keys)


def drawn_fates(table: LinkTable, count: int, seed: int = 3) -> NDArray[np.bool_]:
    """Which messages the effects of a link lose, one after the other."""
    link = Link(link_effects(table, 20.0), seed, "v1", "v2")
    reasons = [
        link.judge(TransmissionContext(seq, seq * 50 * MILLISECOND)).reason for seq in range(count)
    ]
    return np.array([bool(one) for one in reasons])


@given(RATIOS, RATIOS, RATIOS)
def test_a_chain_beside_independent_losses_has_the_burst_of_its_transitions(
    p: float, r: float, q: float
) -> None:
    """By hand: a burst ends from bad to good, or from a loss in good, where the next one passes."""
    law = {"kind": "gilbert_elliott", "good_to_bad_ratio": p, "bad_to_good_ratio": r}
    found = expected_channel(link_table(loss=law, loss_ratio=q))
    bad = p / (p + r)
    loss = bad + (1.0 - bad) * q
    ends = (bad * r + (1.0 - bad) * q * (1.0 - p)) * (1.0 - q)
    assert found.loss_ratio == pytest.approx(loss, rel=1e-9)
    assert found.burst_messages == pytest.approx(loss / ends, rel=1e-6)


@pytest.mark.parametrize(
    "keys",
    [
        {"loss": GILBERT, "collisions": COLLISIONS, "loss_ratio": 0.1},
        {"loss": FOUR, "loss_ratio": 0.1},
        {"loss": FOUR, "collisions": COLLISIONS},
        {"loss": {"kind": "every_nth", "every_messages": 7}, "loss_ratio": 0.2},
    ],
)
@pytest.mark.campaign(20_000, 100_000)
def test_laws_together_lose_as_their_effects_do(keys: dict[str, object], campaign: int) -> None:
    table = link_table(**keys)
    found, lost = expected_channel(table), drawn_fates(table, campaign)
    assert found.loss_ratio is not None
    assert found.burst_messages is not None
    lengths = bursts(lost)
    error = lengths.std() / sqrt(len(lengths))
    spread = found.loss_ratio * (1.0 - found.loss_ratio) * 2.0 * lengths.mean()
    assert abs(lost.mean() - found.loss_ratio) < 4.0 * sqrt(spread / campaign)
    assert abs(lengths.mean() - found.burst_messages) < 4.5 * error


@pytest.mark.parametrize(
    ("keys", "is_known"),
    [
        ({"radio": {"kind": "table", "distance_m": [0.0], "delivery_ratio": [0.9]}}, False),
        ({"outages": [{"kind": "window", "from_s": 1.0, "to_s": 2.0}]}, False),
        ({"queue": {"bytes_per_s": 5000.0}}, False),
        ({"loss": {"kind": "listed", "lost_numbers": "3"}}, False),
        ({"loss": {"kind": "log", "delays_ns": "20000000x9"}}, False),
        ({"content": {"bit_error_ratio": 1e-4, "frame_check": False}}, False),
        ({"loss": {"kind": "every_nth", "every_messages": 4}, "rate_hz": 5.0}, False),
        ({"loss": {"kind": "every_nth", "every_messages": 4}}, True),
        ({"content": {"bit_error_ratio": 1e-4}}, True),
        ({"loss": GILBERT, "rate_hz": 10.0}, True),
    ],
)
def test_a_loss_that_depends_on_more_than_the_laws_is_unknown(
    keys: dict[str, object], is_known: bool
) -> None:
    found = expected_channel(link_table(**keys, loss_ratio=0.1))
    assert (found.loss_ratio is not None) == is_known
    if not is_known:
        assert found.burst_messages is None


def test_wrong_bits_count_as_losses() -> None:
    found = expected_channel(link_table(content={"bit_error_ratio": 1e-3}, loss_ratio=0.2))
    assert found.loss_ratio == pytest.approx(1.0 - 0.8 * 0.999 ** (8 * USUAL_MESSAGE_BYTES))


LARGEST_INFLATION = 3.0  # Of the variance of a mean, (1 + ρ) / (1 - ρ) at a correlation of 0.5
DELAYS = [
    {"jitter_ms": 12.0},
    {"jitter_ms": 12.0, "delay": {"kind": "uniform", "delay_ms_max": 30.0}},
    {"delay": {"kind": "gamma", "mean_ms": 30.0, "deviation_ms": 20.0, "correlation_ratio": 0.5}},
    {"content": {"reorder_ratio": 0.2, "reorder_delay_ms": 80.0}, "jitter_ms": 5.0},
]


@pytest.mark.parametrize("keys", DELAYS)
def test_delays_add_up(keys: dict[str, object]) -> None:
    table = link_table(**keys)
    found, link = expected_channel(table), Link(link_effects(table, 20.0), 5, "v1", "v2")
    delays = np.array(
        [link.judge(TransmissionContext(seq, 0)).visible_at / 1e6 for seq in range(8000)]
    )
    assert found.latency_ms_mean is not None
    assert found.latency_ms_deviation is not None
    error = found.latency_ms_deviation * sqrt(LARGEST_INFLATION / len(delays))
    assert abs(delays.mean() - found.latency_ms_mean) < 4.0 * error
    assert delays.std() == pytest.approx(found.latency_ms_deviation, rel=0.06)
