"""A follower with more than two sources: weights, modes, and what it protects."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.exact_drives import Source as Received
from tests.made.vehicles.exact_drives import Step, drive, on, received_from
from tests.made.vehicles.followers import BEND, SPACING, follower, modes
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources

SETTINGS = DegradationSettings()
CUT_AT, SPEED, AT = 3.0, 10.0, 30.0


def sources(weights: Sequence[float], *, lateral: Sequence[str] = ()) -> Sources:
    """Sources v1 (the lead) to vn (the predecessor), with weights of their own."""
    names = [f"v{place}" for place in range(1, len(weights) + 1)]
    made = []
    for place, (name, weight) in enumerate(zip(names, weights, strict=True)):
        source = Source(name, 0.05, SETTINGS, place=len(names) - place if place else 0)
        source.weight = weight
        made.append(source)
    return Sources(made, SETTINGS, lead="v1", predecessor=names[-1], lateral=lateral or names)


@given(weights=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=6), alpha=st.floats(0.0, 1.0))
def test_weights_add_up_to_one_and_a_lost_source_has_none(
    weights: list[float], alpha: float
) -> None:
    found = sources(weights).weights(alpha)
    assert sum(found.values()) == pytest.approx(1.0)
    assert all(0.0 <= weight <= 1.0 for weight in found.values())
    # α of eq. (5) for the predecessor, the rest equally: relative to each other as they are.
    own = [(1.0 - alpha) / (len(weights) - 1) * weight for weight in weights[:-1]]
    own.append(alpha * weights[-1])
    if sum(own) > 1e-6:
        expected = [weight / sum(own) for weight in own]
        assert list(found.values()) == pytest.approx(expected, abs=1e-6)


def driven(*silent: str, seconds: float = 5.5) -> list[Step]:
    """A follower behind three cars in a bend, some of which are silent from CUT_AT on."""
    names = ("v1", "v2", "v3")
    received = [
        Received(
            name,
            BEND,
            AT + (3 - place) * SPACING,
            SPEED,
            ((0.0, CUT_AT if name in silent else 99.0),),
        )
        for place, name in enumerate(names)
    ]
    driver = follower(predecessor="v3", between=("v2",), degradation=SETTINGS)
    return drive(driver, on(BEND, AT, SPEED), seconds, received_from(*received))


def test_without_the_predecessor_it_steers_along_the_others_and_falls_back() -> None:
    steps = driven("v3")
    last, situation = steps[-1].decision, steps[-1].decision.situation
    assert [mode for mode, _ in modes(steps)] == ["straight", "composite"]
    assert "v3 silent" in last.reason
    assert "v1" not in last.reason
    assert "v2" not in last.reason
    assert (situation.predecessor.status, situation.others["v2"].status) == ("lost", "fresh")
    assert situation.weights["v3"] == 0.0
    assert situation.weights["v1"] == situation.weights["v2"] == 0.5
    assert last.fit is None or {0, 2} == set(last.fit.source.tolist())
    off = [BEND.project(s.body.east, s.body.north, AT + s.body.distance).lateral for s in steps]
    assert max(map(abs, off)) < 0.1
    # It does not receive its predecessor: it falls back a little, as the lead drives on.
    assert situation.state == "alone"
    assert SPEED - 1.0 < steps[-1].body.speed < SPEED - 0.2


def test_it_stops_within_the_known_path_of_the_lead_if_the_predecessor_was_never_received() -> None:
    sender = Received("v1", BEND, AT + 2 * SPACING, SPEED, ((0.0, CUT_AT),))
    driver = follower(degradation=SETTINGS)
    steps = drive(driver, on(BEND, AT, SPEED), 9.0, received_from(sender))
    stopping = [step.decision for step in steps if step.decision.mode == "stop"]
    assert all(decision.situation.known > 0.0 for decision in stopping)
    assert min(decision.actuation.acceleration for decision in stopping) > -2.0
