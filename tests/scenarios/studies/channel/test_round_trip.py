"""What is found of the channel of each preset is that channel, and drawn again it is the same.

By default three presets over a short drive; `--campaign` takes them all, and long ones.
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
from scenarios.results.channel.estimates import bursts
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from scenarios.studies.channel.fitting.estimate import Estimate
from scenarios.studies.channel.fitting.fit import FittedLink, as_toml, fit_link, fit_log
from scenarios.studies.channel.fitting.recorded import RecordedLink
from tests.scenarios.studies.channel.recorded_channels import long_drive, recorded_links_of
from transport.links.laws.delay.distributions import GammaDelay
from transport.links.laws.loss.bursts import GilbertElliott
from transport.links.laws.radio.obstruction import LossPerVehicle, SingleLoss
from transport.links.laws.radio.path_loss import PathLossRadio, highway_loss
from transport.links.laws.radio.reservations import Reservations

Counts = NDArray[np.float64]
Measure = Callable[[Counts, Counts], Counts]
FIRST = ("bursty", "lte_v2x_oneshot", "nlosv_etsi")
ORDERED = (*FIRST, *(name for name in presets() if name not in FIRST))
FEW, MANY = 4000, 20_000
"""Messages of each link."""
BLOCKS, SHUFFLES = 20, 10_000
CERTAIN = 1e-3
BURSTS = np.array([1, 2, 3, 5, 9, 17, 33, 65, 10**9]) - 0.5
"""Lengths of bursts that are counted together."""


@pytest.mark.campaign(len(FIRST), len(ORDERED))
def test_the_channel_of_a_preset_is_found_and_drawn_again(
    case: int, request: pytest.FixtureRequest
) -> None:
    whole = request.config.getoption("--campaign")
    name, messages = ORDERED[case], MANY if whole else FEW
    asked = long_drive(f'[links]\npreset = "{name}"')
    pairs = list(asked.links) if whole else [("v1", "v4"), ("v3", "v4")]
    recorded = recorded_links_of(asked, messages, 1, pairs)
    fitted = tuple(map(fit_link, recorded))
    scores = [abs(score) for one in fitted for score in off_by(asked, one)]
    assert sum(score > 3.0 for score in scores) <= ceil(0.01 * len(scores)), sorted(scores)[-5:]
    assert max(scores, default=0.0) < 5.0
    again = recorded_links_of(long_drive(as_toml(fitted)), messages, 2, pairs)
    for pair, before, after in zip(pairs, recorded, again, strict=True):
        chances = alike(before, after)
        assert min(chances.values()) >= CERTAIN / len(chances), (pair, chances)


# ---- Parameters


def off_by(asked: Scenario, found: FittedLink) -> Iterator[float]:
    """By how many standard errors each estimate is off.

    Not compared are windows, but by what they lose, and a table that stands for too few losses.
    """
    table = asked.links[found.sender, found.receiver]
    apart = asked.vehicle(found.receiver).place - asked.vehicle(found.sender).place
    for one in found.estimates:
        if one.key.startswith("outages"):
            continue
        if isinstance(table.radio, PathLossRadio) and "given as a table" in " ".join(found.notes):
            continue
        truth = true_value(table, one, apart - 1)
        if one.error == 0.0:
            assert one.value == pytest.approx(truth, abs=1e-6)
        else:
            yield (one.value - truth) / one.error


def true_value(table: LinkTable, one: Estimate, between: int) -> float:
    """What was asked for, in the words of an estimate."""
    key = one.key.removeprefix("loss.").removeprefix("delay.").removeprefix("radio.")
    if one.key in {"loss_ratio", "latency_ms"}:
        return float(getattr(table, one.key))
    if isinstance(table.loss, GilbertElliott) and one.key.startswith("loss."):
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
    """One law for the way and the vehicles on it: what they cost, and how that wavers."""
    assert radio.shadowing is not None
    wavering, cost, median = radio.shadowing.deviation_db, 0.0, radio.errors.snr_db[0]
    if between:
        wavering, median = (
            radio.shadowing.obstructed_deviation_db,
            radio.errors.obstructed_snr_db[0],
        )
        if isinstance(radio.obstruction, LossPerVehicle):
            cost = between * radio.obstruction.loss_db
        elif isinstance(radio.obstruction, SingleLoss):
            cost = radio.obstruction.mean_db
            wavering = hypot(wavering, radio.obstruction.deviation_db)
    usual = PathLossRadio().reference_loss_db
    beyond = highway_loss(radio.frequency_hz) - usual + median - 1.0
    return {
        "power_dbm": radio.power_dbm - cost - beyond,
        "exponent": 2.0,
        "shadowing.deviation_db": wavering,
        "shadowing.decorrelation_m": radio.shadowing.decorrelation_m,
    }


# ---- Two samples


def alike(one: RecordedLink, other: RecordedLink) -> dict[str, float]:
    """Chances of two links to differ so much if they are one channel, by what is looked at.

    Both were judged at the same distances, so pieces of the drive can be swapped between them: that
    is an exact test as long as a piece is long against what ties messages together.
    """
    delays = np.concatenate([one.delay_ms, other.delay_ms])
    edges = np.unique(np.quantile(delays, np.linspace(0.0, 1.0, 100)))
    both = [(histogram_of_losses(link), histogram_of_bursts(link), histogram_of_delays(link, edges))
            for link in (one, other)]  # fmt: skip
    words = ("share lost", "lengths of bursts", "delays")
    measures = (kolmogorov_smirnov, chi_square, kolmogorov_smirnov)
    return {
        word: chance(before, after, measure)
        for word, measure, before, after in zip(words, measures, *both, strict=True)
    }


def chance(one: Counts, other: Counts, measure: Measure) -> float:
    """Share of random swaps of pieces after which two samples differ as much as they do."""
    signs = np.random.default_rng(1).choice([-1.0, 1.0], (SHUFFLES, len(one)))
    signs[0] = 1.0
    found = measure(signs @ (one - other), (one + other).sum(axis=0))
    return float((found >= found[0] - 1e-9).mean())


def kolmogorov_smirnov(differences: Counts, _total: Counts) -> Counts:
    found: Counts = np.abs(np.cumsum(differences, axis=1)).max(axis=1)
    return found


def chi_square(differences: Counts, total: Counts) -> Counts:
    found: Counts = (differences**2 / np.maximum(total, 1.0)).sum(axis=1)
    return found


def histogram(at: NDArray[np.intp], values: Counts, edges: Counts, count: int) -> Counts:
    """Count values for each piece of the drive; `at` are places among its `count` messages."""
    found = np.zeros((BLOCKS, len(edges) + 1))
    np.add.at(found, (at * BLOCKS // count, np.searchsorted(edges, values)), 1.0)
    return found


def histogram_of_losses(link: RecordedLink) -> Counts:
    lost = np.flatnonzero(~link.delivered)
    return histogram(lost, np.zeros(len(lost)), np.zeros(0), len(link.number))


def histogram_of_bursts(link: RecordedLink) -> Counts:
    lost = ~link.delivered
    begin = np.flatnonzero(np.diff(np.concatenate(([False], lost)).astype(int)) == 1)
    return histogram(begin, bursts(lost).astype(float), BURSTS, len(lost))


def histogram_of_delays(link: RecordedLink, edges: Counts) -> Counts:
    there = np.flatnonzero(link.delivered)
    return histogram(there, link.delay_ms[there], edges, len(link.number))


def test_the_test_tells_channels_apart_that_are_not_the_same() -> None:
    def link(text: str, seed: int) -> RecordedLink:
        (one,) = recorded_links_of(long_drive(f"[links]\n{text}"), FEW, seed, [("v1", "v2")])
        return one

    lossy = link("loss_ratio = 0.2", 1)
    assert min(alike(lossy, link("loss_ratio = 0.2", 2)).values()) > 0.01
    assert alike(lossy, link("loss_ratio = 0.3", 2))["share lost"] < CERTAIN
    assert alike(lossy, link("latency_ms = 21.0\nloss_ratio = 0.2", 2))["delays"] < CERTAIN
    ge = 'loss = {{ kind = "gilbert_elliott", loss_ratio = 0.2, burst_messages_mean = {} }}'
    found = alike(link(ge.format(2.0), 1), link(ge.format(3.0), 2))
    assert found["lengths of bursts"] < CERTAIN


# ---- From logs


@cache
def shipped(preset: str) -> Scenario:
    settings = [f"links.preset={preset}", "duration_s=30", "convoy.vehicles=3"]
    return load_scenario("lane_change", settings)


@pytest.mark.spread(1)
@pytest.mark.parametrize("preset", ["bursty", "ieee80211p_jam"])
def test_a_log_gives_a_block_that_runs(preset: str, tmp_path: Path) -> None:
    asked = shipped(preset)
    run_virtual(asked, tmp_path / "run", Stop())
    fitted = fit_log(tmp_path / "run" / "run.mcap")
    assert [(one.sender, one.receiver) for one in fitted] == list(asked.links)
    scores = [abs(score) for one in fitted for score in off_by(asked, one)]
    assert max(scores) < 4.0
    again = scenario_from_text(f'extends = "lane_change"\nname = "again"\n{as_toml(fitted)}')
    for pair in asked.links:
        table = again.links[pair]
        if preset == "bursty":
            assert isinstance(table.loss, GilbertElliott), pair
        else:
            assert table.radio is not None, pair
