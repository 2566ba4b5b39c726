"""Roads on which errors of a long convoy add up, as segments; cars are laden with passengers."""

import math

from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text


def _straight(length: float) -> str:
    return f"{{length_m={length}}}"


def _arc(degrees: float, radius: float) -> str:
    """An arc by `degrees`, positive to the left."""
    turn = "left" if degrees > 0.0 else "right"
    return f"{{length_m={math.radians(abs(degrees)) * radius}, radius_m={radius}, turn='{turn}'}}"


BLOCK = [
    _straight(60.0),
    *([_arc(90.0, 10.0), _straight(70.0)] * 4),
    *([_arc(-90.0, 10.0), _straight(60.0)] * 2),
]
ROUNDABOUT = [
    *(_straight(80.0), _arc(-50.0, 15.0), _arc(280.0, 18.0), _arc(-50.0, 15.0), _straight(120.0)),
    *(_arc(-50.0, 15.0), _arc(190.0, 18.0), _arc(-50.0, 15.0), _straight(60.0)),
]
SLALOM = [
    *(_straight(60.0), _arc(11.5, 60.0)),
    *([_arc(-23.0, 60.0), _arc(23.0, 60.0)] * 6),
    *(_arc(-11.5, 60.0), _straight(60.0)),
]
TRACK = [
    *(_straight(300.0), _arc(-180.0, 60.0), _straight(120.0), _arc(60.0, 25.0), _straight(40.0)),
    *(_arc(-60.0, 25.0), _straight(150.0), _arc(-90.0, 120.0), _straight(200.0)),
    *(_arc(-170.0, 15.0), _straight(80.0), _arc(80.0, 40.0), _arc(-80.0, 40.0), _straight(100.0)),
    *(_arc(-60.0, 200.0), _straight(150.0), _arc(-90.0, 30.0), _straight(60.0)),
    *(_arc(45.0, 80.0), _arc(-45.0, 80.0), _straight(300.0)),
]
"""A race track of 2.6 km: radii from 15 to 200 m."""
BRISK = """
lateral_acceleration_mps2_max = 4.0
braking_mps2_max = 4.0
acceleration_mps2_max = 3.0
[speed.gap]
acceleration_mps2_max = 4.0
braking_mps2_max = 8.0
"""
SEGMENTS = {
    "block": (BLOCK, 14.0, ""),
    "roundabout": (ROUNDABOUT, 14.0, ""),
    "slalom": (SLALOM, 13.0, ""),
    "track": (TRACK, 40.0, BRISK),
}
"""Segments, set speed (m/s) and further keys of the table [speed]."""
ROADS = ("slalom", "lane_change", "block", "roundabout", "track")


def convoy_on_road(name: str, seed: int, vehicles: int, *overrides: str) -> Scenario:
    if name == "lane_change":
        return load_scenario(name, [f"convoy.vehicles={vehicles}", *overrides], seed)
    segments, speed, keys = SEGMENTS[name]
    text = f"""name = "{name}"
[convoy]
vehicles = {vehicles}
[loading]
front_passengers = 1
rear_passengers = 3
[path]
kind = "segments"
segments = [{", ".join(segments)}]
[speed]
set_mps = {speed}
followers = "gap"
{keys}"""
    return scenario_from_text(text, label=f"{name}.toml", overrides=overrides, seed=seed)
