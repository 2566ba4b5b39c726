"""Foxglove scene entities of a run: cars, the lead's path and its lane.

A car is logged once, in its own frame, which moves.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from transport.colours import Colour, colour_of
from vehicles.geometry.lanes import Points, lane_edges, simplified
from vehicles.messages import RunStart, TruePose

FRAME_ID = "map"
"""Name of the world frame: east, north, up at the scenario's origin."""
HEIGHT_M = 1.5
DASHES_M = 5.0
"""Maximum distance between the poses of a path."""
ROAD: Colour = (0x6A, 0x6A, 0x6A)
EDGE: Colour = (0xA0, 0xA0, 0xA0)


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

    def box_maker(self) -> Callable[[TruePose], bytes]:
        """Function that makes the box of a vehicle, labelled with its name."""
        places = {name: place for place, name in enumerate(self.cars)}

        def make(truth: TruePose) -> bytes:
            update = SceneUpdate()
            if truth.vehicle in self.cars:
                length, width, forward = self.cars[truth.vehicle]
                entity = _entity(update, truth.true_at_ns, truth.vehicle, "car")
                entity.frame_locked = True
                box, name = entity.cubes.add(), entity.texts.add()
                box.pose.position.x, box.pose.position.z = forward, 0.5 * HEIGHT_M
                box.pose.orientation.w = name.pose.orientation.w = 1.0
                box.size.x, box.size.y, box.size.z = length, width, HEIGHT_M
                _paint(box.color, colour_of(places[truth.vehicle]))
                name.pose.position.z = 2.0 * HEIGHT_M
                name.billboard, name.font_size, name.text = True, 1.5, truth.vehicle
                _paint(name.color, colour_of(places[truth.vehicle]))
            data: bytes = update.SerializeToString()
            return data

        return make

    def make_road(self, start: RunStart) -> bytes:
        """The lead's path and the edges of its lane."""
        update = SceneUpdate()
        if self.path is not None:
            entity = _entity(update, start.start_at_ns, FRAME_ID, "road")
            path = simplified(*self.path)
            _add_line(entity, path, ROAD)
            if self.lane is not None:
                for edge in lane_edges(path, self.lane):
                    _add_line(entity, edge, EDGE)
        data: bytes = update.SerializeToString()
        return data

    def make_path(self, start: RunStart) -> bytes:
        """The lead's path as poses, for viewers without scene entities."""
        poses = PosesInFrame(frame_id=FRAME_ID)
        poses.timestamp.FromNanoseconds(start.start_at_ns)
        if self.path is not None:
            points = simplified(*self.path, spacing=DASHES_M).tolist()
            for (east, north), (next_east, next_north) in pairwise(points):
                half = 0.5 * math.atan2(next_north - north, next_east - east)
                pose = poses.poses.add()
                pose.position.x, pose.position.y = east, north
                pose.orientation.z, pose.orientation.w = math.sin(half), math.cos(half)
        data: bytes = poses.SerializeToString()
        return data


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
        point = line.points.add()
        point.x, point.y = east, north


def _paint(color: Any, colour: Colour) -> None:
    color.r, color.g, color.b = (part / 255.0 for part in colour)
    color.a = 1.0
