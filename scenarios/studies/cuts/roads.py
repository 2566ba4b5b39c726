"""Roads of the campaign, as tables of a scenario; SI units with the suffixes of its keys."""

from collections.abc import Callable, Mapping
from math import pi
from typing import Any, Literal, get_args

Table = Mapping[str, Any]
Road = Literal["lane_change", "highway", "church_lot", "block", "slalom", "roundabout"]
ROADS: tuple[Road, ...] = get_args(Road)

LATERAL_ACCELERATION = 1.8
"""Lateral acceleration of the lane changes (m/s²), as in the paper: 500 m at 30 m/s."""
CORNER_M, CIRCLE_M, EXIT_M, SLALOM_M = 9.0, 14.0, 20.0, 50.0
"""Radii of a street corner, a roundabout and its exits, and a slalom."""


def straight(length_m: float) -> Table:
    return {"length_m": length_m}


def bend(turn: str, radius_m: float, angle_deg: float) -> Table:
    return {"length_m": radius_m * angle_deg * pi / 180.0, "radius_m": radius_m, "turn": turn}


def lane_change(speed_mps: float) -> Table:
    """The double lane change of the paper, with segments of one second at any speed."""
    second, radius = speed_mps, speed_mps**2 / LATERAL_ACCELERATION
    right = {"length_m": second, "radius_m": radius, "turn": "right"}
    left = right | {"turn": "left"}
    before, within, between, after = (straight(count * second) for count in (5, 1, 4, 80))
    segments = [before, right, within, left, between, left, within, right, after]
    return {
        "extends": "lane_change",
        "speed": {"set_mps": speed_mps},
        "control": {"controller": "slip_compensated"},
        "path": _segments(segments),
    }


def highway(_speed_mps: float) -> Table:
    return {"extends": "highway"}


def church_lot(_speed_mps: float) -> Table:
    """The car park, driven fast from the start."""
    return {"extends": "church_lot", "speed": {"profile": _from_walking_pace(6.0)}}


def block(_speed_mps: float) -> Table:
    """Streets between blocks, around one of them."""
    pieces = [straight(40.0)]
    for turn in ("right", "left", "left", "left", "left", "right", "right", "left"):
        pieces += [bend(turn, CORNER_M, 90.0), straight(35.0)]
    return _town([*pieces, straight(200.0)], 9.0)


def roundabout(_speed_mps: float) -> Table:
    """Two roundabouts: one left after three quarters, one passed straight."""
    entry = bend("right", EXIT_M, 45.0)
    pieces = [straight(50.0), entry, bend("left", CIRCLE_M, 180.0), entry, straight(40.0)]
    pieces += [entry, bend("left", CIRCLE_M, 270.0), entry]
    return _town([*pieces, straight(300.0)], 10.0)


def slalom(_speed_mps: float) -> Table:
    """Bends to alternate sides at 12 m/s, up to 2.9 m/s²."""
    turns = [bend(turn, SLALOM_M, 40.0) for turn in ("left", "right") * 6]
    return {
        "extends": "lane_change",
        "speed": {"set_mps": 12.0, "followers": "gap"},
        "control": {"controller": "slip_compensated"},
        "path": _segments([straight(40.0), bend("right", SLALOM_M, 20.0), *turns, straight(400.0)]),
    }


def _town(segments: list[Table], speed_mps: float) -> Table:
    """A road with bends as tight as those of the car park, driven by its cars."""
    return {
        "extends": "church_lot",
        "speed": {"profile": _from_walking_pace(speed_mps)},
        "path": _segments(segments),
    }


def _segments(segments: list[Table]) -> Table:
    return {"kind": "segments", "segments": segments}


def _from_walking_pace(speed_mps: float) -> list[Table]:
    return [{"at_s": 0.0, "speed_mps": 1.4}, {"at_s": 3.0, "speed_mps": speed_mps}]


TABLES: Mapping[Road, Callable[[float], Table]] = {
    "lane_change": lane_change,
    "highway": highway,
    "church_lot": church_lot,
    "block": block,
    "slalom": slalom,
    "roundabout": roundabout,
}
"""Tables of each road at a set speed (m/s), which only the lane change uses."""
