"""Why errors grow along the convoy: what linear theory says, and what the composite adds."""

from scenarios.studies.paper.findings import Findings, in_cm
from scenarios.studies.paper.keys import NO_LEAD_DATA, A, B, C, D, RunKey
from scenarios.studies.paper.linear_prediction import predicted
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Loading, loaded
from vehicles.theory.string_stability import Transfer, amplified_band, trace_propagation

BASE_CAR = (30.0, Loading(front_passengers=1, rear_passengers=3))
CARS = {
    A: (10.0, Loading(front_passengers=1, rear_passengers=2)),
    B: (10.0, Loading(front_passengers=1)),
    C: (20.0, Loading(front_passengers=1)),
    D: (30.0, Loading(front_passengers=1, rear_passengers=2)),
}
"""Speed (m/s) and load of each case's cars, in D of the first two; any other is the base case."""

LANE_CHANGE_BAND = 6.3
"""Frequencies (rad/s) below 1 Hz: what a lane change contains."""


def transfer(key: RunKey) -> Transfer:
    """F(jω) of a case: from the path a car follows to its own. Its controller knows no load."""
    speed, loading = CARS.get(key, BASE_CAR)
    return trace_propagation(loaded(LINCOLN_MKZ, loading), NOMINAL_GAINS, speed, known=LINCOLN_MKZ)


def linear(findings: Findings, key: RunKey) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """What linear theory predicts of a case: tracking and true errors (m) of the followers."""
    alpha = 1.0 if key == NO_LEAD_DATA else 0.5
    return predicted(findings.trials[key].lead, transfer(key), alpha, 3)


def why_growing(key: RunKey, findings: Findings) -> str:
    """Say why the errors of a case grow against the own trajectories, as far as it is known."""
    tracking, _ = linear(findings, key)
    low, high = amplified_band(transfer(key))[0]
    wide = "cars with the paper's law run wide, and " if low == 0.0 else ""
    bands = f"{low:.1f} to {min(high, LANE_CHANGE_BAND):.1f}"
    text = (
        f"two effects. (1) {wide}each path is livelier than the one ahead where |F| > 1, in a lane "
        f"change from {bands} rad/s; linear theory gives {in_cm(tracking)}. (2) A composite runs "
        "through two paths centimetres apart, which no one arc spline explains"
    )
    if findings.has(key.varied("blend")):
        blend = findings.trials[key.varied("blend")].tracking
        text += f"; with one trajectory for each source (blend) {in_cm(blend)} in the first change"
    return text
