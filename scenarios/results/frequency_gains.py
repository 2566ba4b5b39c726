"""Gains along the string by frequency, estimated from the true poses of a recorded run."""

from collections.abc import Iterator
from itertools import pairwise
from math import sqrt
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.errors import ScenarioError
from scenarios.results.data_table import DataTable
from scenarios.results.run_record import RunRecord
from scenarios.results.string_figures import LEAST_ACCELERATION_MPS2, LEAST_ERROR_M
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]
Signal = Literal["speed", "spacing"]
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


def frequency_gains(run: RunRecord, signal: Signal = "speed") -> DataTable:
    """Estimate the gains of each follower where its vehicle ahead is excited; see `estimated`.

    "speed" compares speeds, from the lead on, and "spacing" the spacing errors of followers that
    keep a gap. Frequencies without excitation or with a low coherence are left out, so the table
    may be empty. Raises ScenarioError for another signal.
    """
    if signal not in get_args(Signal):
        allowed = " or ".join(repr(one) for one in get_args(Signal))
        raise ScenarioError([f"signal: given {signal!r}, allowed {allowed}"])
    return DataTable.of_rows(
        [gain._asdict() for gain in _all_gains(run, signal)], FrequencyGain._fields
    )


def _all_gains(run: RunRecord, signal: Signal) -> Iterator[FrequencyGain]:
    series = {name: one for name in run.vehicle_names if (one := _series(run, name, signal))}
    for ahead, behind in pairwise(run.vehicle_names):
        if ahead in series and behind in series:
            pair = _aligned(series[ahead], series[behind])
            if pair is not None and float(np.sqrt(np.mean(pair.x**2))) >= _noise(
                run, ahead, signal
            ):
                yield from estimated(behind, pair.x, pair.y, pair.step)


def _noise(run: RunRecord, name: str, signal: Signal) -> float:
    """Root mean square of a signal that noise alone explains; of a spacing, of two positions."""
    least = LEAST_RMS[signal]
    if signal == "spacing":
        for topic, column in (("gps", "position_accuracy_m"), ("tracking", "lateral_deviation_m")):
            rows = run.columns_of(topic).get(name)
            if rows is not None and len(rows):
                largest = float(np.nanmax(rows[column], initial=0.0))
                least = max(least, sqrt(2.0) * largest)
    return least


class _Series(NamedTuple):
    at: NDArray[np.int64]
    values: Floats


def _series(run: RunRecord, name: str, signal: Signal) -> _Series | None:
    """Instants (ns) and values of a signal of a vehicle, or None if it has none.

    A speed counts by its differences, accelerations: these begin and end at zero.
    """
    if "truth" not in run.topics_of(name):
        return None
    true = run.vehicles[name].true
    if signal == "speed":
        steps = np.diff(true.at_ns)
        return _Series(true.at_ns[1:], np.diff(true.speed_mps) * SECOND / np.maximum(steps, 1))
    scenario, place = run.known_scenario, list(run.vehicle_names).index(name)
    if scenario is None or scenario.tables.speed.followers != "gap" or not place:
        return None
    ahead = run.vehicle_names[place - 1]
    if "truth" not in run.topics_of(ahead):
        return None
    station = _stations(run, ahead, place == 1)
    at, rows_ahead, rows = np.intersect1d(station.at, true.at_ns, return_indices=True)
    policy = scenario.spacing_policy(place)
    desired = policy.standstill + policy.headway * true.speed_mps[rows]
    error = station.values[rows_ahead] - true.station_m[rows] - desired
    known = np.isfinite(error)
    return _Series(at[known], error[known])


def _stations(run: RunRecord, name: str, is_lead: bool) -> _Series:
    """Places (m) of a vehicle along the path of the lead."""
    true = run.vehicles[name].true
    if is_lead:
        return _Series(true.at_ns, true.distance_m - true.distance_m[:1])
    return _Series(true.at_ns, true.station_m)


class _AlignedSignals(NamedTuple):
    """Signals of two vehicles at equal instants, `step` (s) apart."""

    x: Floats
    y: Floats
    step: float


def _aligned(ahead: _Series, behind: _Series) -> _AlignedSignals | None:
    """Return the common instants on an even grid; None if they are few or have a long hole."""
    at, rows_ahead, rows = np.intersect1d(ahead.at, behind.at, return_indices=True)
    if at.size < LEAST_SAMPLES:
        return None
    steps = np.diff(at)
    step = int(np.median(steps))
    if int(steps.max()) > max(LONGEST_HOLE_S * SECOND, 1.5 * step):
        return None
    even = np.arange(at[0], at[-1] + 1, step)
    x = np.interp(even, at, ahead.values[rows_ahead])
    y = np.interp(even, at, behind.values[rows])
    return _AlignedSignals(x, y, step / SECOND)


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
    frequencies: Floats = np.fft.rfftfreq(x.size, step).astype(np.float64)
    of_x, of_y = np.fft.rfft(x * window), np.fft.rfft(y * window)
    count = int(np.searchsorted(frequencies, HIGHEST_HZ)) // BAND_BINS
    bands = [slice(1 + BAND_BINS * row, 1 + BAND_BINS * (row + 1)) for row in range(count)]
    powers = [float((np.abs(of_x[band]) ** 2).sum()) for band in bands]
    least = LEAST_POWER_RATIO * max(powers, default=0.0)
    excited = [band for band, power in zip(bands, powers, strict=True) if power > least]
    gains = (_of_band(vehicle, frequencies[band], of_x[band], of_y[band]) for band in excited)
    return [gain for gain in gains if gain.coherence >= LEAST_COHERENCE]


def _begins_at_rest(signal: Floats, step: float) -> bool:
    begin = signal[: max(round(REST_S / step), 1)]
    return bool(np.sqrt(np.mean(begin**2)) <= REST_RATIO * np.sqrt(np.mean(signal**2)))


def _of_band(
    vehicle: str, frequencies: Floats, x: NDArray[np.complex128], y: NDArray[np.complex128]
) -> FrequencyGain:
    input_power, output_power = np.abs(x) ** 2, np.abs(y) ** 2
    frequency = float((frequencies * input_power).sum() / input_power.sum())
    cross = np.conj(x) * y
    slope = np.angle((cross[1:] * np.conj(cross[:-1])).sum())  # rad per coefficient
    apart = (frequencies - frequency) / (frequencies[1] - frequencies[0])
    whole = complex((cross * np.exp(-1j * slope * apart)).sum())
    gain = abs(whole) / float(input_power.sum())
    powers = float(input_power.sum()) * float(output_power.sum())
    coherence = min(abs(whole) ** 2 / powers, 1.0) if powers else 0.0
    error = 0.0
    if coherence:
        error = NORMAL_95 * gain * float(np.sqrt((1.0 - coherence) / (2 * BAND_BINS * coherence)))
    return FrequencyGain(
        vehicle=vehicle,
        frequency_hz=frequency,
        gain=gain,
        low=max(gain - error, 0.0),
        high=gain + error,
        phase_rad=float(np.angle(whole)),
        coherence=coherence,
    )
