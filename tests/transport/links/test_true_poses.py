"""True poses for a sensor: those at or before an instant, late ones counted."""

from dataclasses import replace

from tests.made.scenarios.messages import truth
from transport.codec import encode
from transport.links.true_poses import TruePoses
from vehicles.messages import TruePose
from vehicles.schedule import MILLISECOND


def pose(at_ms: int, vehicle: str = "v1") -> TruePose:
    return replace(truth(vehicle, at_ms, float(at_ms), 0.0), true_at_ns=at_ms * MILLISECOND)


def test_the_newest_pose_up_to_an_instant_is_used_in_any_order_of_arrival() -> None:
    poses = TruePoses("v1")
    assert poses.newest_at(0) is None
    for at_ms in (40, 20, 60):
        poses.on_bytes(poses.key, encode(pose(at_ms)))
    assert [poses.newest_at(at * MILLISECOND) for at in (30, 59, 200)] == [
        pose(20),
        pose(40),
        pose(60),
    ]
    assert poses.late == 0
