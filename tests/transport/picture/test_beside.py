import math
from dataclasses import replace

import pytest

from tests.made import drive
from transport.picture.beside import BesideLead
from vehicles.geometry.driven_path import DrivenPath, cross_track
from vehicles.messages import TruePose

LAPS = 2
TICKS = math.ceil(LAPS * 2 * math.pi * drive.RADIUS / drive.SPEED / (drive.TICK * 1e-9))


def offsets(vehicle: str) -> list[float]:
    beside = BesideLead()
    found = []
    for tick in range(TICKS):
        beside.lead_at(drive.truth("v1", tick))
        offset = beside.offset(drive.truth(vehicle, tick))
        if offset is not None:
            found.append(offset)
    return found


def test_a_car_further_in_on_a_left_circle_is_left_of_the_path() -> None:
    """Two laps: the first lap of the path lies under the second one and must not attract it."""
    for place, vehicle in enumerate(drive.VEHICLES[1:], start=1):
        after_the_start = offsets(vehicle)[150:]
        chord = drive.SPEED * drive.TICK * 1e-9  # the path is a polygon: its sagitta is c²/8R
        assert after_the_start == pytest.approx(
            [drive.offset_of(place)] * len(after_the_start), abs=chord**2 / (8 * drive.RADIUS)
        )


def test_it_agrees_with_the_figures_of_the_summary() -> None:
    lead = [drive.truth("v1", tick) for tick in range(TICKS)]
    follower = [drive.truth("v3", tick) for tick in range(TICKS)]
    summary = cross_track(follower, DrivenPath.of(lead, 1000.0))
    assert offsets("v3") == pytest.approx([found.lateral for found in summary], abs=1e-9)


@pytest.mark.parametrize("heading", range(0, 360, 45))
def test_left_of_a_straight_is_positive_in_all_headings(heading: int) -> None:
    yaw = math.radians(heading)
    c, s = math.cos(yaw), math.sin(yaw)

    def pose(vehicle: str, along: float, left: float) -> TruePose:
        east, north = along * c - left * s, along * s + left * c
        return replace(
            drive.truth("v1", 0), vehicle=vehicle, east_m=east, north_m=north, yaw_rad=yaw
        )

    beside = BesideLead()
    for along in range(30):
        beside.lead_at(pose("v1", along, 0.0))
    assert beside.offset(pose("v2", -12.0, 0.3)) == pytest.approx(0.3)
    assert beside.offset(pose("v2", 7.5, 0.3)) == pytest.approx(0.3)
    assert beside.offset(pose("v3", 7.5, -0.2)) == pytest.approx(-0.2)
    assert beside.offset(pose("v3", 40.0, -0.2)) is None


def test_without_a_lead_and_behind_a_standing_one() -> None:
    beside = BesideLead()
    assert beside.offset(drive.truth("v2", 0)) is None
    for _ in range(5):
        beside.lead_at(drive.truth("v1", 0))
    assert beside.offset(drive.truth("v2", 0)) is not None
    assert len(beside.points) == 2
