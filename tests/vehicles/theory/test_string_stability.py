import numpy as np
import pytest
from hypothesis import given

from tests.made.examples import examples
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import (
    NOMINAL_GAINS,
    Gains,
    Loading,
    VehicleParameters,
    loaded_with_moved_centre,
)
from vehicles.theory.gain_sets import abscissa
from vehicles.theory.linear_model import (
    SteeringModel,
    low_frequency_growth,
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


@pytest.mark.parametrize("steering", BOTH)
@pytest.mark.parametrize("speed", [6.0, 15.0, 30.0])
def test_attenuation_requires_amplification(speed: float, steering: SteeringModel) -> None:
    """Bode's integral of ln|G| / w² over all frequencies is zero: the loop has two integrators and
    no zeros in the right half-plane."""
    transfer = propagation(CAR, NOMINAL_GAINS, speed, steering)
    assert np.roots(transfer.numerator).real.max() < 0.0
    frequencies = np.geomspace(1e-4, 1e6, 200_001)
    integrand = np.log(np.abs(transfer.at(frequencies))) / frequencies
    integral = float(np.trapezoid(integrand, np.log(frequencies)))
    assert abs(integral) < 1e-3 * float(np.trapezoid(np.abs(integrand), np.log(frequencies)))


def test_an_oversteering_car_beyond_its_critical_speed_is_the_exception() -> None:
    car = loaded_with_moved_centre(CAR, Loading(front_passengers=1, rear_passengers=3))
    critical = np.sqrt(car.wheelbase / -car.steer_gradient)
    assert low_frequency_growth(car, NOMINAL_GAINS, 0.99 * critical) > 0.0
    assert low_frequency_growth(car, NOMINAL_GAINS, 1.01 * critical) < 0.0
    slower = Gains(0.02, 0.6, 0.08)
    assert abscissa(car, slower, [1.05 * critical])[0] < 0.0
    beyond = propagation(car, slower, 1.05 * critical)
    assert abs(beyond.at(np.array([0.05]))[0]) < 1.0  # no amplification at low frequency
    assert peak(beyond).magnitude > 1.0  # but not at all


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


def test_figures_of_the_nominal_loop() -> None:
    instant = peak(propagation(CAR, NOMINAL_GAINS, 30.0, "instantaneous"))
    lagging = peak(propagation(CAR, NOMINAL_GAINS, 30.0))
    assert (instant.magnitude, instant.frequency) == pytest.approx((1.1482, 2.4889), abs=1e-3)
    assert (lagging.magnitude, lagging.frequency) == pytest.approx((2.0044, 19.6333), abs=1e-3)


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


def test_the_singular_value_is_never_below_the_propagation() -> None:
    frequencies = np.geomspace(0.05, 60.0, 200)
    for speed in (10.0, 20.0, 30.0):
        eigenvalue = np.abs(propagation(CAR, NOMINAL_GAINS, speed, "instantaneous").at(frequencies))
        values = largest_singular_value(CAR, NOMINAL_GAINS, speed, frequencies)
        assert (values >= eigenvalue * (1.0 - 1e-12)).all()
        assert values.max() > 2.0 * eigenvalue.max()
