"""Hypothesis strategies of cars and gains for the linear model."""

from hypothesis import strategies as st

from vehicles.car.parameters import LINCOLN_MKZ, Gains, VehicleParameters


def _between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


CARS = st.builds(
    VehicleParameters,
    mass=_between(800.0, 4000.0),
    yaw_inertia=_between(1000.0, 8000.0),
    front_cornering_stiffness=_between(5e4, 6e5),
    rear_cornering_stiffness=_between(5e4, 6e5),
    front_axle_distance=_between(0.8, 2.0),
    rear_axle_distance=_between(0.8, 2.0),
    steering_frequency=_between(8.0, 40.0),
    steering_damping=_between(0.2, 1.0),
    steering_limit=st.just(0.5),
    length=st.just(4.9),
    width=st.just(1.9),
)
SPEEDS = _between(3.0, 40.0)
GAINS = st.builds(Gains, _between(0.0, 0.5), _between(0.0, 2.0), _between(-0.1, 0.3))
CAR = LINCOLN_MKZ
