"""The schema file, the generated code and the messages agree."""

import sys
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from subprocess import run
from typing import Literal, get_args, get_origin

import pytest
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import DescriptorProto

import transport
from transport.codec import PROTOBUF
from transport.topics import TOPICS, Topic
from vehicles.messages import FloatOrNan

HERE = Path(transport.__file__).parent
KINDS = {
    str: {FieldDescriptor.TYPE_STRING},
    float: {FieldDescriptor.TYPE_DOUBLE},
    bool: {FieldDescriptor.TYPE_BOOL},
    int: {
        FieldDescriptor.TYPE_INT64,
        FieldDescriptor.TYPE_UINT64,
        FieldDescriptor.TYPE_UINT32,
        FieldDescriptor.TYPE_SINT32,
    },
}


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_fields_are_those_of_the_message_in_its_order(topic: Topic) -> None:
    in_schema = PROTOBUF[topic.message].DESCRIPTOR.fields
    assert [f.name for f in in_schema] == [f.name for f in fields(topic.message)]
    described = DescriptorProto()
    PROTOBUF[topic.message].DESCRIPTOR.CopyToProto(described)
    removed = {n for one in described.reserved_range for n in range(one.start, one.end)}
    numbers = [f.number for f in in_schema]
    assert numbers == sorted(set(range(1, len(in_schema) + len(removed) + 1)) - removed)


@pytest.mark.parametrize("topic", TOPICS.values(), ids=TOPICS)
def test_fields_have_the_kind_of_the_message(topic: Topic) -> None:
    for ours, theirs in zip(
        fields(topic.message), PROTOBUF[topic.message].DESCRIPTOR.fields, strict=True
    ):
        kind = ours.type
        is_list = get_origin(kind) is tuple
        if is_list:
            kind = get_args(kind)[0]
        if get_origin(kind) is Literal:
            kind = str
        elif kind == FloatOrNan:
            kind = float
        assert theirs.type in KINDS[kind], ours.name  # type: ignore[index]  # a plain class by now
        assert theirs.is_repeated == is_list, ours.name
        assert theirs.has_presence == (not is_list), ours.name
        if ours.name.endswith("_at_ns"):
            assert theirs.type == FieldDescriptor.TYPE_INT64, ours.name


@pytest.mark.skipif(
    find_spec("grpc_tools") is None or find_spec("mypy_protobuf") is None,
    reason="grpcio-tools and mypy-protobuf, which generate the code, are not installed",
)
def test_generated_code_belongs_to_the_schema(tmp_path: Path) -> None:
    plugin = tmp_path / "protoc-gen-mypy"
    plugin.write_text(f"#!{sys.executable}\nfrom mypy_protobuf.main import main\nmain()\n")
    plugin.chmod(0o755)
    command = [sys.executable, "-m", "grpc_tools.protoc", f"-I{HERE}"]
    command += [f"--python_out={tmp_path}", f"--mypy_out={tmp_path}"]
    command += [f"--plugin={plugin}", "convoy.proto"]
    done = run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ("convoy_pb2.py", "convoy_pb2.pyi"):
        assert (tmp_path / name).read_text() == (HERE / name).read_text(), name
