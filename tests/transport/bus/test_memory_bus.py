"""The memory bus: immediate, in order, with Zenoh's key expressions."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from transport.bus.bus import MemoryBus, matches

chunks = st.sampled_from(["convoy", "lead", "a", "gps", "@alive", "@x"])
wanted_chunks = st.one_of(chunks, st.just("*"))


@given(
    wanted=st.lists(wanted_chunks, min_size=1, max_size=4),
    tail=st.booleans(),
    key=st.lists(chunks, min_size=1, max_size=5),
)
def test_keys_match_as_in_zenoh(wanted: list[str], tail: bool, key: list[str]) -> None:
    expression = "/".join([*wanted, "**"] if tail else wanted)
    expected = zenoh.KeyExpr(expression).intersects(zenoh.KeyExpr("/".join(key)))
    assert matches(expression, "/".join(key)) == expected


@pytest.mark.parametrize(
    ("expression", "key", "expected"),
    [
        ("convoy/*/gps", "convoy/lead/gps", True),
        ("convoy/*/gps", "convoy/lead/truth", False),
        ("convoy/*/gps", "convoy/lead/more/gps", False),
        ("convoy/**", "convoy", True),
        ("convoy/**", "convoy/lead/gps", True),
        ("convoy/**", "convoy/@alive/lead", False),
        ("convoy/@alive/*", "convoy/@alive/lead", True),
        ("**", "anything/at/all", True),
    ],
)
def test_keys_match(expression: str, key: str, expected: bool) -> None:
    assert matches(expression, key) == expected


def test_publish_delivers_before_it_returns_in_order_of_subscription() -> None:
    bus, received = MemoryBus(), list[str]()
    bus.subscribe("convoy/**", lambda *_: received.append("first"))
    bus.subscribe("convoy/lead/gps", lambda *_: received.append("second"))
    bus.publish("convoy/lead/gps", b"")
    assert received == ["first", "second"]
