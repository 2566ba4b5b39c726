"""Collisions, near misses, lane departures and lost paths, from messages in any order."""

import math
from dataclasses import replace
from itertools import pairwise
from math import nan
from random import Random

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from scenarios.results.events import PARTED_M
from scenarios.results.run_event import RunEvent, run_events
from scenarios.results.tables import QUIET_NS
from scenarios.results.traffic import FIGURE_OF
from scenarios.results.true_motion import (
    Bodies,
    BodySize,
    bodies,
    corners,
    gaps,
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


def detected(*messages: Message, **table: float) -> tuple[RunEvent, ...]:
    """Events of v1, v2 and v3 but those of the traffic; `table` overrides [events]."""
    overrides = [f"events.{key}={value}" for key, value in table.items()]
    found = run_events(run_of(*messages, overrides=overrides))
    return tuple(event for event in found if event.kind not in OF_TRAFFIC)


def body_of(pose: TruePose, size: BodySize) -> Bodies:
    return bodies(columns_from("truth", [pose], [pose.true_at_ns], pose.vehicle), size)


def of_kind(kind: str, events: tuple[RunEvent, ...]) -> tuple[RunEvent, ...]:
    return tuple(event for event in events if event.kind == kind)


def pose(vehicle: str, seq: int, east: float, north: float = 0.0, speed: float = 0.0) -> TruePose:
    return replace(truth(vehicle, seq, east, north), speed_mps=speed)


def approach(gaps: list[float], speed: float = 0.0) -> list[TruePose]:
    """v1 stands; the body of v2 is so far behind it at one instant after the other."""
    return [
        one
        for seq, gap in enumerate(gaps)
        for one in (pose("v1", seq, 0.0), pose("v2", seq, -5.0 - gap, speed=speed))
    ]


def gripping(vehicle: str, shares: list[float]) -> list[TruePose]:
    """Poses of a vehicle whose tyres use so much of the friction, one every 20 ms."""
    return [
        replace(
            truth(vehicle, seq, 0.5 * seq, 0.0), friction_ratio=share, rear_slip_rad=-share / 10
        )
        for seq, share in enumerate(shares)
    ]


def test_a_slide_names_vehicle_time_and_figures() -> None:
    (event,) = detected(*gripping("v2", [0.5, 0.98, 0.99, 1.0, 1.0, 0.6]))
    assert (event.kind, event.vehicles) == ("slide", ("v2",))
    assert event.at_s == pytest.approx(0.04)
    assert event.figures == {
        "friction_ratio_max": 1.0,
        "slip_rad_max": pytest.approx(0.1),
        "duration_s": pytest.approx(0.04),
    }
    assert event.level == "warning"
    assert event.line == "slide: v2 uses all available friction, 0.04 s after the start"


QUIET = [5.0] * (QUIET_NS // (SECOND // 50) + 2)


def test_a_collision_names_vehicles_time_and_speed() -> None:
    (event,) = detected(*approach([3.0, 2.0, -0.5, -1.0], speed=7.0), near_miss_time_s=0.0)
    assert (event.kind, event.vehicles) == ("collision", ("v1", "v2"))
    assert event.at_s == pytest.approx(0.04)
    assert event.figures == {"closing_speed_mps": pytest.approx(7.0)}
    assert event.line == "collision: v2 and v1, closing at 7.0 m/s, 0.04 s after the start"
    assert event.level == "error"


def test_any_two_vehicles_collide_not_only_neighbours() -> None:
    found = detected(pose("v1", 0, 0.0), pose("v2", 0, -50.0), pose("v3", 0, -3.0))
    assert [(one.kind, one.vehicles) for one in found] == [("collision", ("v1", "v3"))]


def test_a_near_miss_is_one_episode_with_its_smallest_figures() -> None:
    gaps = [3.0, 0.9, 0.6, 1.2, 0.8, *QUIET]
    (event,) = detected(*approach(gaps, speed=0.1))
    assert (event.kind, event.vehicles) == ("near_miss", ("v1", "v2"))
    assert event.at_s == pytest.approx(0.02)
    assert event.figures["gap_m_min"] == pytest.approx(0.6)
    assert event.figures["time_to_collision_s_min"] == pytest.approx(6.0)
    two = detected(*approach([0.9, *QUIET, 0.9]))
    assert [one.kind for one in two] == ["near_miss", "near_miss"]


def test_a_near_miss_can_be_short_of_time_instead_of_distance() -> None:
    (event,) = detected(*approach([12.0, 11.0, 30.0], speed=10.0))
    assert event.figures["time_to_collision_s_min"] == pytest.approx(1.1)
    assert detected(*approach([16.0, 15.5], speed=10.0)) == ()


def aside(lateral: list[float], yaw: float = 0.0) -> list[TruePose]:
    """v1 drives east; v2 follows so far to the left of its path."""
    lead = [pose("v1", seq, 0.6 * seq, speed=30.0) for seq in range(len(lateral) + 40)]
    behind = [
        replace(pose("v2", seq, 0.6 * seq - 15.0, north, speed=30.0), yaw_rad=yaw)
        for seq, north in enumerate(lateral)
    ]
    return [*lead, *behind]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_corner_across_the_edge_of_the_lane_is_a_departure_once(side: float) -> None:
    away = [0.5, 0.7, 0.8, 1.3, 0.9, 0.7, 0.8, 0.0]
    (event,) = detected(*aside([side * value for value in away]))
    assert (event.kind, event.vehicles) == ("lane_departure", ("v2",))
    assert event.at_s == pytest.approx(0.04)  # 0.8 + 1.0 m > 1.75 m
    assert event.figures["excess_m_max"] == pytest.approx(0.55)
    assert event.figures["duration_s"] == pytest.approx(0.08)
    assert event.level == "warning"
    assert len(detected(*aside([0.8, *([0.0] * 60), 0.4, 0.5, 0.6, 0.8]))) == 2
    assert detected(*aside(away), lane_width_m=5.0) == ()


def test_the_heading_of_the_body_counts_too() -> None:
    """At the centre nothing is wrong, but a corner sticks out."""
    yaw = 0.4
    (event,) = detected(*aside([0.0] * 20, yaw))
    front = 2.5 + abs(body_size().forward)  # or the rear, on the other side
    out = front * math.sin(yaw) + 1.0 * math.cos(yaw) - 1.75
    assert event.figures["excess_m_max"] == pytest.approx(out)


def modes(*spans: tuple[str, float]) -> list[Tracking]:
    names = [mode for mode, seconds in spans for _ in range(round(seconds * 50))]
    return [tracking("v2", seq, mode=mode, known_m=nan) for seq, mode in enumerate(names)]


@pytest.mark.parametrize("lost", ["coast", "straight", "stop"])
def test_a_path_is_lost_after_some_time_without_one(lost: str) -> None:
    found = detected(*modes(("straight", 3), ("composite", 1), (lost, 2.5), ("lead", 1)))
    (event,) = of_kind("path_lost", found)
    assert (event.kind, event.vehicles) == ("path_lost", ("v2",))
    assert event.at_s == pytest.approx(4.0)
    assert event.figures["duration_s"] == pytest.approx(2.48)
    assert detected(*modes(("straight", 9))) == ()
    short = detected(*modes(("composite", 1), (lost, 0.9), ("lead", 1), (lost, 0.9)))
    assert of_kind("path_lost", short) == ()
    twice = detected(*modes(("lead", 1), (lost, 1.1), ("lead", 1), (lost, 1.1)))
    assert len(of_kind("path_lost", twice)) == 2


def test_a_stop_is_an_event_with_known_path_and_predicted_blind_distance() -> None:
    braking = {"mode": "stop", "known_m": 12.5, "blind_m": 3.25}
    results = [{}, {}, braking, *[braking | {"known_m": 1.0, "blind_m": 9.0}] * 50, {}, braking]
    first, second = detected(*(tracking("v2", seq, **more) for seq, more in enumerate(results)))
    assert (first.kind, first.vehicles) == ("stop", ("v2",))
    assert first.at_s == pytest.approx(0.04)
    assert first.figures == pytest.approx(
        {"known_m": 12.5, "predicted_blind_m": 3.25, "duration_s": 1.0}
    )
    assert first.line.startswith(
        "stop: v2 brakes to a stop without a reliable source; 12.5 m of known path; "
    )
    assert "predicted blind distance 3.2 m" in first.line
    assert second.at_s == pytest.approx(54 / 50)
    outrun = {"mode": "stop", "known_m": -23.25, "blind_m": 40.0}
    (event,) = detected(tracking("v2", 0, **outrun))
    assert "ended 23.2 m behind the car; predicted blind distance 40.0 m" in event.line
    untold = {"mode": "stop", "known_m": nan, "blind_m": nan}
    (event,) = detected(tracking("v2", 0, **untold))
    assert (
        event.line == "stop: v2 brakes to a stop without a reliable source, 0.00 s after the start"
    )


def test_each_distrust_of_a_source_is_an_event() -> None:
    doubt, both = {"lead_status": "distrusted"}, {"predecessor_status": "distrusted"}
    results = [{}, doubt, doubt | both, both, {}, both]
    found = detected(*(tracking("v3", seq, **more) for seq, more in enumerate(results)))
    assert [(one.vehicles, round(50 * one.at_s)) for one in found] == [
        (("v1", "v3"), 1), (("v2", "v3"), 2), (("v2", "v3"), 5),
    ]  # fmt: skip
    assert found[0].line.startswith("distrust: v3 distrusts v1")
    first = detected(*(tracking("v2", seq, **(doubt | both)) for seq in range(3)))
    assert [one.vehicles for one in first] == [("v1", "v2")]  # lead and predecessor are one
    both_ways = detected(tracking("v2", 0, **doubt), tracking("v1", 0), tracking("v1", 1, **doubt))
    assert [one.vehicles for one in both_ways] == [("v1", "v2")]  # the lead follows nobody


@pytest.mark.parametrize("text", ["v9", "v9 distrusted, v1", "v9 lost v1"])
def test_a_malformed_list_of_sources_is_read_as_far_as_it_goes(text: str) -> None:
    """The bus is open to everybody, and the summary reads what is in the log."""
    found = detected(*(tracking("v3", seq, other_sources=text) for seq in range(3)))
    assert [event.kind for event in found] == ["distrust"] * ("distrusted" in text)


@pytest.mark.parametrize("seed", range(5))
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


@given(
    paths=st.lists(
        st.lists(
            st.tuples(st.floats(-12, 12), st.floats(-4, 4), st.floats(-3.2, 3.2)),
            min_size=8,
            max_size=8,
        ),
        min_size=3,
        max_size=3,
    )
)
@examples(16, 100)
def test_no_overlap_passes_unseen_and_none_is_invented(
    paths: list[list[tuple[float, float, float]]],
) -> None:
    """Against every pair looked at by itself at every instant."""
    poses = [
        [
            replace(pose(name, seq, east, north), yaw_rad=yaw)
            for seq, (east, north, yaw) in enumerate(path)
        ]
        for name, path in zip(CONVOY, paths, strict=True)
    ]
    expected: list[tuple[float, tuple[str, str]]] = []
    for one, other in ((0, 1), (0, 2), (1, 2)):
        touching = False
        for here, there in zip(poses[one], poses[other], strict=True):
            distance = distance_of(here, there)
            if distance == 0.0 and not touching:
                expected.append((here.seq / 50, (CONVOY[one], CONVOY[other])))
            touching = distance == 0.0 or (touching and distance <= PARTED_M)
    found = detected(*(one for stream in poses for one in stream))
    collisions = [(one.at_s, one.vehicles) for one in found if one.kind == "collision"]
    assert collisions == sorted(expected)


def distance_of(pose: TruePose, other: TruePose) -> float:
    (distance,) = separation(body_of(pose, body_size()), body_of(other, body_size())).distance
    return float(distance)


@given(st.lists(st.tuples(st.floats(5.5, 12.0), st.floats(-1.0, 1.0)), min_size=1, max_size=30))
@settings(deadline=None)
def test_a_gap_is_the_distance_of_the_bodies_at_each_instant(
    places: list[tuple[float, float]],
) -> None:
    pairs = [
        (truth("v1", seq, 0.0, 0.0), truth("v2", seq, -behind, 0.0, yaw=yaw))
        for seq, (behind, yaw) in enumerate(places)
    ]
    found = gaps(run_of(*(pose for pair in pairs for pose in pair)), "v2")
    assert found.distance.tolist() == pytest.approx([distance_of(*pair) for pair in pairs])
    assert found.at_ns.tolist() == [pose.true_at_ns for pose, _ in pairs]


def test_rows_out_of_order_late_doubled_or_missing_invent_nothing() -> None:
    """The poses of one vehicle come up to 0.3 s out of order, some of them twice."""
    lead = [pose("v1", seq, 0.6 * seq, speed=30.0) for seq in range(400)]
    behind = [pose("v2", seq, 0.6 * seq - 15.0, 0.04, speed=30.0) for seq in range(400)]
    random = Random(5)
    mixed = sorted(behind, key=lambda one: one.seq + random.uniform(0.0, 15.0))
    mixed = [one for one in (*mixed, *mixed[100:120]) if one.seq % 17]
    assert detected(*lead, *mixed) == ()


# ---- Bodies against brute force: by sampling their edges, and by cutting one with another


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
    ring = [*ring, ring[0]]
    return np.concatenate([np.linspace(a, b, steps) for a, b in pairwise(ring)])


@given(one=any_body, other=any_body)
@examples(44, 400)
def test_bodies_overlap_where_they_share_an_area(one: Bodies, other: Bodies) -> None:
    area = common_area(one, other)
    assume(not 0.0 < area < 1e-9)
    assert overlap(one, other) == overlap(other, one) == (area > 0.0)


@given(one=any_body, other=any_body)
@examples(16, 100)
def test_the_distance_is_that_of_the_nearest_points_of_their_edges(
    one: Bodies, other: Bodies
) -> None:
    found = separation(one, other)
    assert found.distance == pytest.approx(separation(other, one).distance)
    if overlap(one, other):
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
        return body._replace(
            east=body.east + span * body.speed_east,
            north=body.north + span * body.speed_north,
        )

    before, now, then = (
        separation(after(one, span), after(other, span)) for span in (-step, 0.0, step)
    )
    assume(before.distance > 1e-3 and then.distance > 1e-3)
    ways = [(now.distance - before.distance) / step, (then.distance - now.distance) / step]
    assume(abs(ways[0] - ways[1]) < 1e-2)  # else another corner becomes the nearest
    assert now.closing == pytest.approx(-ways[1], abs=2e-2)


def test_the_body_reaches_as_far_beyond_either_axle() -> None:
    """The pose is that of the centre of mass, which lies ahead of the middle of this car."""
    pose = truth("v1", 0, 100.0, 50.0, yaw=math.pi / 2)
    size = BodySize.of(LINCOLN_MKZ)
    norths = [float(north[0]) for _, north in corners(body_of(pose, size))]
    front, rear = max(norths), min(norths)
    assert front - rear == pytest.approx(4.93)
    overhang = front - (50.0 + LINCOLN_MKZ.front_axle_distance)
    assert overhang == pytest.approx((50.0 - LINCOLN_MKZ.rear_axle_distance) - rear)
    assert overhang > 0.9


def test_a_body_moves_as_its_centre_does() -> None:
    """Sideways and with the yaw rate at the distance from the centre of mass."""
    size = BodySize(5.0, 2.0, 2.0)
    pose = replace(truth("v1", 0, 0.0, 0.0, yaw=0.3), lateral_speed_mps=0.5, yaw_rate_radps=0.2)
    span = 1e-6
    moved = replace(
        pose,
        east_m=(20.0 * math.cos(0.3) - 0.5 * math.sin(0.3)) * span,
        north_m=(20.0 * math.sin(0.3) + 0.5 * math.cos(0.3)) * span,
        yaw_rad=0.3 + 0.2 * span,
    )
    now, then = body_of(pose, size), body_of(moved, size)
    assert (then.east - now.east) / span == pytest.approx(now.speed_east, abs=1e-4)
    assert (then.north - now.north) / span == pytest.approx(now.speed_north, abs=1e-4)
