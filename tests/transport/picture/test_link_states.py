import pytest

from tests.made.transport import drive
from transport.picture.link_states import WAIT_NS, WINDOW_NS, LinkStates

MILLISECOND = 1_000_000
START = 1_700_000_000_000_000_000 // WINDOW_NS * WINDOW_NS
LINK = "v2/from_v1"


def shown(outcomes: list[tuple[int, str]], until_ms: int) -> list[tuple[int, str]]:
    """State changes in ms since the start, for verdicts (ms, outcome) heard in this order."""
    states = LinkStates()
    found: list[tuple[int, str]] = []
    for seq, (at_ms, outcome) in enumerate(outcomes):
        now = START + at_ms * MILLISECOND
        states.count(LINK, drive.verdict("v2", "v1", seq, now, outcome))
        found += [((at - START) // MILLISECOND, state) for _, at, state in states.changes(now)]
    end = START + until_ms * MILLISECOND
    found += [((at - START) // MILLISECOND, state) for _, at, state in states.changes(end)]
    return found


@pytest.mark.parametrize(
    ("outcomes", "state"),
    [
        (["ok"] * 10, "ok"),
        (["ok"] * 9 + ["late"], "late"),
        (["ok"] * 8 + ["late", "loss"], "some lost"),
        (["ok"] * 6 + ["loss"] * 4, "some lost"),
        (["ok"] * 5 + ["loss"] * 5, "many lost"),
        (["loss"], "many lost"),
        (["ok", "rate"] * 5, "ok"),
        (["ok", "rate", "rate", "loss", "rate", "ok"], "some lost"),
    ],
)
def test_state_of_one_window(outcomes: list[str], state: str) -> None:
    assert shown([(50 * k, outcome) for k, outcome in enumerate(outcomes)], 1000) == [(0, state)]


def test_only_changes_are_told_and_silence_is_one() -> None:
    heard = [(50 * k, "ok") for k in range(20)] + [(50 * k, "ok") for k in range(60, 80)]
    assert shown(heard, 6000) == [(0, "ok"), (1000, "silent"), (3000, "ok"), (4000, "silent")]


def test_a_window_waits_for_verdicts_on_their_way() -> None:
    states = LinkStates()
    states.count(LINK, drive.verdict("v2", "v1", 0, START, "ok"))
    assert not list(states.changes(START + WINDOW_NS + WAIT_NS - 1))
    states.count(LINK, drive.verdict("v2", "v1", 1, START + 100 * MILLISECOND, "loss"))
    assert [state for _, _, state in states.changes(START + WINDOW_NS + WAIT_NS)] == ["many lost"]


def test_a_verdict_that_comes_too_late_for_its_window_counts_in_the_next() -> None:
    states = LinkStates()
    states.count(LINK, drive.verdict("v2", "v1", 0, START, "ok"))
    assert list(states.changes(START + WINDOW_NS + WAIT_NS)) == [(LINK, START, "ok")]
    states.count(LINK, drive.verdict("v2", "v1", 1, START + MILLISECOND, "loss"))
    later = list(states.changes(START + 2 * WINDOW_NS + WAIT_NS))
    assert later == [(LINK, START + WINDOW_NS, "many lost")]
