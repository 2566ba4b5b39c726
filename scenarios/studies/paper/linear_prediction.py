"""Errors of the paper's cases predicted by linear theory, and reasons for their growth."""

import numpy as np

from scenarios.results.drives import Array, Drive
from scenarios.studies.paper.findings import Findings, in_cm
from scenarios.studies.paper.keys import NO_LEAD_DATA, A, B, C, D, RunKey
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Loading, loaded
from vehicles.theory.propagation import Transfer, chain_offsets, trace_propagation
from vehicles.theory.string_stability import LANE_CHANGE_BAND, amplified_band

SAMPLES = 4096
"""Number of samples of the lead's path; a power of two for the FFT."""

BASE_CAR = (30.0, Loading(front_passengers=1, rear_passengers=3))
CARS = {
    A: (10.0, Loading(front_passengers=1, rear_passengers=2)),
    B: (10.0, Loading(front_passengers=1)),
    C: (20.0, Loading(front_passengers=1)),
    D: (30.0, Loading(front_passengers=1, rear_passengers=2)),
}
"""Speed (m/s) and load of the cars of a case (in D, of the first two), if not the base case's."""


def transfer(key: RunKey) -> Transfer:
    """F(jω) of a case: a car's own path over the path it follows, with the load unknown to it."""
    speed, loading = CARS.get(key, BASE_CAR)
    return trace_propagation(
        loaded(LINCOLN_MKZ, loading), NOMINAL_GAINS, speed, assumed=LINCOLN_MKZ
    )


def empty_transfer() -> Transfer:
    """F(jω) of empty cars at the speed of the base case."""
    return trace_propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_CAR[0])


def predict_case(findings: Findings, key: RunKey) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Predict the largest tracking and true errors (m) of the followers of a case."""
    alpha = 1.0 if key == NO_LEAD_DATA else 0.5
    return predict_errors(findings.trials[key].lead, transfer(key), alpha, 3)


def explain_growth(key: RunKey, findings: Findings) -> str:
    tracking, _ = predict_case(findings, key)
    low, high = amplified_band(transfer(key))[0]
    wide = "cars with the paper's law run wide in curves, and " if low == 0.0 else ""
    bands = f"{low:.1f} to {min(high, LANE_CHANGE_BAND):.1f}"
    shape = (
        "The composite trajectory combines two paths centimetres apart, which no single curve fits"
        if findings.trajectory == "fitted"
        else "One line or circle is fitted to a preview that is partly straight and partly curved"
    )
    text = (
        f"two effects. (1) {wide}each path oscillates more than the path ahead where |F| > 1, in a "
        f"lane change from {bands} rad/s; linear theory predicts {in_cm(tracking)}. (2) {shape}"
    )
    if findings.has(key.with_variant("blend")):
        blend = findings.trials[key.with_variant("blend")].tracking
        text += (
            f"; with one trajectory for each source (blend): {in_cm(blend)} in the first lane "
            "change"
        )
    return text


def predict_errors(
    lead: Drive, transfer: Transfer, alpha: float, followers: int
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Predict the largest tracking and true errors (m) of each follower.

    Neglects sampling, fit and noise. The lead drives east at constant speed and ends on its initial
    line. Follower i follows r_i = α y_(i−1) + (1 − α) y_0 with y_i = F r_i (`transfer`). Its true
    error is d_i = y_i − y_0. With r_i − y_0 = α d_(i−1), its tracking error is
    y_i − r_i = d_i − α d_(i−1).
    """
    span = float(lead.at[-1] - lead.at[0])
    times = np.linspace(0.0, span, SAMPLES, endpoint=False)
    east = lead.east[0] + (lead.east[-1] - lead.east[0]) * times / span
    path = np.fft.rfft(np.interp(east, lead.east, lead.north))
    frequencies: Array = 2.0 * np.pi / span * np.arange(SAMPLES // 2 + 1, dtype=np.float64)
    offsets = path * chain_offsets(transfer, frequencies, alpha, followers)
    ahead = np.vstack([np.zeros_like(path), offsets[:-1]])
    tracking, cross_track = (
        tuple(np.abs(np.fft.irfft(errors)).max(axis=1).tolist())
        for errors in (offsets - alpha * ahead, offsets)
    )
    return tracking, cross_track
