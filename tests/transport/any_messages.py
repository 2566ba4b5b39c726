"""Random messages, for property tests."""

from dataclasses import fields
from typing import Any, Literal, get_args, get_origin

from hypothesis import strategies as st

from transport.topics import TOPIC_OF
from vehicles.messages import FloatOrNan, Message

INT64 = st.integers(-(2**63), 2**63 - 1)
UINT64 = st.integers(0, 2**64 - 1)
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
TEXT = st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Zl", "Zp"))


def single(name: str, kind: Any) -> st.SearchStrategy[Any]:
    """Values of a field that is not a list."""
    if get_origin(kind) is Literal:
        return st.sampled_from(get_args(kind))
    if kind is str:
        return st.text(TEXT, min_size=int(name == "vehicle"), max_size=20)
    if kind is int:
        return INT64 if name.endswith("_at_ns") else UINT64
    if kind == FloatOrNan:
        return NUMBER
    return {float: NUMBER, bool: st.booleans()}[kind]


@st.composite
def messages(draw: st.DrawFn, kind: type[Message]) -> Message:
    """Messages of one class; lists of one table have equal lengths."""
    lengths = {
        "piece": draw(st.integers(0, 5)),
        "sample": draw(st.integers(0, 20)),
        "history": draw(st.integers(0, 23)),
        "other": draw(st.integers(0, 4)),
        "relayed": draw(st.integers(0, 4)),
    }
    values: dict[str, Any] = {}
    for field in fields(kind):
        if get_origin(field.type) is tuple:
            n = lengths[field.name.partition("_")[0]]
            whole = get_args(field.type)[0] is int
            column = st.lists(st.integers(0, 1) if whole else NUMBER, min_size=n, max_size=n)
            values[field.name] = tuple(draw(column))
        else:
            values[field.name] = draw(single(field.name, field.type))
    return kind(**values)


KINDS = sorted(TOPIC_OF, key=lambda kind: kind.__name__)
any_message = st.sampled_from(KINDS).flatmap(messages)


def plain_values(kind: type[Message]) -> dict[str, Any]:
    """Ordinary values for all fields of a message."""
    plain: dict[Any, object] = {str: "v1", int: 3, float: 1.5, FloatOrNan: 1.5, bool: True}
    return {
        field.name: get_args(field.type)[0]
        if get_origin(field.type) is Literal
        else (plain[get_args(field.type)[0]],)
        if get_origin(field.type) is tuple
        else plain[field.type]
        for field in fields(kind)
    }
