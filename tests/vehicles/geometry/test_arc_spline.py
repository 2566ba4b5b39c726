import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.arc_courses import course, point_at
from vehicles.geometry.arc_spline import ArcSpline, Piece

YAWS = st.floats(-math.pi, math.pi)
COORDINATES = st.floats(-5e6, 5e6)
CURVATURES = st.one_of(st.just(0.0), st.floats(-0.125, 0.125))


@given(east=COORDINATES, north=COORDINATES, yaw=YAWS, radius=st.floats(5.0, 5000.0))
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_piece_turns_about_its_centre(
    east: float, north: float, yaw: float, radius: float, side: float
) -> None:
    piece = Piece(east, north, yaw, side / radius, 10.0)
    centre_east = east - side * radius * math.sin(yaw)
    centre_north = north + side * radius * math.cos(yaw)
    for station in (-7.0, 0.5, 10.0):
        place = piece.at(station)
        away = math.hypot(place.east - centre_east, place.north - centre_north)
        assert away == pytest.approx(radius, abs=2e-8)
        turned = math.remainder(place.yaw - yaw, math.tau)
        assert turned == pytest.approx(math.remainder(side * station / radius, math.tau))


@given(
    yaw=YAWS,
    curvature=CURVATURES,
    station=st.floats(-20.0, 20.0),
    left=st.floats(-6.0, 6.0),
    east=st.floats(-1e3, 1e3),
)
def test_projection_inverts_the_offset_of_a_point(
    yaw: float, curvature: float, station: float, left: float, east: float
) -> None:
    path = course([(curvature, 10.0)], (east, -3.0, yaw))
    foot = path.project(*point_at(path, station, left))
    assert foot.station == pytest.approx(station, abs=1e-8)
    assert foot.lateral == pytest.approx(left, abs=1e-9)
    assert math.remainder(foot.yaw - path.at(station).yaw, math.tau) == pytest.approx(0, abs=1e-9)
    assert foot.curvature == curvature


@given(
    lengths=st.lists(st.floats(2.0, 30.0), min_size=2, max_size=4),
    curvature=st.floats(-0.05, 0.05),
    share=st.floats(-0.2, 1.2),
    left=st.floats(-3.0, 3.0),
    yaw=YAWS,
)
def test_several_pieces_project_like_one_path(
    lengths: list[float], curvature: float, share: float, left: float, yaw: float
) -> None:
    path = course([(curvature * (k % 2), length) for k, length in enumerate(lengths)], (1, 2, yaw))
    station = share * path.length
    foot = path.project(*point_at(path, station, left))
    assert foot.station == pytest.approx(station, abs=1e-6)
    assert foot.lateral == pytest.approx(left, abs=1e-8)


def integrated_in_steps(
    piece: Piece, station: float, steps: int = 20_000
) -> tuple[float, float, float]:
    """Second method: integration of the curvature in small steps."""
    step = station / steps
    along = step * (np.arange(steps) + 0.5)
    yaw = piece.yaw + piece.curvature * along + 0.5 * piece.rate * along * along
    east, north = step * np.cos(yaw).sum(), step * np.sin(yaw).sum()
    turned = piece.curvature * station + 0.5 * piece.rate * station**2
    return piece.east + float(east), piece.north + float(north), piece.yaw + turned


CLOTHOIDS = st.builds(
    Piece,
    st.floats(-1e3, 1e3),
    st.floats(-1e3, 1e3),
    YAWS,
    st.floats(-0.08, 0.08),
    st.just(20.0),
    st.floats(-0.004, 0.004),
)


@given(piece=CLOTHOIDS, station=st.floats(0.0, 20.0))
def test_a_clothoid_integrates_its_curvature(piece: Piece, station: float) -> None:
    east, north, yaw = integrated_in_steps(piece, station)
    place = piece.at(station)
    assert math.hypot(place.east - east, place.north - north) < 1e-5
    assert math.remainder(place.yaw - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert place.curvature == ArcSpline((piece,)).at(station).curvature


@given(
    piece=CLOTHOIDS.filter(lambda piece: abs(piece.curvature + 20.0 * piece.rate) < 0.1),
    station=st.floats(-10.0, 30.0),
    left=st.floats(-4.0, 4.0),
)
def test_projection_on_a_clothoid_inverts_the_offset_of_a_point(
    piece: Piece, station: float, left: float
) -> None:
    path = ArcSpline((piece,))
    foot = path.project(*point_at(path, station, left))
    assert foot.lateral == pytest.approx(left, abs=1e-6)
    assert foot.station == pytest.approx(station, abs=1e-3)
    assert foot.curvature == pytest.approx(path.at(station).curvature, abs=1e-5)


@given(
    st.lists(
        st.tuples(st.floats(-0.1, 0.1), st.floats(0.5, 30.0), st.sampled_from([0.0, 1e-3, -2e-3])),
        min_size=1, max_size=4,
    ),
    st.floats(-40.0, 60.0), st.floats(0.1, 5.0), st.integers(1, 40),
)  # fmt: skip
def test_curvatures_at_many_stations_equal_those_at_each(
    shapes: list[tuple[float, float, float]], start: float, step: float, count: int
) -> None:
    pieces = [Piece(0.0, 0.0, 0.0, curvature, length, rate) for curvature, length, rate in shapes]
    spline = ArcSpline(pieces)
    result = spline.curvatures(start, step, count)
    assert len(result) == count
    stations = [start + k * step for k in range(count)]
    ends = [sum(piece.length for piece in pieces[:n]) for n in range(1, len(pieces))]
    for station, curvature in zip(stations, result, strict=True):
        if all(abs(station - end) > 1e-6 for end in ends):  # at a joint either piece is correct
            assert curvature == pytest.approx(spline.at(station).curvature, abs=1e-9)


@given(
    before=CURVATURES,
    after=CURVATURES,
    rate=st.floats(-1e-3, 1e-3),
    length=st.floats(1.0, 60.0),
    most=st.floats(0.0, 0.2),
)
def test_beyond_a_fading_path_the_curvature_falls_to_zero(
    before: float, after: float, rate: float, length: float, most: float
) -> None:
    start = course([(before, 20.0)]).at(20.0)
    path = ArcSpline(
        (
            *course([(before, 20.0)]).pieces,
            Piece(start.east, start.north, start.yaw, after, 30.0, rate),
        )
    )
    faded, end = path.fading(length, most), path.at(path.length)
    first = min(max(after + 30.0 * rate, -most), most)
    for share in (0.25, 0.5, 0.75, 1.0, 3.0):
        expected = first * max(1.0 - share, 0.0)
        assert faded.at(50.0 + share * length).curvature == pytest.approx(expected, abs=1e-12)
    joined = faded.at(50.0 + 1e-9)
    assert math.hypot(joined.east - end.east, joined.north - end.north) < 1e-6
    turned = faded.at(50.0 + 2.0 * length).yaw - end.yaw
    assert math.remainder(turned - 0.5 * first * length, math.tau) == pytest.approx(0.0, abs=1e-9)
