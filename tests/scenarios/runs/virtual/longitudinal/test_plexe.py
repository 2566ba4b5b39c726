"""Runs of Plexe's scenarios against an independent integration, and their string stability.

The integration (`integrated_string`) has the sampling and the delays of the run: control at 50 Hz,
beacons at 10 Hz with 20 ms of latency, and the gap sensor. The rest, below 0.2 %, is rounding in
the run, such as of positions between two refits of the path. The followers react by "extrapolate":
"degrade" would brake for contacts that it expects, and less where nothing ahead is a reason.
"""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import drive
from tests.made.convoys.integrated_string import BEACON, CONTROL, GAPS, LAG, String
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.messages import Message, TruePose

Floats = NDArray[np.float64]
BY_LAW_ALONE = "control.degradation.reaction=extrapolate"
ENDS_AFTER = {"plexe_sinusoidal": 9.0, "plexe_braking": 9.4}
"""Length (s) of a short run: most of a period, or until the lead stands."""
LEAST_CHANGE_M = 0.1
"""Gaps that change less may differ by 1 % of this, as flatbed's at the end of the string do: by up
to 0.7 mm while cars come to a standstill."""


def scenario(name: str, law: str, *overrides: str, followers: int, seconds: float) -> Scenario:
    standstill, headway = GAPS[law]
    return load_scenario(
        name,
        [
            f"convoy.vehicles={followers + 1}",
            f"duration_s={seconds}",
            f"control.longitudinal.use={law}",
            f"speed.gap.standstill_m={standstill}",
            f"speed.gap.headway_s={headway}",
            *overrides,
        ],
    )


def driven(made: Scenario) -> tuple[Floats, Floats]:
    """Gaps (m) of the followers and speeds (m/s) of all cars at the instants of control."""
    rows: dict[str, list[tuple[float, float]]] = {name: [] for name in made.vehicle_names}

    def note(_at: int, message: Message) -> None:
        assert isinstance(message, TruePose)
        rows[message.vehicle].append((message.distance_m, message.speed_mps))

    drive(made, [OnMessage(note, frozenset({TruePose}))]).raise_fault()
    distance, speed = np.array([rows[name] for name in made.vehicle_names]).transpose(2, 0, 1)
    first = np.array(made.route.gaps[1:])
    return first[:, None] - np.diff(distance, axis=0), speed


def compare(name: str, law: str, followers: int, seconds: float) -> None:
    made = scenario(name, law, BY_LAW_ALONE, followers=followers, seconds=seconds)
    profile = made.route.profile
    string = String(law, followers, LINCOLN_MKZ.length, lambda t: profile.at(t)[0])
    _, exact = string.gaps(seconds)
    gaps, _ = driven(made)
    changed = np.abs(exact - exact[:, :1]).max(axis=1)
    assert changed[0] > 0.05
    errors = np.abs(gaps - exact[:, : gaps.shape[1]]).max(axis=1)
    assert np.all(errors < 0.01 * np.maximum(changed, LEAST_CHANGE_M))


@pytest.mark.spread(6)
@pytest.mark.parametrize("name", ENDS_AFTER)
@pytest.mark.parametrize("law", GAPS)
def test_gaps_equal_an_independent_integration(name: str, law: str) -> None:
    compare(name, law, 2, ENDS_AFTER[name])


@pytest.mark.campaign(0, 10)
def test_gaps_of_whole_scenarios_equal_an_independent_integration(case: int) -> None:
    name = list(ENDS_AFTER)[case % 2]
    compare(name, list(GAPS)[case // 2], 7, load_scenario(name).duration_s)


def amplitudes(signals: Floats, seconds: float, frequency: float) -> Floats:
    """Amplitude of each signal, a row, over the last whole periods."""
    periods = math.floor((seconds - 12.0) * frequency)
    times = np.arange(signals.shape[1]) / 50.0
    last = times >= times[-1] - periods / frequency
    wave = np.exp(-2j * math.pi * frequency * times[last])
    mean = signals[:, last].mean(axis=1, keepdims=True)
    found: Floats = 2.0 * np.abs((signals[:, last] - mean) @ wave) / np.count_nonzero(last)
    return found


@pytest.mark.parametrize(
    ("law", "headway", "is_stable"),
    [("cacc", 0.0, True), ("ploeg", 0.5, True), ("acc", 1.2, True), ("acc", 0.3, False)],
)
def test_changes_of_the_gap_grow_along_the_string_only_without_string_stability(
    law: str, headway: float, *, is_stable: bool
) -> None:
    """As in Plexe's examples; ACC needs a headway above twice the drive lag."""
    more = f"speed.gap.headway_s={headway}", "speed.oscillation.from_s=0.5"
    gaps, _ = driven(scenario("plexe_sinusoidal", law, *more, followers=3, seconds=17.2))
    found = amplitudes(gaps, 17.2, 0.2)
    ratios = found[1:] / found[:-1]
    assert np.all(ratios < 1.0 if is_stable else ratios > 1.2)


def published_gain(frequency: float, headway: float, delay: float) -> float:
    """Gain of Ploeg's law from car to car, for a delay (s) of the predecessor's command.

    |Γ| with Γ = (e^(-θs) P + k_p + k_d s) / ((h s + 1) (P + k_p + k_d s)), P = s² (τ s + 1) (Ploeg
    et al., 2014). It is at most 1 at every frequency above a headway, 0.67 s for τ = 0.1 s and
    θ = 0.15 s.
    """
    s = 2j * math.pi * frequency
    plant, feedback = s * s * (LAG * s + 1.0), 0.2 + 0.7 * s
    forward = np.exp(-delay * s) * plant + feedback
    return float(abs(forward / ((headway * s + 1.0) * (plant + feedback))))


def sampled_gain(frequency: float, headway: float, latency: float) -> float:
    """Gain of Ploeg's law as it runs: sampled, all received data late and predicted to now.

    At control instants the newest beacon is from `latency` to `latency` + 80 ms old.
    """
    s = 2j * math.pi * frequency
    plant, hold = s * s * (LAG * s + 1.0), (1.0 - np.exp(-s * CONTROL)) / (s * CONTROL)
    age = latency + CONTROL * np.arange(round(BEACON / CONTROL))
    command = plant / hold  # of the predecessor, per position
    rest, built = s * s - command, LAG * (1.0 - np.exp(-age / LAG))
    place = 1.0 + age * s + 0.5 * age * age * command + rest * LAG * (age - built)
    speed = s + age * command + rest * built
    target = np.mean(np.exp(-age * s) * (command + 0.2 * place + 0.7 * speed))
    left = math.exp(-CONTROL / headway)
    law = hold * (1.0 - left) / (1.0 - left * np.exp(-s * CONTROL))
    own = (0.2 + 0.7 * s) * (1.0 + headway * s)
    return float(abs(law * target / (plant + law * own)))


@pytest.mark.parametrize(("latency", "is_stable"), [(0.02, True), (0.2, False)])
def test_ploeg_s_law_has_its_gain_and_is_string_stable_up_to_the_published_delay(
    latency: float, *, is_stable: bool
) -> None:
    frequencies = np.geomspace(0.01, 2.0, 200)
    mean_age = latency + 0.5 * (BEACON - CONTROL)
    assert (max(published_gain(f, 0.5, mean_age) for f in frequencies) <= 1.0) == is_stable
    assert (max(sampled_gain(f, 0.5, latency) for f in frequencies) <= 1.0) == is_stable
    frequency, seconds = 0.125, 28.2
    more = (
        f"speed.oscillation.frequency_hz={frequency}",
        "speed.oscillation.from_s=0.5",
        f"links.latency_ms={1000.0 * latency:g}",
        BY_LAW_ALONE,  # "degrade" replaces late poses by the gap sensor
    )
    _, speeds = driven(scenario("plexe_sinusoidal", "ploeg", *more, followers=2, seconds=seconds))
    found = amplitudes(speeds, seconds, frequency)
    expected = sampled_gain(frequency, 0.5, latency)
    assert found[1:] / found[:-1] == pytest.approx([expected] * 2, rel=0.005)
    assert (expected <= 1.0) == is_stable
