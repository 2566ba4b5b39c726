"""Positions of a receiver equal those of a plain list, in less memory."""

from hypothesis import given
from hypothesis import strategies as st

from transport.links.inbox import MAX_POSITIONS, PositionHistory
from transport.links.laws.link_law import Position


@given(
    st.lists(st.tuples(st.integers(0, 3), st.floats(-1e6, 1e6)), min_size=1, max_size=40),
    st.integers(-5, 130),
)
def test_a_place_is_that_of_the_last_tick_until_an_instant(
    ticks: list[tuple[int, float]], requested: int
) -> None:
    passed, known, now = PositionHistory(), list[tuple[int, Position]](), 0
    for span, where in ticks:
        now += span
        known.append((now, Position(where, -where, 2.0 * where)))
        passed.add(*known[-1])
    before = [place for at, place in known if at <= requested]
    assert passed.at(requested) == (before[-1] if before else known[0][1])


def test_the_places_of_a_minute_are_remembered_and_few_more() -> None:
    passed = PositionHistory()
    for now in range(5 * MAX_POSITIONS):
        passed.add(now, Position(float(now), 0.0, 0.0))
        first = passed.at(-1).east
        assert now - 1.2 * MAX_POSITIONS < first <= max(now - MAX_POSITIONS + 1, 0)
        assert passed.at(now).east == now
