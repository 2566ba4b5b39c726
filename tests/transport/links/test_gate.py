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
from transport.links.link import HORIZON_NS, LONGEST_POSE_BYTES, PoseGate
from transport.topics import REASONS
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


def test_too_many_bytes_are_refused_unread() -> None:
    with pytest.raises(RefusedMessageError) as refused:
        GATE.admit(bytes(LONGEST_POSE_BYTES + 1), START)
    assert refused.value.reason == "oversized"


def with_history(
    latitudes: tuple[int, ...], longitudes: tuple[int, ...], ages: tuple[int, ...]
) -> GpsPose:
    return replace(
        gps("v1", 0),
        history_latitude_e7deg=latitudes,
        history_longitude_e7deg=longitudes,
        history_age_cs=ages,
    )


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
