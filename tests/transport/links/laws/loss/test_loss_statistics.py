"""All laws of loss against closed forms: loss, autocorrelation and length of bursts."""

import numpy as np
import pytest

from tests.made.channels.laws import collisions, four_state, gilbert, gilbert_elliott, long_run
from tests.transport.links.laws.loss.hidden_chain import (
    HiddenChain,
    good_and_bad,
    independent,
    netem_states,
    reservations,
)
from transport.links.laws.basic import Loss
from transport.links.laws.link_law import Effect, TransmissionContext
from transport.links.link import keyed_draw

SEEDS = (1, 2, 3)


def bursty(p: float, r: float, h: float = 0.0, k: float = 1.0) -> tuple[Effect, HiddenChain]:
    return gilbert_elliott(p, r, h, k), good_and_bad(p, r, h, k)


def four(
    p13: float, p31: float, p32: float = 0.0, p23: float = 1.0, p14: float = 0.0
) -> tuple[Effect, HiddenChain]:
    return four_state(p13, p31, p32, p23, p14), netem_states(p13, p31, p32, p23, p14)


def colliding(loss: float, keep: float, least: int, most: int) -> tuple[Effect, HiddenChain]:
    return collisions(loss, keep, least, most), reservations(loss, keep, least, most)


LAWS: dict[str, tuple[Effect, HiddenChain]] = {
    "independent": (Loss(0.2), independent(0.2)),
    "bursts of four": bursty(0.25 / 9, 0.25),
    "by mean values": (gilbert(0.2, 6.0), good_and_bad(1 / 24, 1 / 6)),
    "long bursts": bursty(0.01, 0.05),
    "losses in both states": bursty(0.05, 0.3, 0.25, 0.98),
    "in turn more often than not": bursty(0.8, 0.7),
    "in turn, with chance": bursty(0.6, 0.9, 0.1, 0.9),
    "without memory": bursty(0.3, 0.7),
    "four states": four(0.03, 0.2, 0.15, 0.4, 0.02),
    "four states, mostly alone": four(0.005, 0.3, 0.1, 0.3, 0.08),
    "four states, never twice": four(0.1, 0.6, 0.4, 0.7, 0.05),
    "four states that are two": four(0.04, 0.3),
    "isolated losses": (four_state(0.0, 1.0, p14=0.1), netem_states(0.0, 1.0, 0, 1, 0.1)),
    "collisions": colliding(0.2, 0.0, 5, 15),
    "collisions that stay": colliding(0.3, 0.4, 5, 15),
    "collisions of a short period": colliding(0.4, 0.0, 1, 3),
}


def lost(law: Effect, seed: int, count: int) -> np.ndarray:
    draw = keyed_draw(seed, "lead", "follower_1")
    return np.array([law.judge(draw, TransmissionContext(seq, 0)) != 0 for seq in range(count)])


@pytest.mark.campaign(8_000, 100_000)
def test_samples_agree_with_the_closed_forms(campaign: int) -> None:
    errors: dict[str, float] = {}
    for name, (law, closed) in LAWS.items():
        for seed in SEEDS:
            for comparison in closed.compared(lost(law, seed, campaign)):
                errors[f"{name}, seed {seed}: {comparison.label}"] = comparison.errors
    far = {label: error for label, error in errors.items() if abs(error) > 3.5}
    assert len(errors) > 500
    assert len(far) <= 0.01 * len(errors), far
    assert max(map(abs, errors.values())) < 5.5, far
    # and the deviations are not too large
    assert 0.8 < np.std(list(errors.values())) < 1.2


@pytest.mark.campaign(20_000, 200_000)
@pytest.mark.parametrize("keep", [0.4, 0.8])
def test_resources_that_are_kept_collide_for_longer(keep: float, campaign: int) -> None:
    """Bursts are too few and too long to be counted by length."""
    law, closed = colliding(0.1, keep, 5, 15)
    errors = [
        comparison.errors
        for seed in SEEDS
        for comparison in closed.compared(lost(law, seed, campaign))
        if not comparison.label.startswith("bursts")
    ]
    assert max(map(abs, errors)) < 4.0


@pytest.mark.parametrize("name", LAWS)
def test_losses_agree_with_their_law(name: str) -> None:
    law, closed = LAWS[name]
    assert long_run(law)[0] == pytest.approx(closed.mean, rel=1e-9)
    assert long_run(law)[1] == pytest.approx(closed.burst, rel=1e-9)


@pytest.mark.parametrize(
    ("law", "wrong"),
    [
        (LAWS["bursts of four"][0], good_and_bad(0.25 / 9 * 1.15, 0.25 * 1.15)),
        (LAWS["four states"][0], netem_states(0.03, 0.2, 0.15, 0.6, 0.02)),
        (LAWS["collisions"][0], reservations(0.2, 0.0, 5, 13)),
        (LAWS["independent"][0], independent(0.21)),
    ],
)
def test_a_law_that_is_a_little_different_is_found_out(law: Effect, wrong: HiddenChain) -> None:
    errors = [abs(comparison.errors) for comparison in wrong.compared(lost(law, 1, 60_000))]
    assert max(errors) > 4.0


@pytest.mark.parametrize(("p", "r"), [(0.02, 0.3), (0.5, 0.1), (0.9, 0.8)])
def test_the_closed_forms_are_the_textbook_s(p: float, r: float) -> None:
    closed = good_and_bad(p, r)
    assert closed.mean == pytest.approx(p / (p + r))
    assert closed.burst == pytest.approx(1.0 / r)
    for lag in (1, 2, 7):
        assert closed.autocorrelation(lag) == pytest.approx((1 - p - r) ** lag)
    assert reservations(0.2, 0.8, 5, 15).mean == pytest.approx(0.2)
    assert reservations(0.2, 0.8, 5, 15).burst == pytest.approx(10.0 / (0.2 * 0.8))
