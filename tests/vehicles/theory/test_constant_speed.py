import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import NOMINAL_GAINS, Gains, VehicleParameters
from vehicles.theory.gain_sets import abscissa, is_stable_over


@examples(10, 60)
@given(CARS, GAINS, SPEEDS, st.floats(1.01, 3.0), st.floats(0.0, 0.5))
def test_stability_over_an_interval_agrees_with_a_dense_grid(
    car: VehicleParameters, gains: Gains, slowest: float, ratio: float, decay: float
) -> None:
    fastest = slowest * ratio
    speeds = np.linspace(slowest, fastest, 200).tolist()
    worst = float(abscissa(car, gains, speeds).max())
    assume(abs(worst + decay) > 1e-3)
    assert is_stable_over(car, gains, slowest, fastest, decay) == (worst < -decay)


def test_stability_ends_where_a_root_crosses() -> None:
    low, high = 50.0, 200.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        if abscissa(CAR, NOMINAL_GAINS, [middle])[0] < 0.0:
            low = middle
        else:
            high = middle
    assert is_stable_over(CAR, NOMINAL_GAINS, 5.0, low * (1.0 - 1e-9))
    assert not is_stable_over(CAR, NOMINAL_GAINS, 5.0, low * (1.0 + 1e-9))
