"""Fits recover the channel of each preset, and a sample of the fit equals the original.

By default three presets on a short drive; `--campaign` runs all of them on a long one.
"""

from collections.abc import Callable, Iterator
from functools import cache
from math import ceil, hypot
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.definition.channel.presets import presets
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.links import bursts
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.channel.fit import FittedLink, as_toml, fit_link, fit_log
from scenarios.studies.channel.recorded import RecordedLink
from tests.scenarios.studies.channel.recorded_channels import long_drive, recorded_links_of
from transport.links.laws.burst_losses import GilbertElliott
from transport.links.laws.delays import GammaDelay
from transport.links.laws.radio import LossPerVehicle, PathLossRadio, SingleLoss, highway_loss
from transport.links.laws.shared_channel import Reservations

Counts = NDArray[np.float64]
Measure = Callable[[Counts, Counts], Counts]
FIRST = ("bursty", "lte_v2x_oneshot")
ORDERED = (*FIRST, *(name for name in presets() if name not in FIRST and "nlosv" not in name))
"""Shadowing of a preset becomes a table with bursts, which is not the same channel."""
FEW, MANY = 4000, 20_000
"""Messages per link."""
BLOCKS, SHUFFLES = 20, 10_000
SIGNIFICANCE = 1e-3
BURSTS = np.array([1, 2, 3, 5, 9, 17, 33, 65, 10**9]) - 0.5
"""Edges of the bins of burst lengths."""


@pytest.mark.campaign(len(FIRST), len(ORDERED))
def test_the_fit_of_a_preset_reproduces_its_channel(
    case: int, request: pytest.FixtureRequest
) -> None:
    whole = request.config.getoption("--campaign")
    name, messages = ORDERED[case], MANY if whole else FEW
    scenario = long_drive(f'[links]\npreset = "{name}"')
    pairs = list(scenario.links) if whole else [("v1", "v4"), ("v3", "v4")]
    recorded = recorded_links_of(scenario, messages, 1, pairs)
    fitted = tuple(map(fit_link, recorded))
    scores = [abs(score) for link in fitted for score in scores_of(scenario, link)]
    assert sum(score > 3.0 for score in scores) <= ceil(0.01 * len(scores)), sorted(scores)[-5:]
    assert max(scores, default=0.0) < 5.0
    again = recorded_links_of(long_drive(as_toml(fitted)), messages, 2, pairs)
    for pair, before, after in zip(pairs, recorded, again, strict=True):
        p_values = compare_links(before, after)
        assert min(p_values.values()) >= SIGNIFICANCE / len(p_values), (pair, p_values)


# ---- Parameters


def scores_of(scenario: Scenario, fitted: FittedLink) -> Iterator[float]:
    """Error of each estimate, in standard errors.

    Outages are compared by their losses only; tables that replace shadowing are not compared.
    """
    table = scenario.links[fitted.sender, fitted.receiver]
    apart = scenario.vehicle(fitted.receiver).place - scenario.vehicle(fitted.sender).place
    for estimate in fitted.estimates:
        if estimate.key.startswith("outages"):
            continue
        if isinstance(table.radio, PathLossRadio) and "given as a table" in " ".join(fitted.notes):
            continue
        truth = true_value(table, estimate.key, apart - 1)
        if estimate.error == 0.0:
            assert estimate.value == pytest.approx(truth, abs=1e-6)
        else:
            yield (estimate.value - truth) / estimate.error


def true_value(table: LinkTable, full_key: str, between: int) -> float:
    key = full_key.removeprefix("loss.").removeprefix("delay.").removeprefix("radio.")
    if full_key in {"loss_ratio", "latency_ms"}:
        return float(getattr(table, full_key))
    if isinstance(table.loss, GilbertElliott) and full_key.startswith("loss."):
        loss, burst = table.loss.loss_ratio or 0.0, table.loss.burst_messages_mean or 1.0
        derived = {"good_to_bad_ratio": loss / (1.0 - loss) / burst, "bad_to_good_ratio": 1 / burst}
        return float(derived.get(key) or getattr(table.loss, key))
    if isinstance(table.delay, GammaDelay):
        return float(getattr(table.delay, key))
    if isinstance(table.radio, PathLossRadio):
        return path_loss_values(table.radio, between)[key]
    assert table.radio is not None
    law = table.radio
    if key.startswith("delivery_ratio at "):
        return law.ratio(float(key.split()[2]))
    assert isinstance(law.reservations, Reservations)
    return law.reservations.mean_messages


def path_loss_values(radio: PathLossRadio, between: int) -> dict[str, float]:
    assert radio.shadowing is not None
    deviation, obstruction, median = radio.shadowing.deviation_db, 0.0, radio.errors.snr_db[0]
    if between:
        deviation, median = (
            radio.shadowing.obstructed_deviation_db,
            radio.errors.obstructed_snr_db[0],
        )
        if isinstance(radio.obstruction, LossPerVehicle):
            obstruction = between * radio.obstruction.loss_db
        elif isinstance(radio.obstruction, SingleLoss):
            obstruction = radio.obstruction.mean_db
            deviation = hypot(deviation, radio.obstruction.deviation_db)
    reference = PathLossRadio().reference_loss_db
    shift = highway_loss(radio.frequency_hz) - reference + median - 1.0
    return {
        "power_dbm": radio.power_dbm - obstruction - shift,
        "exponent": 2.0,
        "shadowing.deviation_db": deviation,
        "shadowing.decorrelation_m": radio.shadowing.decorrelation_m,
    }


# ---- Two samples


def compare_links(first: RecordedLink, second: RecordedLink) -> dict[str, float]:
    """p-values of the hypothesis that two links are the same channel, by measure.

    Both links were judged at the same distances, so swapping parts of the drive between them is an
    exact permutation test, if parts are long compared with the correlation of messages.
    """
    delays = np.concatenate([first.delay_ms, second.delay_ms])
    edges = np.unique(np.quantile(delays, np.linspace(0.0, 1.0, 100)))
    both = [(histogram_of_losses(link), histogram_of_bursts(link), histogram_of_delays(link, edges))
            for link in (first, second)]  # fmt: skip
    names = ("share lost", "lengths of bursts", "delays")
    measures = (kolmogorov_smirnov, chi_square, kolmogorov_smirnov)
    return {
        name: p_value(before, after, measure)
        for name, measure, before, after in zip(names, measures, *both, strict=True)
    }


def p_value(first: Counts, second: Counts, measure: Measure) -> float:
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (SHUFFLES, len(first)))
    signs[0] = 1.0
    differences = measure(signs @ (first - second), (first + second).sum(axis=0))
    return float((differences >= differences[0] - 1e-9).mean())


def kolmogorov_smirnov(differences: Counts, _total: Counts) -> Counts:
    largest: Counts = np.abs(np.cumsum(differences, axis=1)).max(axis=1)
    return largest


def chi_square(differences: Counts, total: Counts) -> Counts:
    statistic: Counts = (differences**2 / np.maximum(total, 1.0)).sum(axis=1)
    return statistic


def histogram(at: NDArray[np.intp], values: Counts, edges: Counts, count: int) -> Counts:
    counts = np.zeros((BLOCKS, len(edges) + 1))
    np.add.at(counts, (at * BLOCKS // count, np.searchsorted(edges, values)), 1.0)
    return counts


def histogram_of_losses(link: RecordedLink) -> Counts:
    lost = np.flatnonzero(~link.delivered)
    return histogram(lost, np.zeros(len(lost)), np.zeros(0), len(link.number))


def histogram_of_bursts(link: RecordedLink) -> Counts:
    lost = ~link.delivered
    begin = np.flatnonzero(np.diff(np.concatenate(([False], lost)).astype(int)) == 1)
    return histogram(begin, bursts(lost).astype(float), BURSTS, len(lost))


def histogram_of_delays(link: RecordedLink, edges: Counts) -> Counts:
    delivered = np.flatnonzero(link.delivered)
    return histogram(delivered, link.delay_ms[delivered], edges, len(link.number))


def test_different_channels_have_small_p_values() -> None:
    def link(text: str, seed: int) -> RecordedLink:
        (recorded,) = recorded_links_of(long_drive(f"[links]\n{text}"), FEW, seed, [("v1", "v2")])
        return recorded

    lossy, late = link("loss_ratio = 0.2", 1), link("latency_ms = 21.0\nloss_ratio = 0.2", 2)
    assert min(compare_links(lossy, link("loss_ratio = 0.2", 2)).values()) > 0.01
    assert compare_links(lossy, link("loss_ratio = 0.3", 2))["share lost"] < SIGNIFICANCE
    assert compare_links(lossy, late)["delays"] < SIGNIFICANCE
    ge = 'loss = {{ kind = "gilbert_elliott", loss_ratio = 0.2, burst_messages_mean = {} }}'
    p_values = compare_links(link(ge.format(2.0), 1), link(ge.format(3.0), 2))
    assert p_values["lengths of bursts"] < SIGNIFICANCE


# ---- From logs


@cache
def shipped(preset: str) -> Scenario:
    settings = [f"links.preset={preset}", "duration_s=30", "convoy.vehicles=3"]
    return load_scenario("lane_change", settings)


@pytest.mark.spread(1)
@pytest.mark.parametrize("preset", ["bursty", "ieee80211p_jam"])
def test_the_fit_of_a_log_is_a_valid_scenario(preset: str, tmp_path: Path) -> None:
    scenario = shipped(preset)
    run_virtual(scenario, tmp_path / "run", Stop())
    fitted = fit_log(tmp_path / "run" / "run.mcap")
    assert [(link.sender, link.receiver) for link in fitted] == list(scenario.links)
    scores = [abs(score) for link in fitted for score in scores_of(scenario, link)]
    assert max(scores) < 4.0
    again = scenario_from_text(f'extends = "lane_change"\nname = "again"\n{as_toml(fitted)}')
    for pair in scenario.links:
        table = again.links[pair]
        if preset == "bursty":
            assert isinstance(table.loss, GilbertElliott), pair
        else:
            assert table.radio is not None, pair
