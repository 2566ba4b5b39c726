"""Standard Foxglove messages made from ours, so that a log opens without this project.

| ours                | standard                | topic in the log                |
| ------------------- | ----------------------- | ------------------------------- |
| GpsPose             | foxglove.LocationFix    | `/convoy/<vehicle>/location` ¹  |
| TruePose            | foxglove.PoseInFrame    | `/convoy/<vehicle>/pose`        |
| TruePose            | foxglove.FrameTransform | `/convoy/<vehicle>/transform`   |
| TruePose            | foxglove.SceneUpdate    | `/convoy/<vehicle>/box`         |
| CompositeTrajectory | foxglove.PosesInFrame   | `/convoy/<vehicle>/preview`     |
| LogText             | foxglove.Log            | `/convoy/<vehicle>/text`        |
| RunStart            | foxglove.SceneUpdate    | `/convoy/run/road`              |
| RunStart            | foxglove.PosesInFrame   | `/convoy/run/path`              |

¹ As JSON: Rerun shows a LocationFix in Protobuf on a map, for which it asks the Internet for tiles.

The world frame `map` is east, north, up at the scenario's origin. The frame of a vehicle has its
name and is forward, left, up.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from transport.log.scene import FRAME_ID, Scene
from vehicles.geometry.trajectory_points import points_along
from vehicles.messages import CompositeTrajectory, GpsPose, LogText, Message, RunStart, TruePose
from vehicles.schedule import MILLISECOND, SECOND

PREVIEW_SPACING_M = 2.0
"""Distance between the poses of a composite trajectory."""
PREVIEW_PERIOD_NS = 200 * MILLISECOND
POSE_PERIOD_NS = 80 * MILLISECOND
"""True poses of every fourth control tick; our own topics contain all of them."""
ONCE_NS = 2**62
"""Period of messages logged once."""
_LEVELS = {
    "debug": Log.DEBUG,
    "info": Log.INFO,
    "warning": Log.WARNING,
    "error": Log.ERROR,
    "alert": Log.ERROR,
    "fatal": Log.FATAL,
}


class Schema(NamedTuple):
    """Name, encoding and content of a schema, and the encoding of its messages."""

    name: str
    encoding: str
    data: bytes
    message_encoding: str


@dataclass(frozen=True, slots=True)
class StandardMessage:
    """A standard message made from one of ours, at most one per vehicle and `period_ns`."""

    name: str
    schema: Schema
    make: Callable[[Any], bytes]
    period_ns: int = 0


@cache
def protobuf_schema(message_class: Any) -> Schema:
    """Schema of a Protobuf class: the FileDescriptorSet of its file after all dependencies."""
    files = FileDescriptorSet()
    added: set[str] = set()

    def add(file: FileDescriptor) -> None:
        if file.name in added:
            return
        added.add(file.name)
        for dependency in file.dependencies:
            add(dependency)
        file.CopyToProto(files.file.add())

    add(message_class.DESCRIPTOR.file)
    data = files.SerializeToString(deterministic=True)
    return Schema(message_class.DESCRIPTOR.full_name, "protobuf", data, "protobuf")


_NUMBER = {"type": "number"}
_LOCATION_FIELDS = {
    "timestamp": {
        "type": "object",
        "title": "time",
        "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
    },
    "frame_id": {"type": "string"},
    "latitude": _NUMBER,
    "longitude": _NUMBER,
    "altitude": _NUMBER,
    "position_covariance": {"type": "array", "items": _NUMBER},
    "position_covariance_type": {"type": "integer"},
    "heading": _NUMBER,
    "velocity": {
        "type": "object",
        "title": "foxglove.Vector3",
        "properties": {"x": _NUMBER, "y": _NUMBER, "z": _NUMBER},
    },
}
_LOCATION = {"title": "foxglove.LocationFix", "type": "object", "properties": _LOCATION_FIELDS}
LOCATION_SCHEMA = Schema(
    "foxglove.LocationFix", "jsonschema", json.dumps(_LOCATION).encode(), "json"
)
_APPROXIMATED = 1


def _make_location(gps: GpsPose) -> bytes:
    seconds, nanoseconds = divmod(gps.measured_at_ns, SECOND)
    heading = math.radians(gps.heading_deg)
    # Reported by the receiver; the altitude is assumed to be as accurate.
    variance = gps.position_accuracy_m * gps.position_accuracy_m  # ** raises OverflowError
    fix = {
        "timestamp": {"sec": seconds, "nsec": nanoseconds},
        "frame_id": gps.vehicle,
        "latitude": gps.latitude_deg,
        "longitude": gps.longitude_deg,
        "altitude": gps.altitude_m,
        "position_covariance": [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance],
        "position_covariance_type": _APPROXIMATED,
        "heading": heading,
        "velocity": {
            "x": gps.speed_mps * math.sin(heading),
            "y": gps.speed_mps * math.cos(heading),
            "z": 0.0,
        },
    }
    return json.dumps(fix).encode()


def _pose_maker() -> Callable[[TruePose], bytes]:
    in_frame = PoseInFrame(frame_id=FRAME_ID)
    timestamp = in_frame.timestamp
    position, orientation = in_frame.pose.position, in_frame.pose.orientation

    def make(truth: TruePose) -> bytes:
        timestamp.FromNanoseconds(truth.true_at_ns)
        position.x = truth.east_m
        position.y = truth.north_m
        orientation.z = math.sin(0.5 * truth.yaw_rad)
        orientation.w = math.cos(0.5 * truth.yaw_rad)
        data: bytes = in_frame.SerializeToString()
        return data

    return make


def _transform_maker() -> Callable[[TruePose], bytes]:
    transforms: dict[str, FrameTransform] = {}  # as for locations

    def make(truth: TruePose) -> bytes:
        transform = transforms.get(truth.vehicle)
        if transform is None:
            transform = transforms[truth.vehicle] = FrameTransform(
                parent_frame_id=FRAME_ID, child_frame_id=truth.vehicle
            )
        translation, rotation = transform.translation, transform.rotation
        transform.timestamp.FromNanoseconds(truth.true_at_ns)
        translation.x = truth.east_m
        translation.y = truth.north_m
        rotation.z = math.sin(0.5 * truth.yaw_rad)
        rotation.w = math.cos(0.5 * truth.yaw_rad)
        data: bytes = transform.SerializeToString()
        return data

    return make


def _make_preview(trajectory: CompositeTrajectory) -> bytes:
    poses = PosesInFrame(frame_id=FRAME_ID)
    poses.timestamp.FromNanoseconds(trajectory.decided_at_ns)
    add = poses.poses.add
    for east, north, yaw in points_along(trajectory, PREVIEW_SPACING_M):
        pose = add()
        position, orientation = pose.position, pose.orientation
        position.x = east
        position.y = north
        orientation.z = math.sin(0.5 * yaw)
        orientation.w = math.cos(0.5 * yaw)
    data: bytes = poses.SerializeToString()
    return data


def _make_text(line: LogText) -> bytes:
    text = Log(level=_LEVELS.get(line.level, Log.UNKNOWN), message=line.text, name=line.vehicle)
    text.timestamp.FromNanoseconds(line.logged_at_ns)
    data: bytes = text.SerializeToString()
    return data


def standard_messages(
    scene: Scene | None = None,
) -> Mapping[type[Message], tuple[StandardMessage, ...]]:
    """Standard messages by the class of ours; each call creates its own makers."""
    scene = scene or Scene()
    return {
        GpsPose: (StandardMessage("location", LOCATION_SCHEMA, _make_location),),
        TruePose: (
            StandardMessage("pose", protobuf_schema(PoseInFrame), _pose_maker(), POSE_PERIOD_NS),
            StandardMessage(
                "transform", protobuf_schema(FrameTransform), _transform_maker(), POSE_PERIOD_NS
            ),
            StandardMessage("box", protobuf_schema(SceneUpdate), scene.box_maker(), ONCE_NS),
        ),
        CompositeTrajectory: (
            StandardMessage(
                "preview", protobuf_schema(PosesInFrame), _make_preview, PREVIEW_PERIOD_NS
            ),
        ),
        LogText: (StandardMessage("text", protobuf_schema(Log), _make_text),),
        RunStart: (
            StandardMessage("road", protobuf_schema(SceneUpdate), scene.make_road, ONCE_NS),
            StandardMessage("path", protobuf_schema(PosesInFrame), scene.make_path, ONCE_NS),
        ),
    }
