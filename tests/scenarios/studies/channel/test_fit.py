"""Fits recover the parameters of made links, with errors of the stated size."""

import tomllib
from collections.abc import Callable
from math import log1p, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.definition.schema.link_tables import LinkEntry
from scenarios.studies.channel.fit import FittedLink, as_toml, fit_link
from scenarios.studies.channel.recorded import Estimate, RecordedLink

Floats = NDArray[np.float64]
PERIOD = 0.05
RUNS = 40


def link(
    reason: list[str] | NDArray[np.str_],
    delay_ms: Floats | None = None,
    distance_m: Floats | None = None,
) -> RecordedLink:
    count = len(reason)
    return RecordedLink(
        "v1",
        "v2",
        np.arange(count),
        np.arange(count, dtype=np.float64) * PERIOD,
        np.full(count, 20.0) if delay_ms is None else delay_ms,
        np.full(count, 15.0, np.float64) if distance_m is None else distance_m,
        np.array(reason, dtype=np.str_),
    )


def of(fitted: FittedLink, key: str) -> Estimate:
    return next(estimate for estimate in fitted.estimates if estimate.key == key)


def chain(random: np.random.Generator, count: int, p: float, r: float) -> NDArray[np.str_]:
    bad = random.random() < p / (p + r)
    fates = []
    for _ in range(count):
        fates.append("burst" if bad else "")
        bad = random.random() >= r if bad else random.random() < p
    return np.array(fates, dtype=np.str_)


def scores(draw: Callable[[np.random.Generator], Estimate], truth: float) -> Floats:
    estimates = [draw(np.random.default_rng(seed)) for seed in range(RUNS)]
    return np.array([(estimate.value - truth) / estimate.error for estimate in estimates])


def check(normal_scores: Floats) -> None:
    assert abs(normal_scores.mean()) < 3.3 / sqrt(RUNS) + 0.1
    assert 0.7 < normal_scores.std() < 1.35
    assert np.abs(normal_scores).max() < 4.5


@pytest.mark.parametrize(("loss", "burst"), [(0.2, 8.0), (0.4, 4.0), (0.05, 2.0)])
def test_bursts_are_fitted_with_calibrated_errors(loss: float, burst: float) -> None:
    r = 1.0 / burst
    p = r * loss / (1.0 - loss)

    def fitted(key: str) -> Callable[[np.random.Generator], Estimate]:
        return lambda random: of(fit_link(link(chain(random, 5000, p, r))), key)

    check(scores(fitted("loss.loss_ratio"), loss))
    check(scores(fitted("loss.burst_messages_mean"), burst))


def test_a_loss_ratio_refers_to_messages_that_earlier_laws_passed() -> None:
    def draw(random: np.random.Generator) -> RecordedLink:
        fates = chain(random, 4000, 0.05, 0.2)  # judges after the independent loss
        fates[random.random(4000) < 0.3] = "loss"
        fates[1::2] = "rate"
        return link(fates)

    check(scores(lambda random: of(fit_link(draw(random)), "loss_ratio"), 0.3))
    assert fit_link(draw(np.random.default_rng(1))).keys["rate_hz"] == pytest.approx(10.0)


@pytest.mark.campaign(1, 4)
@pytest.mark.parametrize("kind", ["gamma", "lognormal", "normal"])
def test_a_delay_law_is_fitted_with_its_floor(kind: str, campaign: int) -> None:
    floor, mean, count = 20.0, 40.0, 2000
    deviation = 8.0 if kind == "normal" else 25.0

    def draw(random: np.random.Generator) -> Floats:
        if kind == "gamma":
            shape = (mean / deviation) ** 2
            return floor + random.gamma(shape, mean / shape, count)
        if kind == "lognormal":
            variance = log1p((deviation / mean) ** 2)
            middle = np.log(mean) - 0.5 * variance
            return floor + random.lognormal(middle, sqrt(variance), count)
        return floor + random.normal(mean, deviation, count)

    for seed in range(campaign):
        delays = draw(np.random.default_rng(seed))
        fitted = fit_link(link([""] * count, delays))
        fitted_mean = fitted.keys["latency_ms"] + fitted.keys["delay"]["mean_ms"]
        assert fitted_mean == pytest.approx(floor + mean, abs=4.0 * deviation / sqrt(count))
        if kind != "normal":  # a gamma law of large shape is nearly normal
            assert fitted.keys["delay"]["kind"] == kind
            assert abs(of(fitted, "latency_ms").value - floor) < 4 * of(fitted, "latency_ms").error


def test_uniform_delays_give_a_floor_and_jitter() -> None:
    delays = 60.0 + 80.0 * np.random.default_rng(2).random(2000)
    fitted = fit_link(link([""] * 2000, delays))
    assert fitted.keys["latency_ms"] == pytest.approx(60.0, abs=0.2)
    assert fitted.keys["jitter_ms"] == pytest.approx(80.0, abs=0.4)


def test_the_correlation_of_delays_is_fitted() -> None:
    random, count, rho = np.random.default_rng(8), 2000, 0.6
    normal = np.empty(count)
    normal[0] = random.standard_normal()
    for k in range(1, count):
        normal[k] = rho * normal[k - 1] + sqrt(1 - rho * rho) * random.standard_normal()
    fitted = fit_link(link([""] * count, 20.0 + np.exp(3.0 + 0.4 * normal)))
    estimate = of(fitted, "delay.correlation_ratio")
    assert abs(estimate.value - rho) < 4.0 * estimate.error
    assert fitted.keys["delay"]["kind"] == "lognormal"


def test_delays_on_an_ordered_link_are_fitted_as_censored() -> None:
    random, count = np.random.default_rng(5), 600
    own = 20.0 + random.gamma(2.25, 60.0 / 2.25, count)
    sent = np.arange(count) * PERIOD * 1e3
    fitted = fit_link(link([""] * count, np.maximum.accumulate(sent + own) - sent))
    assert fitted.keys["delay"]["order"] == "in_order"
    assert fitted.keys["delay"]["kind"] == "gamma"
    for key, truth in (("delay.mean_ms", 60.0), ("delay.deviation_ms", 40.0)):
        assert abs(of(fitted, key).value - truth) < 4.0 * of(fitted, key).error


def test_delays_that_no_law_fits_are_kept_as_recorded() -> None:
    random = np.random.default_rng(3)
    delays = np.where(random.random(1000) < 0.5, 20.0, 90.0) + random.random(1000)
    fitted = fit_link(link([""] * 1000, delays))
    assert fitted.keys["delay"]["kind"] == "empirical"
    assert np.mean(fitted.keys["delay"]["recorded_ms"]) + fitted.keys["latency_ms"] == (
        pytest.approx(delays.mean(), abs=0.5)
    )


def test_delivery_over_distance_is_fitted() -> None:
    random, count = np.random.default_rng(6), 20_000
    distance = random.uniform(50.0, 250.0, count)
    delivered = np.clip(1.2 - distance / 250.0, 0.0, 1.0)
    fates = np.where(random.random(count) < delivered, "", "range")
    table = fit_link(link(fates, distance_m=distance)).keys["radio"]
    rows = zip(table["distance_m"][:-1], table["delivery_ratio"][:-1], strict=True)
    assert all(abs(ratio - min(1.0, 1.2 - at / 250.0)) < 0.07 for at, ratio in rows)
    assert len(table["distance_m"]) > 20


def test_an_outage_is_fitted_as_a_window() -> None:
    fates = [""] * 100 + ["outage"] * 60 + [""] * 40
    (window,) = fit_link(link(fates)).keys["outages"]
    assert window == {"kind": "window", "from_s": 5.0, "to_s": 8.0}


def test_the_toml_block_is_an_entry_of_a_scenario() -> None:
    random = np.random.default_rng(7)
    fitted = fit_link(link(chain(random, 2000, 0.05, 0.25), 20.0 + random.gamma(3.0, 5.0, 2000)))
    text = as_toml((fitted,))
    (entry,) = tomllib.loads(text)["link"]
    assert entry["sender"] == "v1"
    assert "95 % intervals" in text
    assert {"sender", "receiver"} <= set(LinkEntry.model_fields)


def test_constant_delays_give_the_latency_only() -> None:
    assert fit_link(link([""] * 300)).keys == {"latency_ms": 20.0}
