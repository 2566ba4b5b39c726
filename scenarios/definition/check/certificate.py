"""Whether a scenario's changes of speed stay within what the steering gains are certified for."""

from collections.abc import Iterator

from scenarios.definition.scenario import Scenario
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.varying_speed import FASTEST, SLOWEST, certified_acceleration

STEP = 0.1
"""Time step (s) at which the lead's planned speed is sampled."""


def certificate_warnings(scenario: Scenario) -> Iterator[str]:
    """Give a line for each vehicle whose certificate the lead's planned speed leaves.

    The certificate bounds the change of speed up to which the closed steering loop is certainly
    stable (paper, Proposition 1, made a number: see `vehicles.theory.varying_speed`). It covers the
    linear loop with the paper's law; followers that keep a gap may accelerate a little more than
    the lead.
    """
    said: dict[tuple[VehicleParameters, Gains], str] = {}
    for name in scenario.vehicle_names:
        setup = scenario.vehicle(name)
        said.setdefault((setup.parameters, setup.gains), name)
    for (parameters, gains), name in said.items():
        yield from _leaving(scenario, parameters, gains, name)


def _leaving(
    scenario: Scenario, parameters: VehicleParameters, gains: Gains, name: str
) -> Iterator[str]:
    slow = fast = False
    worst = (1.0, 0.0, 0.0, 0.0)  # share of the bound, time, acceleration, bound
    for k in range(int(scenario.duration_s / STEP)):
        at = k * STEP
        speed, acceleration = scenario.route.profile.at(at)
        slow, fast = slow or speed < SLOWEST, fast or speed > FASTEST
        if acceleration == 0.0 or not SLOWEST <= speed <= FASTEST:
            continue
        bounds = certified_acceleration(parameters, gains, speed)
        bound = bounds[acceleration > 0.0]
        share = abs(acceleration) / bound if bound else float("inf")
        if share > worst[0]:
            worst = (share, at, acceleration, bound)
    if slow or fast:
        reached = " and ".join(
            text
            for text, found in ((f"below {SLOWEST:g}", slow), (f"above {FASTEST:g}", fast))
            if found
        )
        yield f"{name}: speeds {reached} m/s are not covered by the varying-speed certificate"
    if worst[0] > 1.0:
        _, at, acceleration, bound = worst
        yield (
            f"{name}: {acceleration:.1f} m/s² at {at:.1f} s leaves the varying-speed certificate "
            f"of its gains, which holds up to {bound:.1f} m/s² there"
        )
