"""What the paper's law leaves in bends although a car's load is learned: its own slip."""

from collections.abc import Iterator, Sequence

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.tables import CONTROLLERS

PAPER_LAW = CONTROLLERS["feedforward_feedback"]

LEFT_BY_SLIP = 0.01
"""So far (m) beside the path a car may settle in bends before that is said."""


def slip_warnings(scenario: Scenario, planned: Sequence[tuple[float, float]]) -> Iterator[str]:
    """Say how far beside the path followers settle, at `planned` speeds (m/s), curvatures (1/m).

    The heading error of a car that corners settles at its slip angle, which by eq. (7) a lateral
    error balances.
    """
    offsets = {}
    for name in scenario.vehicle_names[1:]:
        setup = scenario.vehicle(name)
        if not setup.steering.estimate_slip or setup.controller != PAPER_LAW:
            continue
        gains, car = setup.gains, setup.parameters
        slip = max(abs(bend * car.steady_slip_per_curvature(speed)) for speed, bend in planned)
        offsets[name] = slip * gains.heading / gains.lateral
    if offsets and (most := max(offsets.values())) >= LEFT_BY_SLIP:
        yield (
            f"{', '.join(offsets)}: estimate_slip learns the load, but in bends the paper's law "
            f"settles {100.0 * most:.1f} cm beside the path, for cars do not point along it there: "
            'control.controller = "slip_compensated" does not'
        )
