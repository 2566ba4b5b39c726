"""The gate: which poses vehicles and recorder accept, and the reasons of refusals."""

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.scenarios.messages import START, at, gps
from transport.codec import RefusedMessageError, encode
from transport.links.gate import HORIZON_NS, LONGEST_POSE_BYTES, PoseGate, TimestampRefusals
from transport.reasons import REASONS
from vehicles.geometry.geodesy import REACH, LocalPlane, Origin
from vehicles.messages import GpsPose

ORIGIN = Origin(30.638, -96.481, 80.0)
PLANE = LocalPlane(ORIGIN)
GATE = PoseGate(sender="v1", start_at=START, rate_hz=20.0, plane=PLANE)


def refusal(pose: GpsPose, now: int = START, gate: PoseGate = GATE) -> str:
    """Reason with which the gate refuses a pose, "" if it is admitted."""
    try:
        gate.check(pose, now)
    except RefusedMessageError as refused:
        return REASONS[refused.reason].word
    return ""


@pytest.mark.parametrize(
    ("field", "value"),
    [
        (field, value)
        for field, values in {
            "latitude_deg": (90.001, -91.0, math.nan, math.inf),
            "longitude_deg": (180.5, -181.0, math.nan, -math.inf),
            "altitude_m": (1e6, -1e6, math.nan, math.inf),
            "heading_deg": (-0.1, 361.0, math.nan, math.inf),
            "speed_mps": (-0.01, 151.0, math.nan, math.inf),
            "yaw_rate_radps": (11.0, -11.0, math.nan, math.inf),
            "acceleration_mps2": (1e308, -1e4, math.nan, -math.inf),
            "position_accuracy_m": (1e154, -0.1, math.nan, math.inf),
        }.items()
        for value in values
    ],
)
def test_numbers_that_no_vehicle_measures_are_absurd(field: str, value: float) -> None:
    with pytest.raises(
        RefusedMessageError, match=re.escape(f"absurd: {field} is {value}")
    ) as refused:
        GATE.check(replace(gps("v1", 0), **{field: value}), START)  # type: ignore[arg-type]
    assert refused.value.reason == "absurd"


@given(
    north=st.floats(-1.5 * REACH, 1.5 * REACH),
    east=st.floats(-1.5 * REACH, 1.5 * REACH),
    altitude=st.floats(-500.0, 9000.0),
)
@examples(33, 300)
def test_admitted_poses_are_within_the_plane(north: float, east: float, altitude: float) -> None:
    """The gate agrees with the exact transformation."""
    latitude = ORIGIN.latitude_deg + north / 111_000.0
    longitude = ORIGIN.longitude_deg + east / 95_800.0
    try:
        PLANE.to_plane(latitude, longitude, altitude)
        expected = ""
    except ValueError:
        expected = "far"
    pose = replace(
        gps("v1", 0), latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude
    )
    assert refusal(pose) == expected


@pytest.mark.parametrize(
    ("pose", "now", "word"),
    [
        (gps("v2", 0), START, "foreign"),
        (replace(gps("v1", 0), measured_at_ns=START - 1), START, "early"),
        (gps("v1", 0), START + HORIZON_NS, ""),
        (gps("v1", 0), START + HORIZON_NS + 1, "past"),
        (gps("v1", 1200), START, ""),
        (gps("v1", 1201), START, "future"),
        (replace(gps("v1", 41), measured_at_ns=at(2.0), sent_at_ns=at(2.0)), at(2.0), "sequence"),
        (replace(gps("v1", 39), measured_at_ns=at(2.0), sent_at_ns=at(2.0)), at(2.0), ""),
    ],
)
def test_sender_and_time_stamps_are_checked(pose: GpsPose, now: int, word: str) -> None:
    assert refusal(pose, now) == word


def test_a_recorder_accepts_poses_an_hour_old() -> None:
    patient = replace(GATE, oldest_ns=2**62)
    assert refusal(gps("v1", 0), at(3600.0), patient) == ""
    assert refusal(gps("v1", 0), at(3600.0)) == "past"


def test_too_many_bytes_are_refused_unread() -> None:
    with pytest.raises(RefusedMessageError) as refused:
        GATE.admit(bytes(LONGEST_POSE_BYTES + 1), START)
    assert refused.value.reason == "oversized"


def test_refused_time_stamps_are_reported_at_a_hundred_and_each_tenfold() -> None:
    counted = TimestampRefusals()
    warnings = [line for _ in range(12_000) if (line := counted.count("v1", "future"))]
    assert [line.split()[0] for line in warnings] == ["100", "1000", "10000"]
    assert "v1" in warnings[0]
    assert "future" in warnings[0]
    assert not any(counted.count("v2", "future") for _ in range(99))
    assert not any(counted.count("v1", "past") for _ in range(99))
    assert counted.count("v1", "past")
    assert counted.count("v2", "future")


def with_history(
    latitudes: tuple[int, ...], longitudes: tuple[int, ...], ages: tuple[int, ...]
) -> GpsPose:
    return replace(
        gps("v1", 0),
        history_latitude_e7deg=latitudes,
        history_longitude_e7deg=longitudes,
        history_age_cs=ages,
    )


def test_a_driven_history_is_admitted_with_its_positions() -> None:
    pose = with_history((-900,) * 3, (0, 90, -90), (50, 50, 3000))
    back = GATE.admit(encode(pose), START).path_history()
    here = PLANE.to_plane(pose.latitude_deg, pose.longitude_deg, pose.altitude_m)
    at = pose.measured_at_ns
    assert [at - place[0] for place in back] == [31_000_000_000, 1_000_000_000, 500_000_000]
    assert [place[2] - here[1] for place in back] == pytest.approx([-29.9, -19.95, -9.98], abs=0.1)
    assert [place[1] - here[0] for place in back] == pytest.approx([0.0, 0.86, 0.0], abs=0.02)


@pytest.mark.parametrize(
    "history",
    [
        ((0, 0), (0,), (50, 50)),
        ((-900,) * 41, (0,) * 41, (50,) * 41),
        ((-900,), (0,), (0,)),
        ((-900, -900), (0, 0), (60, -5)),
        ((-900,), (0,), (2**31 - 1,)),
        ((-20_000,) * 10, (0,) * 10, (500,) * 10),
        ((2**31 - 1,), (-(2**31),), (8_000_000,)),
        ((-5000,), (0,), (10,)),
    ],
    ids=["columns", "points", "no time", "backwards", "old", "long", "largest", "fast"],
)
def test_an_impossible_history_is_refused(history: tuple[tuple[int, ...], ...]) -> None:
    latitudes, longitudes, ages = history
    with pytest.raises(RefusedMessageError, match="histor"):
        GATE.admit(encode(with_history(latitudes, longitudes, ages)), START)


def test_a_history_beyond_the_plane_ends_at_its_edge() -> None:
    edge = PLANE.to_geodetic(0.0, REACH - 100.0)
    pose = replace(
        with_history((900,) * 20, (0,) * 20, (50,) * 20),
        latitude_deg=edge[0], longitude_deg=edge[1], altitude_m=edge[2],
    )  # fmt: skip
    assert 0 < len(GATE.check(pose, START).path_history()) < 20
