import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from tests.made.vehicles.arc_courses import course, point_at
from tests.made.vehicles.laps import TICK, Place, bulb, eight, lap
from vehicles.preview.trace import Trace


def send(trace: Trace, k: int, place: tuple[float, float, float], speed: float = 10.0) -> None:
    trace.add(received((k + 1) * TICK, *place, speed))


def straight(station: float) -> tuple[float, float, float]:
    return station, 0.0, 0.0


def driven(samples: int = 100, step: float = 0.5) -> Trace:
    """A source that drove east from the origin, `step` metres per fix."""
    trace = Trace()
    for k in range(samples):
        send(trace, k, straight(step * k))
    return trace


def test_a_window_holds_the_samples_around_the_ego_in_order_of_travel() -> None:
    seen = driven().window(20.0, 0.3, 4.0, 10.0)
    assert seen.station.tolist() == pytest.approx(np.arange(-4.0, 10.5, 0.5).tolist())
    assert seen.east.tolist() == pytest.approx((seen.station + 20.0).tolist())
    assert not seen.north.any()


def test_a_window_of_rare_samples_reaches_further() -> None:
    def rare() -> Trace:
        trace = Trace()
        for k in range(10):
            send(trace, 50 * k, straight(15.0 * k), 30.0)
        return trace

    seen = rare().window(62.0, 0.0, 10.0, 24.0)
    assert seen.station.tolist() == pytest.approx([-17.0, -2.0, 13.0, 28.0])
    last = rare().window(130.0, 0.0, 10.0, 24.0)  # one is left ahead
    assert last.station.tolist() == pytest.approx([-40.0, -25.0, -10.0, 5.0])
    dense = driven(step=1.0).window(50.0, 0.0, 4.0, 6.0)
    assert (dense.station[0], dense.station[-1]) == pytest.approx((-4.0, 6.0))


def test_the_spacing_is_the_arc_length_to_the_newest_pose() -> None:
    path = course([(0.0, 20.0), (1 / 15, 30.0)])
    trace = Trace()
    for k in range(101):
        place = path.at(0.5 * k)
        send(trace, k, (place.east, place.north, place.yaw))
    for station in (3.0, 10.0, 18.0, 25.0, 31.0, 40.0):
        assert trace.spacing(*point_at(path, station, 0.5)) == pytest.approx(
            50.0 - station, abs=0.01
        )
    assert trace.newest is not None
    assert trace.newest.measured_at == 101 * TICK


@given(order=st.permutations(range(40)))
def test_late_messages_are_inserted_in_order(order: list[int]) -> None:
    path = course([(0.02, 50.0)], (100.0, -50.0, 2.0))
    places = [path.at(0.5 * k) for k in range(40)]
    shuffled, ordered = Trace(), Trace()
    # Every message is at most a few positions late, the first one is on time.
    late = sorted(range(1, 40), key=lambda k: k + order[k] % 6)
    for trace, ranks in ((shuffled, [0, *late]), (ordered, list(range(40)))):
        for k in ranks:
            send(trace, k, (places[k].east, places[k].north, places[k].yaw))
    ego = point_at(path, 5.0)
    for one, other in zip(
        shuffled.window(*ego, 3.0, 20.0), ordered.window(*ego, 3.0, 20.0), strict=True
    ):
        assert one.tolist() == pytest.approx(other.tolist())
    assert shuffled.newest == ordered.newest


def test_a_source_that_turned_while_silent_is_followed() -> None:
    trace = driven(40)
    for k in range(400, 440):
        send(trace, k, (19.5 - 0.5 * (k - 400), 25.0, math.pi))
    seen = trace.window(19.0, 0.0, 5.0, 38.0)
    assert seen.north.tolist() == [0.0] * 12 + [25.0] * (len(seen.north) - 12)
    assert seen.station[-1] == pytest.approx(38.0, abs=0.5)


def test_the_spacing_to_a_source_beside_its_path_is_the_distance_driven() -> None:
    """A source whose samples are not followed drives half a circle of 20 m radius, and stands."""
    trace = driven()
    end = 49.5
    for k in range(1, 141):
        angle = min(k, 126) * 0.5 / 20.0
        place = end + 20.0 * math.sin(angle), 20.0 - 20.0 * math.cos(angle), angle
        trace.record_position(received((200 + k) * TICK, *place, 10.0))
    assert trace.spacing(0.0, 0.0) == pytest.approx(end + 63.0, abs=0.2)


def test_a_bridge_joins_the_ego_to_the_first_sample() -> None:
    trace = Trace()
    send(trace, 0, (30.0, 10.0, 0.3))
    trace.bridge(0.0, 0.0, 0.0)
    send(trace, 1, (31.0, 10.3, 0.3))
    trace.bridge(1.0, 0.5, 0.0)  # ignored: the bridge exists
    seen = trace.window(0.0, 0.0, 5.0, 40.0)
    assert np.diff(seen.station)[:-1].max() <= 1.0
    assert np.allclose(seen.north[:-1], seen.east[:-1] / 3.0)
    assert seen.east[-2:].tolist() == [30.0, 31.0]
    assert seen.station[-2] == pytest.approx(math.hypot(30.0, 10.0), abs=1e-3)


# Position function, length, lateral offset of the ego (in the bulb nearer to the other lane).
COURSES: dict[str, tuple[Place, float, float]] = {
    "bulb turn": (lap(bulb()), bulb().length - 1.0, -2.2),
    "figure of eight": (eight, 4.0 * math.pi * 15.0 * 2.5, 0.0),
    "three laps": (lap(course([(1 / 20, 40 * math.pi)])), 3.0 * 40.0 * math.pi, 0.0),
    "crossing": (
        lap(course([(0.0, 60.0), (1 / 12, 18.0 * math.pi), (0.0, 60.0)])),
        119.0 + 18.0 * math.pi,
        0.0,
    ),
}


@pytest.mark.spread(4)
@pytest.mark.parametrize("name", COURSES)
@pytest.mark.parametrize("spacing", [6.0, 25.0])
def test_samples_of_the_wrong_leg_are_never_used(name: str, spacing: float) -> None:
    place, length, left = COURSES[name]
    random, trace, drift = np.random.default_rng(1), Trace(), 0.0
    speed = 6.0
    for k in range(int((length + spacing) / (speed * 0.05))):
        station = speed * 0.05 * k
        noise = 0.02 * random.standard_normal(2)
        if station <= length and k % 40 > 5:  # silent for 0.3 s in every 2 s
            east, north, yaw = place(station)
            send(trace, k, (east + noise[0], north + noise[1], yaw), speed)
        own = station - spacing
        if own < 1.0:
            continue
        drift = 0.9 * drift + 0.1 * random.standard_normal()  # the ego tracks poorly
        east, north, yaw = place(own)
        off = left + drift
        ego = east - off * math.sin(yaw), north + off * math.cos(yaw)
        seen = trace.window(*ego, 5.0, 12.0)
        assert len(seen.station) > 10
        for sample in zip(seen.east, seen.north, seen.station, strict=True):
            there = place(max(0.0, own + sample[2]))
            assert math.hypot(sample[0] - there[0], sample[1] - there[1]) < 1.0
