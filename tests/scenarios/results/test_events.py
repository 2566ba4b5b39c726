"""Collisions, near misses, lane departures and lost paths, from messages in any order."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import nan
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from scenarios.results.run_event import RunEvent, run_events
from scenarios.results.tables import QUIET_NS
from scenarios.results.traffic import FIGURE_OF
from scenarios.results.true_motion import (
    Bodies,
    BodySize,
    bodies,
    corners,
    overlap,
    separation,
)
from tests.made.examples import examples
from tests.made.scenarios.messages import tracking, truth
from tests.made.scenarios.polygons import common_area
from tests.made.scenarios.tables import CONVOY, body_size, run_of
from transport.columns import columns_from
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import SECOND

OF_TRAFFIC = {*FIGURE_OF, "stranded"}
QUIET = [5.0] * (QUIET_NS // (SECOND // 50) + 2)
Figures = dict[str, float]


def detected(*messages: Message, **table: float) -> tuple[RunEvent, ...]:
    """Events of v1, v2 and v3 but those of the traffic; `table` overrides [events]."""
    overrides = [f"events.{key}={value}" for key, value in table.items()]
    found = run_events(run_of(*messages, overrides=overrides))
    return tuple(event for event in found if event.kind not in OF_TRAFFIC)


def pose(vehicle: str, seq: int, east: float, north: float = 0.0, speed: float = 0.0) -> TruePose:
    return replace(truth(vehicle, seq, east, north), speed_mps=speed)


def approach(gaps: Sequence[float], speed: float = 0.0) -> list[TruePose]:
    """v1 stands; the body of v2 is so far behind it at one instant after the other."""
    return [
        one
        for seq, gap in enumerate(gaps)
        for one in (pose("v1", seq, 0.0), pose("v2", seq, -5.0 - gap, speed=speed))
    ]


def gripping(*shares: float) -> list[TruePose]:
    """Poses of v2 whose tyres use so much of the friction, one every 20 ms."""
    return [
        replace(truth("v2", seq, 0.5 * seq, 0.0), friction_ratio=share, rear_slip_rad=-share / 10)
        for seq, share in enumerate(shares)
    ]


def aside(lateral: Sequence[float], yaw: float = 0.0) -> list[TruePose]:
    """v1 drives east; v2 follows so far to the left of its path."""
    lead = [pose("v1", seq, 0.6 * seq, speed=30.0) for seq in range(len(lateral) + 40)]
    behind = [
        replace(pose("v2", seq, 0.6 * seq - 15.0, north, speed=30.0), yaw_rad=yaw)
        for seq, north in enumerate(lateral)
    ]
    return [*lead, *behind]


def decisions(*spans: tuple[float, dict[str, object]], vehicle: str = "v2") -> list[Tracking]:
    """Decisions of a vehicle with each state for a time (s)."""
    states = [state for seconds, state in spans for _ in range(round(seconds * 50))]
    return [tracking(vehicle, seq, **state) for seq, state in enumerate(states)]


def modes(*spans: tuple[str, float]) -> list[Tracking]:
    return decisions(*((seconds, {"mode": mode, "known_m": nan}) for mode, seconds in spans))


AWAY = (0.5, 0.7, 0.8, 1.3, 0.9, 0.7, 0.8, 0.0)  # with half a body of 1 m and half a lane of 1.75 m
LANE = {"excess_m_max": 0.55, "duration_s": 0.08}
STOP: dict[str, object] = {"mode": "stop", "known_m": 12.5, "blind_m": 3.25}
DOUBT: dict[str, object] = {"lead_status": "distrusted"}
BOTH = DOUBT | {"predecessor_status": "distrusted"}


@pytest.mark.parametrize(
    ("messages", "kind", "vehicles", "begins", "figures"),
    [
        (gripping(0.5, 0.98, 0.99, 1.0, 1.0, 0.6), "slide", ("v2",), [0.04],
         {"friction_ratio_max": 1.0, "slip_rad_max": 0.1, "duration_s": 0.04}),
        (approach([3.0, 2.0, -0.5, -1.0], 7.0), "collision", ("v1", "v2"), [0.04],
         {"closing_speed_mps": 7.0}),
        ([pose("v1", 0, 0.0), pose("v2", 0, -50.0), pose("v3", 0, -3.0)], "collision",
         ("v1", "v3"), [0.0], {"closing_speed_mps": 0.0}),
        (approach([3.0, 0.9, 0.6, 1.2, 0.8, *QUIET], 0.1), "near_miss", ("v1", "v2"), [0.02],
         {"gap_m_min": 0.6, "time_to_collision_s_min": 6.0}),
        (approach([0.9, *QUIET, 0.9]), "near_miss", ("v1", "v2"), [0.0, 1.06], {"gap_m_min": 0.9}),
        (approach([12.0, 11.0, 30.0], 10.0), "near_miss", ("v1", "v2"), [0.0],
         {"gap_m_min": 11.0, "time_to_collision_s_min": 1.1}),
        (aside(AWAY), "lane_departure", ("v2",), [0.04], LANE),
        (aside([-value for value in AWAY]), "lane_departure", ("v2",), [0.04], LANE),
        (aside([0.8, *([0.0] * 60), 0.8]), "lane_departure", ("v2",), [0.0, 1.22], {}),
        (decisions((0.04, {}), (1.02, STOP), (0.02, {}), (0.02, STOP)), "stop", ("v2",),
         [0.04, 1.08], {"known_m": 12.5, "predicted_blind_m": 3.25, "duration_s": 1.0}),
        (decisions((0.02, STOP | {"known_m": nan, "blind_m": nan})), "stop", ("v2",), [0.0],
         {"duration_s": 0.0}),
        (decisions((0.02, {}), (0.06, BOTH)), "distrust", ("v1", "v2"), [0.02],
         {"duration_s": 0.04}),  # lead and predecessor are one
        (decisions((0.06, {"other_sources": "v9 distrusted, v1"}), vehicle="v3"), "distrust",
         ("v9", "v3"), [0.0], {"duration_s": 0.04}),  # malformed
        *(
            (modes(("straight", 3), ("lead", 1), (lost, 2.5), ("lead", 1), (lost, 1.1)),
             "path_lost", ("v2",), [4.0, 7.5], {"duration_s": 2.48})
            for lost in ("coast", "straight", "stop")
        ),
    ],
)  # fmt: skip
def test_an_event_has_vehicles_begin_and_figures(
    messages: list[Message], kind: str, vehicles: tuple[str, ...], begins: list[float],
    figures: Figures,
) -> None:  # fmt: skip
    found = [event for event in detected(*messages) if event.kind == kind]
    assert [event.at_s for event in found] == pytest.approx(begins)
    assert {event.vehicles for event in found} == {vehicles}
    assert {name: found[0].figures[name] for name in figures} == pytest.approx(figures)
    assert all(name in found[0].line for name in vehicles)
    assert found[0].level == ("error" if kind == "collision" else "warning")


@pytest.mark.parametrize(
    "messages",
    [
        approach([16.0, 15.5], 10.0),
        modes(("straight", 9)),
        modes(("composite", 1), ("coast", 0.9), ("lead", 1), ("coast", 0.9)),
        decisions((0.04, DOUBT), vehicle="v1"),  # the lead follows nobody
        decisions((0.06, {"other_sources": "v9 lost v1"}), vehicle="v3"),
    ],
    ids=["far", "no path before", "short", "of the lead", "malformed"],
)
def test_what_is_no_event(messages: list[Message]) -> None:
    assert detected(*messages) == ()


def test_the_lane_is_that_of_the_scenario_and_the_heading_of_the_body_counts() -> None:
    assert detected(*aside(AWAY), lane_width_m=5.0) == ()
    yaw = 0.4  # at the centre nothing is wrong, but a corner sticks out
    (event,) = detected(*aside([0.0] * 20, yaw))
    front = 2.5 + abs(body_size().forward)  # or the rear, on the other side
    out = front * math.sin(yaw) + 1.0 * math.cos(yaw) - 1.75
    assert event.figures["excess_m_max"] == pytest.approx(out)


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_messages_does_not_matter(seed: int) -> None:
    places = [
        pose(name, seq, 0.6 * seq - 6.0 * place + path * math.sin(0.05 * seq), speed=30.0)
        for place, (name, path) in enumerate(zip(CONVOY, (0.0, 0.8, 4.0), strict=True))
        for seq in range(150)
    ]
    messages: list[Message] = [*places, *modes(("composite", 1), ("coast", 2))]
    expected = detected(*messages)
    assert {one.kind for one in expected} >= {"collision", "near_miss", "path_lost"}
    assert detected(*Random(seed).sample(messages, len(messages))) == expected


def test_rows_out_of_order_late_doubled_or_missing_invent_nothing() -> None:
    """The poses of one vehicle come up to 0.3 s out of order, some of them twice."""
    lead = [pose("v1", seq, 0.6 * seq, speed=30.0) for seq in range(400)]
    behind = [pose("v2", seq, 0.6 * seq - 15.0, 0.04, speed=30.0) for seq in range(400)]
    random = Random(5)
    mixed = sorted(behind, key=lambda one: one.seq + random.uniform(0.0, 15.0))
    mixed = [one for one in (*mixed, *mixed[100:120]) if one.seq % 17]
    assert detected(*lead, *mixed) == ()


# ---- Bodies against brute force: by sampling their edges, and by cutting one with another


def body_of(pose: TruePose, size: BodySize) -> Bodies:
    return bodies(columns_from("truth", [pose], [pose.true_at_ns], pose.vehicle), size)


def placed(
    east: float, north: float, yaw: float, length: float = 4.93, width: float = 1.86
) -> Bodies:
    return body_of(truth("v1", 0, east, north, yaw=yaw), BodySize(length, width, 0.0))


any_body = st.builds(
    placed,
    st.floats(-6, 6),
    st.floats(-6, 6),
    st.floats(-math.pi, math.pi),
    st.floats(0.5, 12),
    st.floats(0.3, 3),
)


def edge(body: Bodies, steps: int = 60) -> NDArray[np.float64]:
    ring = [np.ravel(corner) for corner in corners(body)]
    return np.concatenate([np.linspace(a, b, steps) for a, b in pairwise([*ring, ring[0]])])


@given(one=any_body, other=any_body)
@examples(16, 100)
def test_bodies_overlap_where_they_share_an_area_and_else_are_apart_by_their_nearest_points(
    one: Bodies, other: Bodies
) -> None:
    area, found = common_area(one, other), separation(one, other)
    assume(not 0.0 < area < 1e-9)
    assert overlap(one, other) == overlap(other, one) == (area > 0.0)
    assert found.distance == pytest.approx(separation(other, one).distance)
    if area > 0.0:
        assert found.distance == 0.0
        return
    apart = edge(one)[:, None, :] - edge(other)[None, :, :]
    nearest = float(np.hypot(apart[..., 0], apart[..., 1]).min())
    assert found.distance <= nearest + 1e-9
    assert found.distance == pytest.approx(nearest, abs=0.2)  # samples lie up to 0.2 m apart


@given(one=any_body, other=any_body, speeds=st.tuples(*[st.floats(-20, 20)] * 4))
@examples(16, 100)
def test_the_closing_speed_is_the_rate_of_the_distance(
    one: Bodies, other: Bodies, speeds: tuple[float, float, float, float]
) -> None:
    step = 1e-6
    one = one._replace(speed_east=np.array(speeds[:1]), speed_north=np.array(speeds[1:2]))
    other = other._replace(speed_east=np.array(speeds[2:3]), speed_north=np.array(speeds[3:]))

    def after(body: Bodies, span: float) -> Bodies:
        east, north = body.east + span * body.speed_east, body.north + span * body.speed_north
        return body._replace(east=east, north=north)

    before, now, then = (
        separation(after(one, span), after(other, span)) for span in (-step, 0.0, step)
    )
    assume(before.distance > 1e-3 and then.distance > 1e-3)
    ways = [(now.distance - before.distance) / step, (then.distance - now.distance) / step]
    assume(abs(ways[0] - ways[1]) < 1e-2)  # else another corner becomes the nearest
    assert now.closing == pytest.approx(-ways[1], abs=2e-2)


def test_the_body_reaches_as_far_beyond_either_axle() -> None:
    """The pose is that of the centre of mass, which lies ahead of the middle of this car."""
    place = truth("v1", 0, 100.0, 50.0, yaw=math.pi / 2)
    body = body_of(place, BodySize.of(LINCOLN_MKZ))
    norths = [float(north[0]) for _, north in corners(body)]
    front, rear = max(norths), min(norths)
    assert front - rear == pytest.approx(4.93)
    overhang = front - (50.0 + LINCOLN_MKZ.front_axle_distance)
    assert overhang == pytest.approx((50.0 - LINCOLN_MKZ.rear_axle_distance) - rear)
    assert overhang > 0.9
