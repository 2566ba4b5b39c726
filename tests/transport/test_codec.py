"""Messages are decoded unchanged; other bytes are refused with a reason."""

import math
import struct
from contextlib import suppress
from dataclasses import MISSING, fields, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.transport import drive
from tests.transport.any_messages import KINDS, any_message, plain_values
from transport.codec import MAX_BYTES, PROTOBUF, RefusedMessageError, decode, encode, escaped_bytes
from transport.topics import TOPIC_OF, TOPICS, Topic
from vehicles.messages import FloatOrNan, GpsPose, LogText, Message, RunStart

any_topic = st.sampled_from(list(TOPICS.values()))
"""Messages whose fields differ only in their names."""


@examples(16, 150)
@given(any_message)
def test_decoding_inverts_encoding(message: Message) -> None:
    decoded = decode(TOPIC_OF[type(message)], encode(message))
    assert decoded == message
    assert [type(getattr(decoded, f.name)) for f in fields(decoded)] == [
        type(getattr(message, f.name)) for f in fields(message)
    ]


@examples(16, 150)
@given(any_topic, st.binary(max_size=300))
def test_random_bytes_are_refused(topic: Topic, data: bytes) -> None:
    with pytest.raises(RefusedMessageError):
        decode(topic, data)


@examples(22, 200)
@given(data=st.data(), message=any_message, topic=any_topic)
def test_spoilt_messages_are_decoded_or_refused(
    data: st.DataObject, message: Message, topic: Topic
) -> None:
    spoilt = bytearray(encode(message))
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(spoilt)))
        match data.draw(st.sampled_from(["flip", "cut", "insert", "repeat"])):
            case "flip" if at < len(spoilt):
                spoilt[at] ^= 1 << data.draw(st.integers(0, 7))
            case "cut":
                del spoilt[at:]
            case "insert":
                spoilt[at:at] = data.draw(st.binary(min_size=1, max_size=8))
            case _:
                spoilt += spoilt[at:]
    with suppress(RefusedMessageError):
        assert type(decode(topic, bytes(spoilt))) is topic.message


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_field_with_a_default_may_be_missing_in_a_log_only(kind: type[Message]) -> None:
    topic, message = TOPIC_OF[kind], kind(**plain_values(kind))
    for field in fields(kind):
        parsed = PROTOBUF[kind].FromString(encode(message))
        parsed.ClearField(field.name)
        data = parsed.SerializeToString()
        if field.name == "relayed_stops_at_ns":  # a list of its own may be empty
            assert getattr(decode(topic, data, exact=True), field.name) == ()
            continue
        with pytest.raises(RefusedMessageError):
            decode(topic, data, exact=True)
        is_first = field.name in {"history_latitude_e7deg", "other_age_s"}  # of its columns
        if field.default is MISSING or is_first:
            with pytest.raises(RefusedMessageError):
                decode(topic, data)
        elif isinstance(field.default, tuple):
            assert getattr(decode(topic, data), field.name) == (0.0,)
        else:
            assert repr(decode(topic, data)) == repr(
                replace(message, **{field.name: field.default})
            )


def test_zeros_are_sent_and_are_not_taken_for_nothing() -> None:
    start = RunStart(vehicle="run", seq=0, start_at_ns=0, run_id="")
    assert decode(TOPICS["start"], encode(start)) == start
    lacking = PROTOBUF[RunStart](vehicle="run", start_at_ns=0, run_id="")
    with pytest.raises(RefusedMessageError, match=r"garbage.*RunStart"):
        decode(TOPICS["start"], lacking.SerializeToString())


def test_fields_of_a_later_version_are_passed_over() -> None:
    start = RunStart(vehicle="run", seq=1, start_at_ns=2, run_id="x")
    later = bytes([15 << 3 | 1]) + struct.pack("<d", 1.5)
    assert decode(TOPICS["start"], encode(start) + later) == start
    with pytest.raises(RefusedMessageError, match=r"garbage.*RunStart"):
        decode(TOPICS["start"], encode(start) + later, exact=True)


@examples(16, 150)
@given(message=any_message, topic=any_topic)
def test_off_a_bus_no_message_passes_for_another(message: Message, topic: Topic) -> None:
    data = encode(message)
    if type(message) is topic.message:
        assert decode(topic, data, exact=True) == message
    elif not {type(message).__name__, topic.message.__name__} <= {"LogText", "RunEnd"}:
        # Those two have fields of the same types.
        with pytest.raises(RefusedMessageError, match="garbage"):
            decode(topic, data, exact=True)


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_too_much_is_refused_unread(topic: Topic) -> None:
    with pytest.raises(RefusedMessageError, match="oversized") as refusal:
        decode(topic, bytes(MAX_BYTES + 1))
    assert refusal.value.reason == "oversized"


def test_words_outside_the_vocabulary_are_refused() -> None:
    line = LogText(vehicle="a", seq=0, logged_at_ns=0, level="info", text="")
    shouted = encode(replace(line, level="loud"))  # type: ignore[arg-type]  # wrong on purpose
    with pytest.raises(RefusedMessageError, match="level is 'loud'"):
        decode(TOPICS["log"], shouted)


NOT_FINITE = (math.nan, math.inf, -math.inf)
MAY_BE_NAN = {
    "estimated_gap_m",
    "lateral_deviation_m",
    "measured_gap_m",
    "measured_gap_rate_mps",
    "other_age_s",
    "other_received_ratio",
    "other_known_m",
    "other_weight_ratio",
    "lead_age_s",
    "predecessor_age_s",
    "lead_period_s",
    "predecessor_period_s",
    "lead_received_ratio",
    "predecessor_received_ratio",
    "lead_known_m",
    "predecessor_known_m",
    "known_m",
    "blind_m",
    "predecessor_weight_ratio",
    "path_offset_m",
    "law_acceleration_mps2",
}


@pytest.mark.parametrize("value", NOT_FINITE)
@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_off_a_bus_a_number_that_is_not_finite_is_refused(topic: Topic, value: float) -> None:
    message = next(m for _, m in drive.drive(1) if type(m) is topic.message)
    for field in fields(message):
        if field.type not in {float, FloatOrNan, tuple[float, ...], tuple[FloatOrNan, ...]}:
            continue
        number = getattr(message, field.name)
        wrong: Any = (value, *number[1:]) if isinstance(number, tuple) else value
        others = [one.name for one in fields(message) if one.name.startswith("other_")]
        spoilt_fields = {field.name: wrong}
        if field.name in others:  # columns of one table
            spoilt_fields = {name: wrong for name in others if name != "other_sources"}
        spoilt = encode(replace(message, **spoilt_fields))
        decode(topic, spoilt)  # allowed in a log
        if field.name in MAY_BE_NAN and math.isnan(value):
            decode(topic, spoilt, exact=True)
            continue
        with pytest.raises(RefusedMessageError, match=field.name.split("_")[0]) as refusal:
            decode(topic, spoilt, exact=True)
        assert refusal.value.reason == "absurd"


def test_control_characters_in_texts_are_escaped() -> None:
    line = LogText(
        vehicle="a", seq=0, logged_at_ns=0, level="info", text="\x1b[31mred\r\n\u202egpj Grüße — ψ"
    )
    data = encode(line)
    read = decode(TOPICS["log"], data, exact=True)
    assert isinstance(read, LogText)
    assert read.text == r"\x1b[31mred\r\n\u202egpj Grüße — ψ"
    assert decode(TOPICS["log"], escaped_bytes(data, read)) == read
    plain = replace(line, text="plain")
    assert escaped_bytes(encode(plain), plain) == encode(plain)


@given(data=st.data(), message=any_message)
def test_a_message_cut_anywhere_is_refused(data: st.DataObject, message: Message) -> None:
    whole = encode(message)
    cut = data.draw(st.integers(0, len(whole) - 1))
    if isinstance(message, GpsPose) and whole[:cut] == encode(without_history(message)):
        return  # a complete pose, which need not have a history
    with pytest.raises(RefusedMessageError):
        decode(TOPIC_OF[type(message)], whole[:cut], exact=True)


def without_history(pose: GpsPose) -> GpsPose:
    return replace(pose, history_latitude_e7deg=(), history_longitude_e7deg=(), history_age_cs=())
