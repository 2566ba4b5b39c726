import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.signal import impulse, lsim

from tests.made.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import (
    NOMINAL_GAINS,
    Gains,
    Loading,
    VehicleParameters,
    loaded_with_moved_centre,
)
from vehicles.theory.gain_sets import abscissa
from vehicles.theory.linear_model import (
    closed_loop_at,
    curvature_input,
    curvature_rate_input,
    open_loop,
    steady_cornering,
)
from vehicles.theory.string_stability import (
    Actuation,
    Transfer,
    amplified_band,
    chain,
    largest_weight,
    low_frequency_growth,
    maximum_gain,
    peak,
    propagation,
    trace_propagation,
)

BOTH: tuple[Actuation, ...] = ("instantaneous", "second order")
FREQUENCIES = np.geomspace(0.05, 60.0, 40)


@settings(max_examples=60)
@given(CARS, GAINS, SPEEDS)
def test_propagation_is_h_over_one_plus_h(
    car: VehicleParameters, gains: Gains, speed: float
) -> None:
    """H from the paper's M_0(s) and K(s), solved numerically at each frequency."""
    p, cf, cr = car, car.front_cornering_stiffness, car.rear_cornering_stiffness
    a, b = p.front_axle_distance, p.rear_axle_distance
    for frequency in (0.1, 1.0, 7.0, 25.0):
        s = 1j * frequency
        m0 = np.array(
            [
                [
                    p.mass * s**2 + (cf + cr) / speed * s,
                    (a * cf - b * cr) / speed * s - (cf + cr),
                ],
                [
                    (a * cf - b * cr) / speed * s,
                    p.yaw_inertia * s**2
                    + (a * a * cf + b * b * cr) / speed * s
                    - (a * cf - b * cr),
                ],
            ]
        )
        row = cf * np.array([gains.lateral, gains.heading + gains.yaw_rate * s])
        h = row @ np.linalg.solve(m0, np.array([1.0, a]))
        wn, zeta = p.steering_frequency, p.steering_damping
        lag = wn**2 / (s**2 + 2 * zeta * wn * s + wn**2)
        for actuation, loop in zip(BOTH, (h, lag * h), strict=True):
            found = propagation(car, gains, speed, actuation).at(np.array([frequency]))[0]
            assert found == pytest.approx(loop / (1.0 + loop), rel=1e-8)


@pytest.mark.parametrize("speed", [4.4704, 15.0, 25.0, 30.0])
@pytest.mark.parametrize("actuation", BOTH)
def test_peak_against_a_dense_grid(speed: float, actuation: Actuation) -> None:
    transfer = propagation(CAR, NOMINAL_GAINS, speed, actuation)
    frequencies = np.linspace(1e-3, 60.0, 400_001)
    magnitudes = np.abs(transfer.at(frequencies))
    found = peak(transfer)
    assert found.magnitude == pytest.approx(magnitudes.max(), rel=1e-6)
    assert found.magnitude >= magnitudes.max() - 1e-9
    assert found.frequency == pytest.approx(frequencies[np.argmax(magnitudes)], abs=2e-3)
    below = peak(transfer, highest=6.0)
    assert below.magnitude == pytest.approx(magnitudes[frequencies <= 6.0].max(), rel=1e-6)


def test_peak_on_an_interval_may_be_its_end() -> None:
    rising = peak(trace_propagation(CAR, NOMINAL_GAINS, 10.0), highest=6.0)
    assert rising.frequency == 6.0


def test_peak_at_infinity() -> None:
    """Without actuation the feedforward passes curvature straight on: no fall-off."""
    transfer = trace_propagation(CAR, NOMINAL_GAINS, 10.0, "instantaneous")
    found = peak(transfer)
    assert found.frequency == np.inf
    assert found.magnitude == pytest.approx(abs(transfer.at(np.array([1e7]))[0]), rel=1e-6)


@settings(max_examples=60)
@given(CARS, GAINS, SPEEDS)
def test_predecessor_only_amplifies_at_low_frequency(
    car: VehicleParameters, gains: Gains, speed: float
) -> None:
    """The paper's result, for every stable loop with R(0) > 0, and how much."""
    assume(gains.lateral > 1e-2)
    assume(abscissa(car, gains, [speed])[0] < -1e-2)
    growth = low_frequency_growth(car, gains, speed)
    assume(growth > 1e-2)
    for actuation in BOTH:
        transfer = propagation(car, gains, speed, actuation)
        band = amplified_band(transfer)
        assert band[0][0] == 0.0
        magnitude = abs(transfer.at(np.array([0.1 * band[0][1]]))[0])
        assert magnitude > 1.0
        frequency = 1e-3
        excess = abs(transfer.at(np.array([frequency]))[0]) - 1.0
        assert excess / frequency**2 == pytest.approx(growth, rel=0.02)


@pytest.mark.parametrize("actuation", BOTH)
@pytest.mark.parametrize("speed", [6.0, 15.0, 30.0])
def test_attenuation_is_paid_for_by_amplification(speed: float, actuation: Actuation) -> None:
    """Bode's integral of ln|G| / w² over all frequencies is zero: the loop has two integrators and
    no zeros in the right half-plane."""
    transfer = propagation(CAR, NOMINAL_GAINS, speed, actuation)
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
    assert abs(beyond.at(np.array([0.05]))[0]) < 1.0  # quiet at low frequency
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


@settings(max_examples=60)
@given(CARS, CARS, GAINS, SPEEDS)
def test_trace_propagation_from_the_error_model(
    car: VehicleParameters, known: VehicleParameters, gains: Gains, speed: float
) -> None:
    """Second derivation: error relative to the path bent by the predecessor, eq. (3) with F.

    Closed loop driven by curvature and its rate; the path's own offset comes on top.
    """
    matrix = closed_loop_at(car, gains, speed)
    for s in 1j * np.array([0.2, 2.0, 9.0]):
        column = curvature_input(car, speed, known) + s * curvature_rate_input(speed)
        curvature = s**2 / speed**2
        error = np.linalg.solve(s * np.eye(6) - matrix, column * curvature)
        found = trace_propagation(car, gains, speed, known=known).at(np.array([s.imag]))[0]
        assert found == pytest.approx(1.0 + error[0], rel=1e-7)


def test_running_wide_amplifies_at_low_frequency() -> None:
    for speed in (10.0, 20.0, 30.0):
        transfer = trace_propagation(CAR, NOMINAL_GAINS, speed)
        wide = -steady_cornering(CAR, NOMINAL_GAINS, speed, 1.0)[0]
        excess = abs(transfer.at(np.array([0.01]))[0]) - 1.0
        assert excess / 0.01**2 == pytest.approx(wide / speed**2, rel=1e-3)


def test_instant_steering_from_the_matrices() -> None:
    constant, inverse_speed = open_loop(CAR)
    matrix = (constant + inverse_speed / 20.0)[:4, :4]
    column = constant[:4, 4]
    row = np.array([0.06, 0.96, 0.0, 0.08])
    closed = np.linalg.eigvals(matrix - np.outer(column, row))
    transfer = propagation(CAR, NOMINAL_GAINS, 20.0, "instantaneous")
    roots = np.roots(transfer.denominator)
    assert np.sort_complex(roots) == pytest.approx(np.sort_complex(closed), rel=1e-8)


@pytest.mark.parametrize("alpha", [0.0, 0.3, 0.5, 1.0])
def test_chain_by_following_the_recursion(alpha: float) -> None:
    transfer = trace_propagation(CAR, NOMINAL_GAINS, 30.0)
    found = chain(transfer, FREQUENCIES, alpha, 4)
    factor = transfer.at(FREQUENCIES)
    offsets = [np.ones_like(factor)]
    for _ in range(4):
        offsets.append(factor * (alpha * offsets[-1] + (1.0 - alpha) * offsets[0]))
    for found_row, offset in zip(found, offsets[1:], strict=True):
        assert found_row == pytest.approx(offset - 1.0, abs=1e-12)


def test_lead_data_level_the_growth_off() -> None:
    """Predecessor only: the offset from the lead's path grows car by car. Half lead: it settles."""
    transfer = trace_propagation(CAR, NOMINAL_GAINS, 30.0)
    slow = np.array([1.0])
    alone = np.abs(chain(transfer, slow, 1.0, 12))[:, 0]
    half = np.abs(chain(transfer, slow, 0.5, 12))[:, 0]
    assert alone[11] > 10.0 * alone[0]
    assert half[11] < 2.5 * half[0]
    factor = transfer.at(slow)[0]
    assert half[11] == pytest.approx(abs((factor - 1.0) / (1.0 - 0.5 * factor)), rel=1e-3)


def test_largest_weight_is_where_the_chain_stops_contracting() -> None:
    transfer = propagation(CAR, NOMINAL_GAINS, 30.0)
    alpha = largest_weight(transfer)
    magnitudes = np.abs(transfer.at(np.linspace(0.01, 60.0, 100_001)))
    assert (0.999 * alpha * magnitudes).max() < 1.0
    assert (1.001 * alpha * magnitudes).max() > 1.0
    assert alpha == pytest.approx(0.4989, abs=1e-4)
    assert largest_weight(propagation(CAR, NOMINAL_GAINS, 30.0, "instantaneous")) > 0.85


def test_maximum_gain_of_known_systems() -> None:
    lag = Transfer(np.array([3.0]), np.array([1.0, 3.0]))
    assert maximum_gain(lag) == pytest.approx(1.0, rel=1e-4)
    zeta, wn = 0.2, 5.0  # overshoot y of the step, then undershoots: sum of a geometric series
    ringing = Transfer(np.array([wn**2]), np.array([1.0, 2 * zeta * wn, wn**2]))
    overshoot = np.exp(-np.pi * zeta / np.sqrt(1.0 - zeta**2))
    assert maximum_gain(ringing) == pytest.approx((1 + overshoot) / (1 - overshoot), rel=1e-4)


@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_maximum_gain_by_driving_the_worst_signal(speed: float) -> None:
    """At least the gain in L2, and reached by an input with the impulse response's sign."""
    transfer = propagation(CAR, NOMINAL_GAINS, speed)
    gain = maximum_gain(transfer)
    assert gain > peak(transfer).magnitude
    times = np.linspace(0.0, 25.0, 25_001)
    _, response = impulse((transfer.numerator, transfer.denominator), T=times)
    worst = np.sign(response[::-1])
    _, output, _ = lsim((transfer.numerator, transfer.denominator), worst, times)
    assert np.abs(output).max() == pytest.approx(gain, rel=0.01)


def test_figures_of_the_nominal_loop() -> None:
    instant = peak(propagation(CAR, NOMINAL_GAINS, 30.0, "instantaneous"))
    lagging = peak(propagation(CAR, NOMINAL_GAINS, 30.0))
    assert (instant.magnitude, instant.frequency) == pytest.approx((1.1482, 2.4889), abs=1e-3)
    assert (lagging.magnitude, lagging.frequency) == pytest.approx((2.0044, 19.6333), abs=1e-3)
