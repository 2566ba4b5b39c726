"""What followers had to have done by an instant: found from messages in any order."""

from collections.abc import Mapping
from random import Random

import pytest

from scenarios.definition.schema.limit_tables import (
    ModeLimit,
    RecoveryLimit,
    SourceLimit,
)
from scenarios.results.limits import deadline_figures
from scenarios.results.summary import LimitFigure
from tests.made.scenarios.messages import START, tracking, truth
from tests.made.scenarios.tables import run_of
from vehicles.messages import Tracking
from vehicles.schedule import SECOND

PREDECESSOR = ModeLimit(vehicle="v3", mode="predecessor", after_s=2.0, within_s=0.6)
DISTRUST = SourceLimit(vehicle="v3", source="v2", status="distrusted", after_s=2.0, within_s=0.6)
RECOVERY = RecoveryLimit(vehicle="v3", error_m=0.3, after_s=2.0, within_s=1.0)
RAN = 8 * SECOND


Episode = tuple[str, float, float]
"""The value of a field of Tracking, from when to when (s)."""


def messages_of(
    vehicle: str, episodes: Mapping[str, Episode], until_s: float = 8.0
) -> list[Tracking]:
    """Tracking of a vehicle at 50 Hz."""
    return [
        tracking(
            vehicle,
            seq,
            **{
                name: value
                for name, (value, from_s, to_s) in episodes.items()
                if from_s <= seq / 50 < to_s
            },
        )
        for seq in range(round(50 * until_s))
    ]


def messages(until_s: float = 8.0, **episodes: Episode) -> list[Tracking]:
    return messages_of("v3", episodes, until_s)


def figure(
    limit: ModeLimit | SourceLimit | RecoveryLimit,
    received: list[Tracking],
    errors: dict[float, float] | None = None,
    ran_ns: int = RAN,
) -> LimitFigure:
    """The figure of one limit; without `errors` the vehicle is on the path all the time."""
    kind = {ModeLimit: "modes", SourceLimit: "sources", RecoveryLimit: "recovery"}[type(limit)]
    keys = ", ".join(
        f"{key} = {value!r}" for key, value in limit.model_dump().items() if value is not None
    )
    poses = []
    for one in received:
        k = round(50 * (one.decided_at_ns - START) / SECOND)
        off = (errors or {}).get(k / 50, 0.0)
        poses += [truth("v1", k, 0.4 * k, 0.0), truth(one.vehicle, k, 0.4 * k - 20.0, off)]
    lead = [truth("v1", k, 0.4 * k, 0.0) for k in range(50 * 9)]
    run = run_of(
        *lead,
        *received,
        *poses,
        overrides=[f"limits.{kind}=[{{{keys}}}]"],
        ran_s=ran_ns / SECOND,
    )
    (found,) = deadline_figures(run)
    return found


@pytest.mark.parametrize(
    ("from_s", "took_s", "broken"),
    [(2.4, 0.4, False), (2.6, 0.6, False), (2.62, 0.62, True), (1.0, 0.0, False)],
)
def test_a_mode_counts_from_the_instant_on(from_s: float, took_s: float, broken: bool) -> None:
    found = figure(PREDECESSOR, messages(mode=("predecessor", from_s, 5.0)))
    assert (found.value, found.broken) == (took_s, broken)


def test_a_run_that_ended_before_the_deadline_breaks_no_limit() -> None:
    received = messages(until_s=2.4)
    assert not figure(PREDECESSOR, received, ran_ns=round(2.4 * SECOND)).broken
    assert figure(PREDECESSOR, received, ran_ns=round(2.6 * SECOND)).broken


@pytest.mark.parametrize(
    ("episodes", "took_s"),
    [
        ({}, 0.0),
        ({"mode": ("stop", 1.0, 2.5)}, 0.48),
        ({"predecessor_status": ("probation", 1.0, 3.0)}, 0.98),
        ({"lead_status": ("lost", 1.0, 1.9)}, 0.0),
        ({"mode": ("coast", 6.0, 6.02)}, 4.0),
        ({"mode": ("coast", 6.0, 9.0)}, None),
    ],
)
def test_recovery_requires_all_sources_until_the_end(
    episodes: dict[str, Episode], took_s: float | None
) -> None:
    found = figure(RECOVERY, messages_of("v3", episodes))
    assert found.value == (None if took_s is None else pytest.approx(took_s))
    assert found.broken == (took_s is None or took_s > 1.0)


def test_recovery_requires_being_on_the_path() -> None:
    assert figure(RECOVERY, messages(), {2.5: 0.31, 3.0: -0.29}).value == pytest.approx(0.5)
    assert figure(RECOVERY, messages(), {1.5: 0.31}).value == 0.0
    assert figure(RECOVERY, messages(), {7.98: -0.31}).value is None  # it was not at the end


def test_the_order_of_messages_does_not_matter() -> None:
    own = messages(mode=("predecessor", 2.3, 3.1), predecessor_status=("distrusted", 2.1, 3.1))
    mixed = Random(1).sample(own, len(own))
    for limit in (PREDECESSOR, DISTRUST, RECOVERY):
        assert figure(limit, mixed) == figure(limit, own)
