"""What is packed by functions made of the schema is to the byte what Protobuf's library writes."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
from google.protobuf.wrappers_pb2 import BytesValue
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made.transport.any_messages import any_message
from transport.codec import PROTOBUF
from transport.convoy_pb2 import CompositeTrajectory, LinkVerdict, TruePose
from transport.packing import packed_counts, packer_of, varint
from transport.topics import TOPICS, Topic
from vehicles.messages import Message


def by_the_library(kind: Any, message: object) -> bytes:
    values = {field.name: getattr(message, field.name) for field in kind.DESCRIPTOR.fields}
    data: bytes = kind(**values).SerializeToString()
    return data


@settings(max_examples=300)
@given(any_message)
def test_the_bytes_are_those_of_the_library(message: Message) -> None:
    kind = PROTOBUF[type(message)]
    assert packer_of(kind.DESCRIPTOR)(message) == by_the_library(kind, message)


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
@pytest.mark.parametrize("number", [0, 1, 127, 128, 16_384, 2**31, 2**32 - 1])
def test_zeros_empty_texts_and_numbers_of_any_length(topic: Topic, number: int) -> None:
    kind = PROTOBUF[topic.message]
    values: dict[str, Any] = {}
    for field in kind.DESCRIPTOR.fields:
        if field.is_repeated:
            values[field.name] = (0, number, 1)
        elif field.type == field.TYPE_STRING:
            values[field.name] = "ä" * (number % 300)
        else:
            values[field.name] = number % 2 if field.type == field.TYPE_BOOL else number
    message = SimpleNamespace(**values)
    assert packer_of(kind.DESCRIPTOR)(message) == by_the_library(kind, message)


@given(st.integers(-(2**63), 2**63 - 1), st.floats())
def test_any_instant_and_any_float(at: int, east: float) -> None:
    blank = dict.fromkeys([field.name for field in TruePose.DESCRIPTOR.fields], 0.0)
    pose = SimpleNamespace(**blank | {"vehicle": "v1", "seq": 0, "true_at_ns": at, "east_m": east})
    data = packer_of(TruePose.DESCRIPTOR)(pose)
    assert data == by_the_library(TruePose, pose)
    read = TruePose.FromString(data)
    assert read.true_at_ns == at
    assert read.east_m == east or (math.isnan(read.east_m) and math.isnan(east))


@given(st.integers(0, 2**64 - 1))
def test_seven_bits_of_a_number_at_a_time(number: int) -> None:
    groups = varint(number)
    assert sum((byte & 0x7F) << 7 * place for place, byte in enumerate(groups)) == number
    assert [byte >> 7 for byte in groups] == [1] * (len(groups) - 1) + [0]
    assert len(groups) == max(math.ceil(number.bit_length() / 7), 1)


@pytest.mark.parametrize("values", [{"seq": -1}, {"seq": 2**64}, {"sent_at_ns": 2**63}])
def test_an_integer_out_of_range_is_refused_as_the_library_does(values: dict[str, int]) -> None:
    blank: dict[str, Any] = {field.name: 0 for field in LinkVerdict.DESCRIPTOR.fields}
    for field in LinkVerdict.DESCRIPTOR.fields:
        if field.type == field.TYPE_STRING:
            blank[field.name] = ""
    verdict = SimpleNamespace(**blank | values)
    with pytest.raises(ValueError, match="out of range"):
        by_the_library(LinkVerdict, verdict)
    with pytest.raises(ValueError, match="64 bits"):
        packer_of(LinkVerdict.DESCRIPTOR)(verdict)


@pytest.mark.parametrize("numbers", [(-1,), (0, 2**32)])
def test_a_column_of_counts_with_one_out_of_range_is_refused(numbers: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="out of range"):
        CompositeTrajectory(sample_source=numbers)
    with pytest.raises(ValueError, match="32 bits"):
        packed_counts(b"b", numbers)


def test_a_schema_with_fields_of_another_kind_has_no_packer() -> None:
    with pytest.raises(TypeError, match=r"google\.protobuf\.BytesValue\.value"):
        packer_of(BytesValue.DESCRIPTOR)
