"""Collisions, near misses, lane departures and lost paths, from messages in any order."""

import math
from dataclasses import replace
from math import nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.definition.schema.scenario_tables import EventsTable
from scenarios.results.encounters import PARTED_M, QUIET_NS, BodySize, body_of, separation
from scenarios.results.run_event import EventLog, RunEvent
from scenarios.results.stream import ALL_EVENTS, OF_TRAFFIC, FigureStream
from tests.made.examples import examples
from tests.made.scenarios.messages import start, tracking, truth
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import SECOND

SIZE = BodySize(5.0, 2.0, 0.0)
CONVOY = ("v1", "v2", "v3")


def detected(
    *messages: Message, names: tuple[str, ...] = CONVOY, **table: float
) -> tuple[RunEvent, ...]:
    stream = FigureStream(dict.fromkeys(names, SIZE), EventsTable(**table), 0.0)
    log = EventLog(stream.seconds)
    stream.on_event(log.add, [kind for kind in ALL_EVENTS if kind not in OF_TRAFFIC])
    stream.listen(0, start())
    for message in messages:
        stream.listen(0, message)
    stream.finish()
    results = log.take_new()
    assert sorted(one.line for one in results) == sorted(one.line for one in log.events())
    return log.events()


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
    out = 2.5 * math.sin(yaw) + 1.0 * math.cos(yaw) - 1.75
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


@given(random=st.randoms(use_true_random=False))
@settings(max_examples=30, deadline=None)
def test_only_the_order_within_a_vehicle_matters(random: Any) -> None:
    places = [
        pose(name, seq, 0.6 * seq - 6.0 * place + path * math.sin(0.05 * seq), speed=30.0)
        for place, (name, path) in enumerate(zip(CONVOY, (0.0, 0.8, 4.0), strict=True))
        for seq in range(150)
    ]
    streams: list[list[Message]] = [
        *(list[Message](one for one in places if one.vehicle == name) for name in CONVOY),
        [*modes(("composite", 1), ("coast", 2))],
    ]
    expected = detected(*(message for stream in streams for message in stream))
    assert {one.kind for one in expected} >= {"collision", "near_miss", "path_lost"}
    mixed = []
    while any(streams):
        mixed.append(random.choice([stream for stream in streams if stream]).pop(0))
    assert detected(*mixed) == expected


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
            distance = separation(body_of(here, SIZE), body_of(there, SIZE)).distance
            if distance == 0.0 and not touching:
                expected.append((here.seq / 50, (CONVOY[one], CONVOY[other])))
            touching = distance == 0.0 or (touching and distance <= PARTED_M)
    found = detected(*(one for stream in poses for one in stream))
    collisions = [(one.at_s, one.vehicles) for one in found if one.kind == "collision"]
    assert collisions == sorted(expected)


@given(st.lists(st.tuples(st.floats(5.5, 12.0), st.floats(-1.0, 1.0)), min_size=1, max_size=30))
def test_the_smallest_gap_is_that_of_all_instants_and_the_last_is_the_last(
    places: list[tuple[float, float]],
) -> None:
    sizes = {"v1": SIZE, "v2": SIZE}
    stream = FigureStream(sizes)
    latest: list[float] = []
    stream.on_gap(lambda gap: latest.append(gap.now_m))
    apart = []
    for seq, (behind, yaw) in enumerate(places):
        ahead, follower = truth("v1", seq, 0.0, 0.0), truth("v2", seq, -behind, 0.0, yaw=yaw)
        stream.listen(0, ahead)
        stream.listen(0, follower)
        apart.append(separation(body_of(ahead, SIZE), body_of(follower, SIZE)))
        assert latest[-1] == apart[-1].distance
    least = min(range(len(apart)), key=lambda seq: apart[seq].distance)
    assert len(latest) == len(places)
    gap = stream.gaps["v2"]
    assert gap.min_m == apart[least].distance
    assert gap.min_at_ns == truth("v2", least, 0.0, 0.0).true_at_ns
