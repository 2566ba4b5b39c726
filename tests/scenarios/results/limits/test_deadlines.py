"""What followers had to have done by an instant: found from messages in any order."""

from collections.abc import Mapping
from random import Random

import pytest

from scenarios.results.limits import deadline_figures
from scenarios.results.summary import LimitFigure
from tests.made.scenarios.messages import tracking, truth
from tests.made.scenarios.tables import run_of
from vehicles.messages import Message

KINDS = {
    "modes": "mode='predecessor', within_s=0.6",
    "sources": "source='v2', status='distrusted', within_s=0.6",
    "recovery": "error_m=0.3, within_s=1.0",
}
"""Deadlines of v3 from 2 s on."""
Episode = tuple[str, float, float]
"""The value of a field of Tracking, from when to when (s)."""


def messages(
    episodes: Mapping[str, Episode], errors: Mapping[float, float], until_s: float
) -> list[Message]:
    """Decisions and poses of v3 at 50 Hz, with its offset (m) from the path at some times (s)."""
    found: list[Message] = []
    for seq in range(round(50 * until_s)):
        now = seq / 50
        states = {field: value for field, (value, a, b) in episodes.items() if a <= now < b}
        found.append(tracking("v3", seq, **states))
        found.append(truth("v3", seq, 0.4 * seq - 20.0, errors.get(now, 0.0)))
    return found


def figure(
    kind: str,
    episodes: Mapping[str, Episode],
    errors: Mapping[float, float] | None = None,
    *,
    until_s: float = 8.0,
    ran_s: float = 8.0,
    mixed: bool = False,
) -> LimitFigure:
    lead = [truth("v1", seq, 0.4 * seq, 0.0) for seq in range(50 * 9)]
    own = messages(episodes, errors or {}, until_s)
    own = Random(1).sample(own, len(own)) if mixed else own
    limits = f"limits.{kind}=[{{vehicle='v3', after_s=2.0, {KINDS[kind]}}}]"
    (found,) = deadline_figures(run_of(*lead, *own, overrides=[limits], ran_s=ran_s))
    return found


@pytest.mark.parametrize(
    ("kind", "episodes", "took_s", "broken"),
    [
        *(
            ("modes", {"mode": ("predecessor", from_s, 5.0)}, took_s, broken)
            for from_s, took_s, broken in
            [(2.4, 0.4, False), (2.6, 0.6, False), (2.62, 0.62, True), (1.0, 0.0, False)]
        ),
        ("modes", {}, None, True),
        ("sources", {"predecessor_status": ("distrusted", 2.1, 3.1)}, 0.1, False),
        # recovery requires all sources until the end
        ("recovery", {}, 0.0, False),
        ("recovery", {"mode": ("stop", 1.0, 2.5)}, 0.48, False),
        ("recovery", {"predecessor_status": ("probation", 1.0, 3.0)}, 0.98, False),
        ("recovery", {"lead_status": ("lost", 1.0, 1.9)}, 0.0, False),
        ("recovery", {"mode": ("coast", 6.0, 6.02)}, 4.0, True),
        ("recovery", {"mode": ("coast", 6.0, 9.0)}, None, True),
    ],
)  # fmt: skip
@pytest.mark.parametrize("mixed", [False, True])
def test_the_time_of_an_action_counts_from_the_instant_on(
    kind: str, episodes: dict[str, Episode], took_s: float | None, broken: bool, mixed: bool
) -> None:
    found = figure(kind, episodes, mixed=mixed)
    assert found.value == (None if took_s is None else pytest.approx(took_s))
    assert found.broken == broken


@pytest.mark.parametrize(
    ("errors", "took_s"),
    [({2.5: 0.31, 3.0: -0.29}, 0.5), ({1.5: 0.31}, 0.0), ({7.98: -0.31}, None)],
)
def test_recovery_requires_being_on_the_path(
    errors: dict[float, float], took_s: float | None
) -> None:
    assert figure("recovery", {}, errors).value == (took_s and pytest.approx(took_s))


@pytest.mark.parametrize(("ran_s", "broken"), [(2.4, False), (2.6, True)])
def test_a_run_that_ended_before_the_deadline_breaks_no_limit(ran_s: float, broken: bool) -> None:
    assert figure("modes", {}, until_s=2.4, ran_s=ran_s).broken == broken
