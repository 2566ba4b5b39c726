"""Poses with path histories, sent along a path and received without a link."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from vehicles.car.gnss import Fix, to_message
from vehicles.car.path_history import PathHistory
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.geometry.sampled_path import SampledPath
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose, receive
from vehicles.schedule import SECOND, instant

PLANE = LocalPlane(Origin(30.638, -96.481, 80.0))
START = 1_790_000_000 * SECOND
RATE_HZ = 20.0


def fixes(
    path: SampledPath, stations: Iterable[float], noise: float = 0.0, seed: int = 1
) -> Iterator[Fix]:
    """Fixes at 20 Hz of a car at these stations (m), with white noise (m) per axis."""
    random, before = np.random.default_rng(seed), 0.0
    for seq, station in enumerate(stations):
        point = path.at(station)
        east, north = noise * random.standard_normal(2)
        speed, before = (station - before) * RATE_HZ if seq else 0.0, station
        at = instant(START, seq, RATE_HZ)
        yield Fix(seq, at, point.east + east, point.north + north, point.yaw, max(speed, 0.0), 0.0)


def message(fix: Fix, history: PathHistory, plane: LocalPlane = PLANE) -> GpsPose:
    at = fix.measured_at
    position = (fix.east, fix.north, 0.0)
    return to_message(
        fix, "v1", plane, seq=fix.seq, sent_at=at, true_position=position, history=history.deltas()
    )


def sent(
    driven: Iterable[Fix], *, length: float = 300.0, points: int = 23, plane: LocalPlane = PLANE
) -> Iterator[ReceivedPose]:
    history = PathHistory(plane, length, points)
    for fix in driven:
        history.record(fix, on_path=True)
        yield receive(message(fix, history, plane), plane, fix.measured_at)


def without_history(pose: ReceivedPose) -> ReceivedPose:
    bare = replace(
        pose.message, history_latitude_e7deg=(), history_longitude_e7deg=(), history_age_cs=()
    )
    return replace(pose, message=bare)
