"""Consensus with any information flow, against the eigenvalues and an integration of its errors.

The linear model is that of Santini et al., 2017, and of Ren and Atkins, 2007, for a constant gap:
with the errors e of the positions, e'' = -b P e' - k H e, where H = I - D⁻¹ A over the followers, A
is the graph of the sources and D their numbers; P is I with the lead's speed, else H.
"""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.made.transport.received_poses import received
from vehicles.driver.controller import (
    GapLimits,
    LongitudinalSetup,
    OwnMotion,
    SourceState,
    SpacingPolicy,
    VehiclesAhead,
)
from vehicles.driver.longitudinal_laws import Consensus, ConsensusSettings
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Source
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]

FOLLOWERS, SPACING, SPEED = 6, 12.0, 20.0
LAW = ConsensusSettings()
FLOWS: dict[str, Callable[[int, int], bool]] = {
    "predecessor": lambda place, other: other == place - 1,
    "lead and predecessor": lambda place, other: other in {0, place - 1},
    "three ahead": lambda place, other: place - 3 <= other < place,
    "bidirectional": lambda place, other: abs(place - other) == 1,
    "bidirectional and lead": lambda place, other: abs(place - other) == 1 or other == 0,
    "all": lambda place, other: other != place,
}


def sources_of(flow: str, place: int) -> list[int]:
    return [other for other in range(FOLLOWERS + 1) if FLOWS[flow](place, other)]


def weight(place: int, other: int) -> float:
    """Plexe's weight of a source, over the mass of 1000 kg."""
    if other == 0:
        return 0.46 if place == 1 else 0.08
    return 0.86


def system(flow: str) -> Floats:
    """State matrix of the errors e and e' of the followers, with that of the lead 0."""
    coupling, damping = np.zeros((FOLLOWERS, FOLLOWERS)), np.eye(FOLLOWERS)
    for place in range(1, FOLLOWERS + 1):
        sources = sources_of(flow, place)
        for other in sources:
            share = weight(place, other) / len(sources)
            coupling[place - 1, place - 1] += share
            if other > 0:
                coupling[place - 1, other - 1] -= share
                if 0 not in sources:
                    damping[place - 1, other - 1] -= 1.0 / len(sources)
    zero, one = np.zeros((FOLLOWERS, FOLLOWERS)), np.eye(FOLLOWERS)
    return np.block([[zero, one], [-coupling, -LAW.speed_gain * damping]])


def commands(flow: str, positions: Floats, speeds: Floats) -> list[float]:
    """Commands of the shipped law, from exact poses without delay."""
    result = []
    for place in range(1, FOLLOWERS + 1):
        sources = sources_of(flow, place)
        policies = {f"v{other}": SpacingPolicy((place - other) * SPACING) for other in sources}
        setup = LongitudinalSetup(
            SpacingPolicy(SPACING),
            GapLimits(),
            lead="v0",
            predecessor=f"v{place - 1}",
            policies=policies,
        )
        motions = {
            f"v{other}": SourceState(
                "fresh", 0.0, speed=speeds[other], spacing=positions[other] - positions[place]
            )
            for other in sources
        }
        ahead = VehiclesAhead(
            spacing=positions[place - 1] - positions[place],
            predecessor_speed=speeds[place - 1],
            lead_speed=speeds[0] if 0 in sources else math.nan,
            own=OwnMotion(),
            sources=motions,
        )
        result.append(Consensus(setup, LAW).acceleration(speeds[place], ahead))
    return result


@pytest.mark.parametrize("flow", FLOWS)
def test_the_law_is_the_linear_model(flow: str) -> None:
    """Commands in drawn states, and errors 300 s after a disturbance."""
    matrix, random = system(flow), np.random.default_rng(1)
    rest = -SPACING * np.arange(FOLLOWERS + 1.0)
    errors = random.normal(size=(20, 2 * FOLLOWERS))
    for error in errors:
        positions: Floats = rest + np.concatenate(([0.0], error[:FOLLOWERS]))
        speeds = SPEED + np.concatenate(([0.0], error[FOLLOWERS:]))
        expected = (matrix @ error)[FOLLOWERS:]
        assert commands(flow, positions, speeds) == pytest.approx(expected.tolist(), abs=1e-9)
    solution = solve_ivp(lambda _, error: matrix @ error, (0.0, 300.0), errors[0], rtol=1e-8)
    assert np.abs(solution.y[:, -1]).max() < 1e-2 * np.abs(errors[0]).max()


@pytest.mark.parametrize("radius", [math.inf, 40.0, -15.0])
def test_the_spacing_to_vehicles_behind_is_the_arc_length(radius: float) -> None:
    """It is exact on an arc, and within 4 % of the gap where a straight becomes one."""
    curvature = 1.0 / radius
    for gap, begin in ((8.0, 60.0), (30.0, 60.0), (30.0, 90.0)):
        for here in np.arange(begin, 200.0, 1.0).tolist():
            one, place = at(here, curvature), at(here - gap, curvature)
            source = Source("v4", 0.1, DegradationSettings(), place=-1)
            source.receive(received(SECOND, place.east, place.north, place.yaw, SPEED))
            source.update(SECOND, one, 0.0, refit=True)
            error = 1e-6 if begin > 60.0 else 0.04 * gap
            assert source.state.spacing == pytest.approx(-gap, abs=error)


def at(station: float, curvature: float) -> Pose:
    """Pose on a straight, and then on a circle."""
    driven = max(station - 60.0, 0.0)
    angle, straight = driven * curvature, min(station, 60.0)
    east = straight + (math.sin(angle) / curvature if curvature else driven)
    north = (1.0 - math.cos(angle)) / curvature if curvature else 0.0
    return Pose(east, north, angle, SPEED, SPEED * curvature)
