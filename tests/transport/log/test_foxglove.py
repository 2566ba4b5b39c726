"""The standard messages of a log, read by its own schemas."""

import math
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from tests.made.transport import drive
from tests.made.transport.logs import rows, write


def test_a_stranger_decodes_the_log_by_the_schemas_in_it(tmp_path: Path) -> None:
    """Nothing but the schemas in the file is used to read it: no module of this project."""
    write(tmp_path / "run.mcap")
    found: dict[str, Any] = {}
    for schema, channel, record in rows(tmp_path / "run.mcap"):
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
        if channel.topic not in found:
            found[channel.topic] = kind.FromString(record.data)
    location = found["/convoy/v1/location"]
    assert (location.latitude, location.longitude, location.altitude) == (48.0, 11.0, 500.0)
    assert location.heading == pytest.approx(1.5 * math.pi)  # westwards, clockwise from north
    assert location.velocity.x == pytest.approx(-drive.SPEED)
    assert location.velocity.y == pytest.approx(0.0, abs=1e-12)
    assert location.timestamp.seconds * 1_000_000_000 + location.timestamp.nanos == drive.START
    pose = found["/convoy/v1/pose"]
    assert pose.frame_id == "map"
    assert (pose.pose.position.x, pose.pose.position.y) == pytest.approx((drive.RADIUS, 0.0))
    half = math.pi / 4  # northwards: a quarter turn about the vertical axis
    assert pose.pose.orientation.z == pytest.approx(math.sin(half))
    assert pose.pose.orientation.w == pytest.approx(math.cos(half))
    transform = found["/convoy/v1/transform"]
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "v1")
    assert (transform.translation.x, transform.rotation.z) == (
        pose.pose.position.x,
        pose.pose.orientation.z,
    )
    text = found["/convoy/run/text"]
    assert (text.message, text.level, text.name) == ("off", 3, "run")


def test_preview_poses_lie_on_the_arc(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as file:
        for _, _, record in make_reader(file).iter_messages(topics=["/convoy/v2/preview"]):
            poses = PosesInFrame.FromString(record.data).poses
            assert len(poses) == 5  # 0, 2, 4, 6, 8 m
            for pose in poses[3:]:  # the second arc lies on the circle itself
                distance = math.hypot(pose.position.x, pose.position.y)
                assert distance == pytest.approx(drive.RADIUS, abs=1e-9)
                yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
                tangent = math.atan2(pose.position.y, pose.position.x) + math.pi / 2
                assert math.remainder(yaw - tangent, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
