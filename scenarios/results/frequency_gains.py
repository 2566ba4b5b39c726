"""Gains along the string by frequency, estimated from the true poses of a run."""

from itertools import pairwise
from math import sqrt
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.errors import ScenarioError
from scenarios.results.data_table import DataTable
from scenarios.results.string_figures import (
    LEAST_ACCELERATION_MPS2,
    LEAST_ERROR_M,
    spacing_errors,
)
from scenarios.results.tables import RunTables, Signal, common
from scenarios.results.vehicle_figures import position_deviation
from transport.columns import Floats
from vehicles.schedule import SECOND

SignalName = Literal["speed", "spacing"]
BAND_BINS = 5
"""Fourier coefficients of a band, over which the spectra are averaged."""
TAPERED_RATIO = 0.2
"""Last part of a record from rest on that is faded out."""
REST_S, REST_RATIO = 0.5, 0.1
"""Begin of a record at rest: its root mean square is below this ratio of that of the record."""
LEAST_POWER_RATIO = 0.01
"""Input power of a band, relative to the strongest one, from which it counts as excited."""
LEAST_COHERENCE = 0.95
"""Coherence from which an estimate is stated: its 95 % interval is then within 15 %."""
HIGHEST_HZ = 5.0
LEAST_SAMPLES = 500
LONGEST_HOLE_S = 0.5
LEAST_RMS = {"speed": LEAST_ACCELERATION_MPS2, "spacing": sqrt(2.0) * LEAST_ERROR_M}
"""Root mean square of the input (m/s², m) below which nothing is excited, as that of the gains in
the summary."""
NORMAL_95 = 1.96


class FrequencyGain(NamedTuple):
    """Gain of a signal from the vehicle ahead, averaged over a band around `frequency_hz`.

    `low` and `high` bound it with a confidence of 95 %. `phase_rad` is negative if the vehicle lags
    behind. `coherence` is the share of the vehicle's signal that the vehicle ahead explains
    linearly.
    """

    vehicle: str
    frequency_hz: float
    gain: float
    low: float
    high: float
    phase_rad: float
    coherence: float


def frequency_gains(run: RunTables, signal: SignalName = "speed") -> DataTable:
    """Estimate the gains of each follower where its vehicle ahead is excited; see `estimated`.

    "speed" compares speeds, from the lead on, and "spacing" the spacing errors of followers that
    keep a gap. Frequencies without excitation or with a low coherence are left out, so the table
    may be empty. Raises ScenarioError for another signal.
    """
    if signal not in get_args(SignalName):
        allowed = " or ".join(map(repr, get_args(SignalName)))
        raise ScenarioError([f"signal: given {signal!r}, allowed {allowed}"])
    gains = []
    for ahead, behind in pairwise(run.names):
        x, y, step = _aligned(_signal(run, ahead, signal), _signal(run, behind, signal))
        least = LEAST_RMS[signal]
        if signal == "spacing":  # two positions
            least = max(least, sqrt(2.0) * position_deviation(run, ahead))
        if len(x) and float(np.sqrt(np.mean(x**2))) >= least:
            gains += estimated(behind, x, y, step)
    return DataTable.of_rows([gain._asdict() for gain in gains], FrequencyGain._fields)


def _signal(run: RunTables, name: str, signal: SignalName) -> Signal:
    """Signal of a vehicle, empty if it has none.

    A speed counts by its differences, accelerations (m/s²): these begin and end at zero.
    """
    truth = run.table(name, "truth")
    if signal == "speed":
        steps = np.maximum(np.diff(truth.at_ns), 1)
        return Signal(truth.at_ns[1:], np.diff(truth["speed_mps"]) * SECOND / steps)
    if run.scenario.tables.speed.followers != "gap" or name == run.lead:
        return Signal(np.zeros(0, np.int64), np.zeros(0))
    return spacing_errors(run, name)


def _aligned(ahead: Signal, behind: Signal) -> tuple[Floats, Floats, float]:
    """Values at common instants on an even grid, and its step (s); none if few or with a hole."""
    at, (rows_ahead, rows) = common(ahead.at_ns, behind.at_ns)
    if at.size < LEAST_SAMPLES:
        return np.zeros(0), np.zeros(0), 0.0
    steps = np.diff(at)
    step = int(np.median(steps))
    if int(steps.max()) > max(LONGEST_HOLE_S * SECOND, 1.5 * step):
        return np.zeros(0), np.zeros(0), 0.0
    even = np.arange(at[0], at[-1] + 1, step)
    x = np.interp(even, at, ahead.values[rows_ahead])
    return x, np.interp(even, at, behind.values[rows]), step / SECOND


def estimated(vehicle: str, x: Floats, y: Floats, step: float) -> list[FrequencyGain]:
    """Estimate the gains from `x` to `y`, samples `step` (s) apart.

    The cross spectrum over the input spectrum (H1), averaged over bands of five Fourier
    coefficients of the whole record, whose end is faded out. A record from rest on needs no window
    at its begin, and neither a pulse that has faded nor a steady oscillation is distorted by that
    at the end. Another one, such as a part of a log, has a Hann window. The frequency of a band is
    the centroid of its input power. The delay within a band is removed before averaging, or it
    would lower the coherence. Interval: Bendat and Piersol, Random Data (2010), section 9.2.
    """
    window = np.hanning(x.size)
    if _begins_at_rest(x, step) and _begins_at_rest(y, step):
        faded = int(TAPERED_RATIO * x.size)
        window = np.ones(x.size)
        window[x.size - faded :] = 0.5 + 0.5 * np.cos(np.pi * (np.arange(faded) + 0.5) / faded)
    frequencies = np.fft.rfftfreq(x.size, step)
    count = int(np.searchsorted(frequencies, HIGHEST_HZ)) // BAND_BINS
    bands = [
        values[1 : 1 + BAND_BINS * count].reshape(count, BAND_BINS)
        for values in (frequencies, np.fft.rfft(x * window), np.fft.rfft(y * window))
    ]
    powers = (np.abs(bands[1]) ** 2).sum(axis=1)
    excited = powers > LEAST_POWER_RATIO * powers.max(initial=0.0)
    gains = [
        _of_band(vehicle, *band) for band in zip(*(each[excited] for each in bands), strict=True)
    ]
    return [gain for gain in gains if gain.coherence >= LEAST_COHERENCE]


def _begins_at_rest(signal: Floats, step: float) -> bool:
    begin = signal[: max(round(REST_S / step), 1)]
    return bool(np.sqrt(np.mean(begin**2)) <= REST_RATIO * np.sqrt(np.mean(signal**2)))


def _of_band(
    vehicle: str, frequencies: Floats, x: NDArray[np.complex128], y: NDArray[np.complex128]
) -> FrequencyGain:
    powers = np.abs(x) ** 2
    power, output_power = float(powers.sum()), float((np.abs(y) ** 2).sum())
    frequency = float((frequencies * powers).sum() / power)
    cross = np.conj(x) * y
    slope = np.angle((cross[1:] * np.conj(cross[:-1])).sum())  # rad per coefficient
    apart = (frequencies - frequency) / (frequencies[1] - frequencies[0])
    whole = complex((cross * np.exp(-1j * slope * apart)).sum())
    gain = abs(whole) / power
    coherence = min(abs(whole) ** 2 / (power * output_power), 1.0) if output_power else 0.0
    error = 0.0
    if coherence:
        error = NORMAL_95 * gain * sqrt((1.0 - coherence) / (2 * BAND_BINS * coherence))
    return FrequencyGain(
        vehicle=vehicle,
        frequency_hz=frequency,
        gain=gain,
        low=max(gain - error, 0.0),
        high=gain + error,
        phase_rad=float(np.angle(whole)),
        coherence=coherence,
    )
