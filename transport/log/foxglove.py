"""Standard Foxglove messages made from ours, so that a log opens without this project.

The world frame `map` is east, north, up at the scenario's origin. The frame of a vehicle has its
name and is forward, left, up.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from transport.panels import ROAD, Colour, colour_of
from vehicles.geometry.arc_spline import points_along
from vehicles.geometry.lanes import Points, lane_edges, simplified
from vehicles.messages import CompositeTrajectory, GpsPose, LogText, Message, RunStart, TruePose
from vehicles.schedule import MILLISECOND

FRAME_ID = "map"
"""Name of the world frame: east, north, up at the scenario's origin."""
HEIGHT_M = 1.5
DASHES_M = 5.0
"""Maximum distance between the poses of a path."""
PREVIEW_SPACING_M = 2.0
"""Distance between the poses of a composite trajectory."""
PREVIEW_PERIOD_NS = 200 * MILLISECOND
POSE_PERIOD_NS = 80 * MILLISECOND
"""True poses of every fourth control tick; our own topics contain all of them."""
ONCE_NS = 2**62
"""Period of messages logged once."""
EDGE: Colour = (0xA0, 0xA0, 0xA0)
_LEVELS = {**{name.lower(): level for name, level in Log.Level.items()}, "alert": Log.ERROR}


# ---- The scene of a run: cars, the lead's path and its lane


@dataclass(frozen=True, slots=True)
class Scene:
    """The constant scene of a run (m).

    cars  (length, width, distance of the centre ahead of the pose) by name, the lead first
    path  east and north of the lead's path
    lane  width of the lane around the path
    """

    cars: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    path: tuple[Sequence[float], Sequence[float]] | None = None
    lane: float | None = None

    def make_box(self, truth: TruePose) -> SceneUpdate:
        """The box of a vehicle with its name, in the vehicle's frame, which moves."""
        update = SceneUpdate()
        if truth.vehicle in self.cars:
            length, width, forward = self.cars[truth.vehicle]
            colour = colour_of(list(self.cars).index(truth.vehicle))
            entity = _entity(update, truth.true_at_ns, truth.vehicle, "car")
            entity.frame_locked = True
            box, name = entity.cubes.add(), entity.texts.add()
            box.pose.position.x, box.pose.position.z = forward, 0.5 * HEIGHT_M
            box.pose.orientation.w = name.pose.orientation.w = 1.0
            box.size.x, box.size.y, box.size.z = length, width, HEIGHT_M
            _paint(box.color, colour)
            name.pose.position.z = 2.0 * HEIGHT_M
            name.billboard, name.font_size, name.text = True, 1.5, truth.vehicle
            _paint(name.color, colour)
        return update

    def make_road(self, start: RunStart) -> SceneUpdate:
        """The lead's path and the edges of its lane."""
        update = SceneUpdate()
        if self.path is not None:
            entity = _entity(update, start.start_at_ns, FRAME_ID, "road")
            path = simplified(*self.path)
            _add_line(entity, path, ROAD)
            for edge in lane_edges(path, self.lane) if self.lane is not None else ():
                _add_line(entity, edge, EDGE)
        return update

    def make_path(self, start: RunStart) -> PosesInFrame:
        """The lead's path as poses, for viewers without scene entities."""
        points = simplified(*self.path, spacing=DASHES_M).tolist() if self.path else []
        dashes = (
            (east, north, math.atan2(next_north - north, next_east - east))
            for (east, north), (next_east, next_north) in pairwise(points)
        )
        return _poses(start.start_at_ns, dashes)


NO_SCENE = Scene()


def _entity(update: Any, at: int, frame: str, name: str) -> Any:
    entity = update.entities.add()
    entity.timestamp.FromNanoseconds(at)
    entity.frame_id, entity.id = frame, name
    return entity


def _add_line(entity: Any, points: Points, colour: Colour) -> None:
    line = entity.lines.add()
    line.type = LinePrimitive.LINE_STRIP
    line.pose.orientation.w = 1.0
    line.thickness, line.scale_invariant = 1.5, True
    _paint(line.color, colour)
    for east, north in points.tolist():
        line.points.add(x=east, y=north)


def _paint(color: Any, colour: Colour) -> None:
    color.r, color.g, color.b = (part / 255.0 for part in colour)
    color.a = 1.0


def _set_pose(position: Any, orientation: Any, east: float, north: float, yaw: float) -> None:
    position.x, position.y = east, north
    orientation.z, orientation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def _poses(at: int, points: Iterable[tuple[float, float, float]]) -> PosesInFrame:
    """Poses of points with rows of east, north (m) and yaw (rad)."""
    poses = PosesInFrame(frame_id=FRAME_ID)
    poses.timestamp.FromNanoseconds(at)
    for point in points:
        pose = poses.poses.add()
        _set_pose(pose.position, pose.orientation, *point)
    return poses


# ---- Standard messages


@dataclass(frozen=True, slots=True)
class StandardMessage:
    """A standard message of a Protobuf class, at most one per vehicle and `period_ns`.

    `make` makes it from one of ours.
    """

    name: str
    kind: Any
    make: Callable[[Any], Any]
    period_ns: int = 0


def _location(gps: GpsPose) -> LocationFix:
    heading = math.radians(gps.heading_deg)
    # Reported by the receiver; the altitude is assumed to be as accurate.
    variance = gps.position_accuracy_m * gps.position_accuracy_m  # ** raises OverflowError
    fix = LocationFix(
        frame_id=gps.vehicle,
        latitude=gps.latitude_deg,
        longitude=gps.longitude_deg,
        altitude=gps.altitude_m,
        position_covariance=[variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance],
        position_covariance_type=LocationFix.APPROXIMATED,
        heading=heading,
    )
    fix.timestamp.FromNanoseconds(gps.measured_at_ns)
    fix.velocity.x = gps.speed_mps * math.sin(heading)
    fix.velocity.y = gps.speed_mps * math.cos(heading)
    return fix


def _transform(truth: TruePose) -> FrameTransform:
    frame = FrameTransform(parent_frame_id=FRAME_ID, child_frame_id=truth.vehicle)
    frame.timestamp.FromNanoseconds(truth.true_at_ns)
    _set_pose(frame.translation, frame.rotation, truth.east_m, truth.north_m, truth.yaw_rad)
    return frame


def _preview(trajectory: CompositeTrajectory) -> PosesInFrame:
    return _poses(trajectory.decided_at_ns, points_along(trajectory, PREVIEW_SPACING_M))


def _text(line: LogText) -> Log:
    text = Log(level=_LEVELS.get(line.level, Log.UNKNOWN), message=line.text, name=line.vehicle)
    text.timestamp.FromNanoseconds(line.logged_at_ns)
    return text


def standard_messages(
    scene: Scene = NO_SCENE,
) -> Mapping[type[Message], tuple[StandardMessage, ...]]:
    """Standard messages by the class of ours."""
    return {
        GpsPose: (StandardMessage("location", LocationFix, _location),),
        TruePose: (
            StandardMessage("transform", FrameTransform, _transform, POSE_PERIOD_NS),
            StandardMessage("box", SceneUpdate, scene.make_box, ONCE_NS),
        ),
        CompositeTrajectory: (
            StandardMessage("preview", PosesInFrame, _preview, PREVIEW_PERIOD_NS),
        ),
        LogText: (StandardMessage("text", Log, _text),),
        RunStart: (
            StandardMessage("road", SceneUpdate, scene.make_road, ONCE_NS),
            StandardMessage("path", PosesInFrame, scene.make_path, ONCE_NS),
        ),
    }
