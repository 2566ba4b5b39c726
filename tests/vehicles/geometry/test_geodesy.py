import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymap3d.enu import geodetic2enu

from vehicles.geometry.geodesy import (
    WGS84,
    LocalPlane,
    Origin,
    heading_from_yaw,
    yaw_from_heading,
)

ORIGIN = Origin(latitude_deg=48.137, longitude_deg=11.575, altitude_m=519.0)
PLANE = LocalPlane(ORIGIN)


def earth_centred(
    latitude_deg: float, longitude_deg: float, altitude_m: float
) -> tuple[float, float, float]:
    """Textbook WGS84 formula, independent of PROJ."""
    a, f = 6378137.0, 1.0 / 298.257223563
    phi, lam = math.radians(latitude_deg), math.radians(longitude_deg)
    e2 = f * (2.0 - f)
    n = a / math.sqrt(1.0 - e2 * math.sin(phi) ** 2)
    level = (n + altitude_m) * math.cos(phi)
    return (
        level * math.cos(lam),
        level * math.sin(lam),
        (n * (1.0 - e2) + altitude_m) * math.sin(phi),
    )


def test_plane_agrees_with_the_rotation_of_earth_centred_coordinates() -> None:
    phi, lam = math.radians(ORIGIN.latitude_deg), math.radians(ORIGIN.longitude_deg)
    x0, y0, z0 = earth_centred(ORIGIN.latitude_deg, ORIGIN.longitude_deg, ORIGIN.altitude_m)
    for point in [(48.14, 11.58, 519.0), (48.12, 11.5, 700.0), (48.137, 11.60, 519.0)]:
        dx, dy, dz = (p - q for p, q in zip(earth_centred(*point), (x0, y0, z0), strict=True))
        east = -math.sin(lam) * dx + math.cos(lam) * dy
        level = math.cos(lam) * dx + math.sin(lam) * dy
        north = -math.sin(phi) * level + math.cos(phi) * dz
        assert PLANE.to_plane(*point) == pytest.approx((east, north), abs=1e-7)


@given(east=st.floats(-20_000, 20_000), north=st.floats(-20_000, 20_000))
def test_a_round_trip_is_exact(east: float, north: float) -> None:
    back = PLANE.to_plane(*PLANE.to_geodetic(east, north))
    assert back == pytest.approx((east, north), abs=1e-7)


def test_origin_is_the_plane_s_zero_and_axes_point_east_and_north() -> None:
    assert PLANE.to_plane(48.137, 11.575, 519.0) == pytest.approx((0.0, 0.0), abs=1e-9)
    east, north = PLANE.to_plane(48.137, 11.576, 519.0)
    assert east > 70.0
    assert abs(north) < 0.01
    east, north = PLANE.to_plane(48.138, 11.575, 519.0)
    assert abs(east) < 1e-6
    assert north == pytest.approx(111.2, abs=0.2)


@pytest.mark.parametrize(
    ("heading_deg", "yaw"),
    [
        (0.0, math.pi / 2),
        (90.0, 0.0),
        (180.0, -math.pi / 2),
        (270.0, -math.pi),
        (360.0, math.pi / 2),
    ],
)
def test_courses_of_the_compass_rose(heading_deg: float, yaw: float) -> None:
    assert yaw_from_heading(heading_deg) == pytest.approx(yaw, abs=1e-12)
    assert heading_from_yaw(yaw) == pytest.approx(heading_deg % 360.0, abs=1e-9)


@given(st.floats(-100.0, 100.0))
def test_heading_is_within_a_turn_and_inverts_to_the_yaw(yaw: float) -> None:
    heading_deg = heading_from_yaw(yaw)
    assert 0.0 <= heading_deg < 360.0
    assert abs(math.remainder(yaw_from_heading(heading_deg) - yaw, math.tau)) < 1e-9


@given(east=st.floats(-20_000, 20_000), north=st.floats(-20_000, 20_000))
def test_geodetic_coordinates_are_those_of_proj(east: float, north: float) -> None:
    pyproj = pytest.importorskip("pyproj")
    proj = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lon_0={ORIGIN.longitude_deg} +lat_0={ORIGIN.latitude_deg} +h_0={ORIGIN.altitude_m}"
    )
    longitude, latitude, altitude = proj.transform(east, north, 0.0, direction="INVERSE")
    result = PLANE.to_geodetic(east, north)
    assert result[:2] == pytest.approx((latitude, longitude), abs=1e-12)  # 0.1 micrometres
    assert result[2] == pytest.approx(altitude, abs=1e-7)


@given(
    latitude=st.floats(-89.5, 89.5),
    longitude=st.floats(-180.0, 180.0),
    altitude=st.floats(-400.0, 8000.0),
    steps=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-2000.0, 2000.0)),
)
def test_the_plane_is_that_of_pymap3d(
    latitude: float, longitude: float, altitude: float, steps: tuple[float, float, float]
) -> None:
    plane = LocalPlane(Origin(latitude, longitude, altitude))
    point = latitude + steps[0], longitude + steps[1], altitude + steps[2]
    east, north, _ = geodetic2enu(*point, latitude, longitude, altitude, ell=WGS84)
    # The last digit of NumPy's sine may depend on the processor; it is 1 nm on the earth.
    assert plane.to_plane(*point) == pytest.approx((east, north), rel=0.0, abs=5e-9)


def test_many_points_give_the_bits_of_single_ones() -> None:
    random = np.random.default_rng(7)
    latitudes = 48.137 + random.normal(0.0, 0.5, 500)
    longitudes = 11.575 + random.normal(0.0, 0.5, 500)
    many = PLANE.to_plane_all(latitudes, longitudes, 519.0)
    for k, point in enumerate(zip(latitudes.tolist(), longitudes.tolist(), strict=True)):
        if np.isnan(many[0, k]):
            with pytest.raises(ValueError, match="100 km"):
                PLANE.to_plane(*point, 519.0)
        else:
            assert tuple(many[:, k].tolist()) == PLANE.to_plane(*point, 519.0)
