import numpy as np
import pytest
from hypothesis import given

from tests.made.examples import examples
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import (
    NOMINAL_GAINS,
    Gains,
    VehicleParameters,
)
from vehicles.theory.linear_model import (
    SteeringModel,
    open_loop,
    propagation,
)
from vehicles.theory.string_stability import (
    amplified_band,
    largest_singular_value,
    largest_weight,
    peak,
)

BOTH: tuple[SteeringModel, ...] = ("instantaneous", "second order")


@pytest.mark.parametrize("speed", [4.4704, 15.0, 25.0, 30.0])
@pytest.mark.parametrize("steering", BOTH)
def test_peak_against_a_dense_grid(speed: float, steering: SteeringModel) -> None:
    transfer = propagation(CAR, NOMINAL_GAINS, speed, steering)
    frequencies = np.linspace(1e-3, 60.0, 400_001)
    magnitudes = np.abs(transfer.at(frequencies))
    result = peak(transfer)
    assert result.magnitude == pytest.approx(magnitudes.max(), rel=1e-6)
    assert result.magnitude >= magnitudes.max() - 1e-9
    assert result.frequency == pytest.approx(frequencies[np.argmax(magnitudes)], abs=2e-3)
    below = peak(transfer, highest=6.0)
    assert below.magnitude == pytest.approx(magnitudes[frequencies <= 6.0].max(), rel=1e-6)


def test_amplified_band_by_sampling() -> None:
    for speed in (10.0, 20.0, 30.0):
        transfer = propagation(CAR, NOMINAL_GAINS, speed)
        bands = amplified_band(transfer)
        frequencies = np.linspace(0.01, 80.0, 8000)
        above = np.abs(transfer.at(frequencies)) > 1.0
        inside = np.any([(frequencies > a) & (frequencies < b) for a, b in bands], axis=0)
        assert np.array_equal(above, inside)
        assert above.any()


def test_largest_weight_is_where_the_chain_stops_contracting() -> None:
    transfer = propagation(CAR, NOMINAL_GAINS, 30.0)
    alpha = largest_weight(transfer)
    magnitudes = np.abs(transfer.at(np.linspace(0.01, 60.0, 100_001)))
    assert (0.999 * alpha * magnitudes).max() < 1.0
    assert (1.001 * alpha * magnitudes).max() > 1.0
    assert alpha == pytest.approx(0.4989, abs=1e-4)
    assert largest_weight(propagation(CAR, NOMINAL_GAINS, 30.0, "instantaneous")) > 0.85


@examples(10, 60)
@given(CARS, GAINS, SPEEDS)
def test_singular_value_of_the_matrix(car: VehicleParameters, gains: Gains, speed: float) -> None:
    """Second method: the matrix between the states, solved and decomposed numerically."""
    constant, inverse_speed = open_loop(car)
    matrix = (constant + inverse_speed / speed)[:4, :4]
    frequencies = np.array([0.1, 1.0, 7.0, 25.0])
    result = largest_singular_value(car, gains, speed, frequencies)
    for frequency, value in zip(frequencies, result, strict=True):
        s = 1j * frequency
        states = np.linalg.solve(s * np.eye(4) - matrix, constant[:4, 4])[:2]
        row = np.array([gains.lateral, gains.heading + gains.yaw_rate * s])
        passed_on = np.linalg.solve(np.eye(2) + np.outer(states, row), np.outer(states, row))
        assert value == pytest.approx(np.linalg.svd(passed_on, compute_uv=False)[0], rel=1e-6)
