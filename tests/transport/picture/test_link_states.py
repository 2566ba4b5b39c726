"""The state of a link follows from the verdicts' own instants, whenever anybody looks."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport import drive
from transport.picture.curves import MARGIN_NS, WINDOW_NS, LinkStates, LinkWindow
from vehicles.schedule import MILLISECOND, SECOND

START = 1_700_000_000 * SECOND
LINK = "v1_to_v2"


def windows(outcomes: list[tuple[int, str]], until_ms: int) -> list[LinkWindow]:
    """Windows of a link, for verdicts (ms, outcome), with their ms since the start."""
    states = LinkStates()
    result: list[LinkWindow] = []
    for seq, (at_ms, outcome) in enumerate(outcomes):
        at = START + at_ms * MILLISECOND
        result += states.passed("v2", at)
        states.count(LINK, drive.verdict("v2", "v1", seq, at, outcome))
    result += states.passed("v2", START + until_ms * MILLISECOND)
    return [window._replace(at=(window.at - START) // MILLISECOND) for window in result]


@pytest.mark.parametrize(
    ("outcomes", "state", "share"),
    [
        (["ok"] * 10, "ok", 0.0),
        (["ok"] * 9 + ["late"], "late", 0.0),
        (["ok"] * 8 + ["late", "loss"], "10 % lost", 0.1),
        (["ok"] * 99 + ["loss"], "10 % lost", 0.01),  # some were lost, so not "ok"
        (["ok"] * 6 + ["loss"] * 4, "40 % lost", 0.4),
        (["loss"] * 99 + ["ok"], "90 % lost", 0.99),  # not all were lost
        (["loss"], "100 % lost", 1.0),
        (["ok", "rate"] * 5, "ok", 0.0),
        (["ok", "rate", "rate", "loss", "rate", "ok"], "30 % lost", 1 / 3),
    ],
)
def test_state_of_one_window(outcomes: list[str], state: str, share: float) -> None:
    result = windows([(4 * k, outcome) for k, outcome in enumerate(outcomes)], 700)
    assert [(window.at, window.state) for window in result] == [(0, state)]
    assert result[0].loss_ratio == pytest.approx(share)


def test_a_window_ends_by_the_receivers_time() -> None:
    """Not by anybody's clock: a recorder that is seconds behind sees no silence."""
    states = LinkStates()
    states.count(LINK, drive.verdict("v2", "v1", 0, START, "ok"))
    end = START + WINDOW_NS + MARGIN_NS
    assert list(states.passed("v2", end - 1)) == []
    assert list(states.passed("v3", end + 100 * SECOND)) == []
    states.count(LINK, drive.verdict("v2", "v1", 1, START + 100 * MILLISECOND, "loss"))
    assert list(states.passed("v2", end)) == [LinkWindow(LINK, START, "50 % lost", 0.5)]


@given(
    outcomes=st.lists(st.sampled_from(["ok", "late", "loss", "rate"]), max_size=60),
    random=st.randoms(use_true_random=False),
)
def test_states_are_independent_of_the_reading_rate(outcomes: list[str], random: Random) -> None:
    verdicts = [(50 * k, outcome) for k, outcome in enumerate(outcomes)]
    seldom = windows(verdicts, 4000)
    states, result = LinkStates(), list[LinkWindow]()
    for seq, (at_ms, outcome) in enumerate(verdicts):
        at = START + at_ms * MILLISECOND
        for _ in range(random.randrange(3)):
            result += states.passed("v2", at - random.randrange(MARGIN_NS))
        states.count(LINK, drive.verdict("v2", "v1", seq, at, outcome))
    result += states.passed("v2", START + 4 * SECOND)
    assert [window._replace(at=(window.at - START) // MILLISECOND) for window in result] == seldom
