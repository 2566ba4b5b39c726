"""Largest weight of the predecessor without amplification, 1 / ‖G‖∞."""

import numpy as np
import pytest

from scenarios.definition.check.findings import check
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS
from vehicles.theory.linear_model import closed_loop_at, feedback_row, steering_input

EMPTY = ("loading.front_passengers=0", "loading.rear_passengers=0")


def norm_by_hamiltonian(speed: float) -> float:
    """‖G‖∞ in the state space, by bisection (Boyd, Balakrishnan and Kabamba, 1989).

    It is below γ if and only if a Hamiltonian matrix has no imaginary eigenvalue.
    """
    a = closed_loop_at(LINCOLN_MKZ, NOMINAL_GAINS, speed)
    b = np.outer(steering_input(LINCOLN_MKZ), steering_input(LINCOLN_MKZ))
    c = np.outer(feedback_row(NOMINAL_GAINS), feedback_row(NOMINAL_GAINS))
    low, high = 1.0, 10.0
    while high - low > 1e-8:
        middle = 0.5 * (low + high)
        roots = np.linalg.eigvals(np.block([[a, b / middle**2], [-c, -a.T]]))
        if np.any(np.abs(roots.real) < 1e-8 * np.abs(roots)):
            low = middle
        else:
            high = middle
    return high


@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_it_is_the_inverse_of_the_norm(speed: float) -> None:
    report = check("paper_base", (*EMPTY, f"speed.set_mps={speed}"))
    assert list(report.largest_alpha) == ["v3", "v4"]  # v2 has one source only
    found = report.largest_alpha["v4"]
    assert found["largest_alpha_ratio"] == pytest.approx(1.0 / norm_by_hamiltonian(speed), rel=1e-5)
    assert found["speed_mps"] == speed


def test_the_paper_s_weight_exceeds_it_at_30_mps_with_actuation() -> None:
    found = check("paper_base", EMPTY).largest_alpha["v3"]
    assert found["largest_alpha_ratio"] == pytest.approx(0.4989, abs=5e-5)
    assert found["frequency_radps"] == pytest.approx(19.6, abs=0.1)


def test_the_lowest_value_of_the_run_s_speeds_is_reported() -> None:
    slows = check("paper_base", (*EMPTY, "speed.lateral_acceleration_mps2_max=0.8"))
    assert slows.speed_mps_min < 25.0
    assert slows.largest_alpha["v3"]["speed_mps"] == 30.0


@pytest.mark.parametrize(
    "override",
    [
        'information_flow.lateral="predecessor"',
        'control.controller="stanley"',
        "control.gains.lateral_rad_per_m=1.0",  # an unstable loop
    ],
)
def test_it_is_defined_for_stable_loops_of_the_paper_s_law_with_lead_data(override: str) -> None:
    assert check("paper_base", [override]).largest_alpha == {}
