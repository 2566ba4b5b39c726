"""The standard messages of a log, read by its own schemas."""

import math
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from rerun.chunk import McapReader

from tests.made.transport import drive
from tests.made.transport.logs import write
from transport.log.foxglove import Scene
from transport.panels import colour_of


def test_another_reader_decodes_all_standard_messages(tmp_path: Path) -> None:
    """Read the file with its own schemas only, without modules of this project."""
    write(tmp_path / "run.mcap")
    found: dict[str, Any] = {}
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for row in reader.iter_decoded_messages():
            found.setdefault(row.channel.topic, row.decoded_message)
    fix = found["/convoy/v1/location"]
    assert (fix.frame_id, fix.latitude, fix.longitude, fix.altitude) == ("v1", 48.0, 11.0, 500.0)
    assert fix.heading == pytest.approx(1.5 * math.pi)  # westwards, clockwise from north
    assert (fix.velocity.x, fix.velocity.y) == pytest.approx((-drive.SPEED, 0.0), abs=1e-12)
    # East, north, up, as reported by the receiver.
    variances = [0.0004, 0, 0, 0, 0.0004, 0, 0, 0, 0.0004]
    assert list(fix.position_covariance) == pytest.approx(variances)
    assert fix.position_covariance_type == LocationFix.APPROXIMATED
    assert fix.timestamp.ToNanoseconds() == drive.START
    transform = found["/convoy/v1/transform"]
    assert (transform.parent_frame_id, transform.child_frame_id) == ("map", "v1")
    place, turn = transform.translation, transform.rotation
    assert (place.x, place.y) == pytest.approx((drive.RADIUS, 0.0))
    half = math.pi / 4  # northwards: a quarter turn around the vertical axis
    assert (turn.z, turn.w) == pytest.approx((math.sin(half), math.cos(half)))
    text = found["/convoy/run/text"]
    assert (text.message, text.level, text.name) == ("off", 3, "run")


def test_rerun_draws_the_locations_on_a_map(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap")
    drawn = {
        chunk.entity_path
        for chunk in McapReader(str(tmp_path / "run.mcap")).stream()
        if any("GeoPoints" in name for name in chunk.to_record_batch().schema.names)
    }
    assert drawn == {f"/convoy/{name}/location" for name in drive.VEHICLES}


SCENE = Scene({"v1": (4.9, 1.9, -0.2), "v2": (6.0, 2.0, 0.0)}, ([0.0, 50.0], [0.0, 0.0]), 3.5)


def updates(path: Path, topic: str) -> list[SceneUpdate]:
    with path.open("rb") as file:
        records = make_reader(file).iter_messages(topics=[topic])
        return [SceneUpdate.FromString(record.data) for _, _, record in records]


def test_a_car_is_a_box_that_moves_with_its_frame(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap", scene=SCENE)
    (update,) = updates(tmp_path / "run.mcap", "/convoy/v2/box")
    (entity,) = update.entities
    assert (entity.frame_id, entity.frame_locked, entity.id) == ("v2", True, "car")
    (box,), (name,) = entity.cubes, entity.texts
    assert (box.size.x, box.size.y) == (6.0, 2.0)
    assert box.pose.position.z == box.size.z / 2.0  # it stands on the ground
    assert [round(255 * part) for part in (box.color.r, box.color.g, box.color.b)] == [
        *colour_of(1)
    ]
    assert name.text == "v2"
    (ahead,) = updates(tmp_path / "run.mcap", "/convoy/v1/box")
    assert ahead.entities[0].cubes[0].pose.position.x == -0.2


def test_the_road_is_the_lead_s_path_between_the_edges_of_its_lane(tmp_path: Path) -> None:
    write(tmp_path / "run.mcap", scene=SCENE)
    (update,) = updates(tmp_path / "run.mcap", "/convoy/run/road")
    lines = [[(p.x, p.y) for p in line.points] for line in update.entities[0].lines]
    assert update.entities[0].frame_id == "map"
    assert [line[0] for line in lines] == [(0.0, 0.0), (0.0, 1.75), (0.0, -1.75)]
    assert [line[-1] for line in lines] == [(50.0, 0.0), (50.0, 1.75), (50.0, -1.75)]


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
