"""Gains along the string against closed forms, and their invariants."""

import math
from collections.abc import Callable
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import freqs, lsim

from tests.made.scenarios.known_string import SPEED, STEP, KnownString

RATE = 2.0 * math.pi * 0.2


def steady(count: int = 3, duration: float = 20.0) -> KnownString:
    times = np.arange(0.0, duration, STEP)
    speeds = [np.full(times.size, SPEED)] * count
    return KnownString(speeds, [np.zeros(times.size)] * (count - 1))


def bump(size: float) -> Callable[[float], float]:
    return lambda station: size * math.exp(-(((station - 150.0) / 30.0) ** 2))


def test_equal_signals_have_gains_of_one() -> None:
    wave = 0.3 * np.sin(RATE * np.arange(0.0, 20.0, STEP))
    convoy = KnownString([SPEED + wave] * 3, [wave, wave])
    v3 = convoy.figures([bump(0.5), bump(0.5)])["v3"]
    for name in ("lateral", "spacing"):
        assert getattr(v3, f"{name}_gain_l2") == pytest.approx(1.0, rel=3e-3)
        assert getattr(v3, f"{name}_gain_linf") == pytest.approx(1.0, rel=3e-3)
    assert v3.acceleration_gain_l2 == pytest.approx(1.0)
    assert v3.acceleration_gain_linf_from_lead == pytest.approx(1.0)
    assert v3.spacing_error_m_max == pytest.approx(0.3, rel=1e-3)


@settings(max_examples=4)
@given(first=st.floats(0.3, 3.0), second=st.floats(0.3, 3.0), seed=st.integers(0, 99))
def test_gains_are_the_factors_of_the_signals_in_any_order_of_messages(
    first: float, second: float, seed: int
) -> None:
    wave = 0.3 * np.sin(RATE * np.arange(0.0, 10.0, STEP))
    gaps = [wave, first * wave, first * second * wave]
    convoy = KnownString([SPEED + 0.0 * wave] * 4, gaps)
    errors = [bump(0.5), bump(0.5 * first), bump(0.5 * first * second)]
    found = convoy.figures(errors, order=Random(seed))
    assert found == convoy.figures(errors)
    for name in ("lateral", "spacing"):
        v3, v4 = found["v3"], found["v4"]
        assert getattr(v3, f"{name}_gain_l2") == pytest.approx(first, rel=1e-2)
        assert getattr(v4, f"{name}_gain_linf") == pytest.approx(second, rel=1e-2)
        tail = getattr(v4, f"{name}_gain_l2_from_first")
        assert tail == pytest.approx(first * second, rel=1e-2)
        assert getattr(v4, f"{name}_growth_l2") == pytest.approx(math.sqrt(tail))


def test_gains_of_acc_are_those_of_its_transfer_function() -> None:
    """ACC with a drive lag, in the steady response to a sinusoid (Rajamani, eq. 6.18)."""
    gain, lag, headway = 0.1, 0.5, 0.6
    transfer = [1.0, gain], [headway * lag, headway, 1.0 + gain * headway, gain]
    times = np.arange(0.0, 120.0, STEP)
    waves = [np.sin(RATE * times)]
    for _ in range(2):
        waves.append(lsim(transfer, waves[-1], times)[1])
    settled = slice(times.size - round(20.0 / STEP), None)
    convoy = KnownString([SPEED + wave[settled] for wave in waves], [waves[1][settled]] * 2)
    (expected,) = np.abs(freqs(*transfer, worN=[RATE])[1])
    found = convoy.figures()
    assert found["v2"].acceleration_gain_l2 == pytest.approx(expected, rel=1e-3)
    assert found["v3"].acceleration_gain_linf == pytest.approx(expected, rel=2e-3)
    assert found["v3"].acceleration_gain_l2_from_lead == pytest.approx(expected**2, rel=2e-3)


@pytest.mark.parametrize(("size", "is_defined"), [(0.061, True), (0.059, False)])
def test_errors_at_the_level_of_the_noise_have_no_gain(size: float, is_defined: bool) -> None:
    """Largest errors of 3 σ, with σ = 2 cm."""
    v3 = steady().figures([bump(size), bump(0.5)], deviation=0.02)["v3"]
    assert (v3.lateral_gain_linf is not None) == is_defined
    assert v3.lateral_gain_l2 is None  # the bump is short
    assert v3.spacing_gain_l2 is None
    assert v3.acceleration_gain_l2 is None
    assert v3.lateral_error_m_max == pytest.approx(0.5, rel=1e-3)


def test_errors_are_compared_on_the_path_that_all_drove() -> None:
    """An error where the last vehicle has not been counts for none of them."""
    convoy = steady(3, 10.0)
    end = float(convoy.stations[2][-1])
    late = [lambda station: 1.0 if station > end else 0.1, lambda _: 0.2]
    v2, v3 = (convoy.figures(late)[name] for name in ("v2", "v3"))
    assert v2.lateral_error_m_max == pytest.approx(0.1)
    assert v3.lateral_gain_linf == pytest.approx(2.0)
