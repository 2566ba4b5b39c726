import numpy as np
import pytest

from tests.made.vehicles.theory.random_cars import CAR
from vehicles.car.parameters import NOMINAL_GAINS, Gains, all_loadings, loaded
from vehicles.theory.linear_model import SteeringModel, propagation
from vehicles.theory.string_stability import SIMULATED_FREQUENCIES, simulated_propagation


@pytest.mark.spread(2)
@pytest.mark.parametrize("steering", ["instantaneous", "second order"])
@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_simulated_chain_agrees_at_ten_frequencies(speed: float, steering: SteeringModel) -> None:
    """Within 2 %. Both methods share only the car's equations."""
    simulated = simulated_propagation(CAR, NOMINAL_GAINS, speed, SIMULATED_FREQUENCIES, steering)
    closed = propagation(CAR, NOMINAL_GAINS, speed, steering).at(SIMULATED_FREQUENCIES)
    assert np.abs(simulated / closed - 1.0).max() < 1e-3


def test_simulated_chain_of_loaded_cars() -> None:
    car = loaded(CAR, all_loadings()[-1])
    simulated = simulated_propagation(car, NOMINAL_GAINS, 30.0, SIMULATED_FREQUENCIES)
    closed = propagation(car, NOMINAL_GAINS, 30.0).at(SIMULATED_FREQUENCIES)
    assert np.abs(simulated / closed - 1.0).max() < 1e-3
    assert (
        np.abs(closed / propagation(CAR, NOMINAL_GAINS, 30.0).at(SIMULATED_FREQUENCIES) - 1.0).max()
        > 0.02
    )


def test_an_unstable_loop_does_not_settle() -> None:
    with pytest.raises(ValueError, match="not stable"):
        simulated_propagation(CAR, Gains(0.06, 3.0, 0.08), 30.0, SIMULATED_FREQUENCIES)
