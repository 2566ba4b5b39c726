"""Geodesy: WGS84 to and from the local east-north plane, compass course to and from yaw.

World frame: the plane tangent to the ellipsoid at the scenario's origin; yaw is counter-clockwise
from east. Degrees and compass courses exist only here and on the wire.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pymap3d.ecef import geodetic2ecef
from pymap3d.ellipsoid import Ellipsoid
from pymap3d.rcurve import meridian, transverse

FloatArray = NDArray[np.float64]

REACH: Final = 100_000.0  # Distance (m) from the origin beyond which a plane is a poor map
CORRECTED: Final = 1e-5  # A correction below this (m) is the last: its error is far smaller
MAX_CORRECTIONS: Final = 20  # Three are typical within some kilometres of the origin

WGS84 = Ellipsoid.from_name("wgs84")
_MAJOR, _MINOR = float(WGS84.semimajor_axis), float(WGS84.semiminor_axis)
_MAJOR_SQUARE: Final = _MAJOR**2
_FLAT: Final = (_MINOR / _MAJOR) ** 2


@dataclass(frozen=True, slots=True)
class Origin:
    """Point of tangency of the local plane: geodetic degrees, ellipsoidal height (m), WGS84."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class LocalPlane:
    """The east-north plane at `origin`; up is along the ellipsoid's normal there.

    The transformation is the exact topocentric one (EPSG method 9837), not an approximation by arc
    lengths. The error of a round trip is below one micrometre.
    """

    def __init__(self, origin: Origin) -> None:
        self.origin = origin
        latitude = math.radians(origin.latitude_deg)
        place = geodetic2ecef(origin.latitude_deg, origin.longitude_deg, origin.altitude_m, WGS84)
        self._centre = tuple(float(coordinate) for coordinate in place)
        longitude = math.radians(origin.longitude_deg)
        self._latitude_turn = math.cos(latitude), math.sin(latitude)
        self._longitude_turn = math.cos(longitude), math.sin(longitude)
        self._north_radius = float(meridian(origin.latitude_deg)) + origin.altitude_m
        self._east_radius = (float(transverse(origin.latitude_deg)) + origin.altitude_m) * math.cos(
            latitude
        )

    def to_plane(
        self, latitude_deg: float, longitude_deg: float, altitude_m: float
    ) -> tuple[float, float]:
        """East and north (m) of a WGS84 point by EPSG method 9837; ValueError beyond REACH."""
        if math.isfinite(latitude_deg + longitude_deg + altitude_m):
            east, north, up = self._topocentric(latitude_deg, longitude_deg, altitude_m)
        else:
            east = north = up = math.inf
        if east * east + north * north + up * up > REACH * REACH:
            raise ValueError(
                f"latitude {latitude_deg} deg, longitude {longitude_deg} deg, altitude "
                f"{altitude_m} m is further than {REACH / 1000.0:.0f} km from the origin"
            )
        return east, north

    def to_plane_all(
        self, latitudes_deg: FloatArray, longitudes_deg: FloatArray, altitude_m: float
    ) -> FloatArray:
        """East and north (m), shape (2, n), of WGS84 points (n,) at one height, as by `to_plane`.

        Points beyond REACH are NaN.
        """
        points = zip(latitudes_deg.tolist(), longitudes_deg.tolist(), strict=True)
        places = np.array([self._topocentric(*point, altitude_m) for point in points])
        places = places.reshape(-1, 3).T
        return np.where(np.sum(places * places, axis=0) <= REACH * REACH, places[:2], math.nan)

    def to_geodetic(self, east: float, north: float) -> tuple[float, float, float]:
        """Latitude (deg), longitude (deg), altitude (m) of a point in the plane (up = 0).

        Inverts `to_plane` (EPSG method 9837) iteratively, from the curvature of the earth on; each
        correction reduces the error by the factor distance / earth radius. A closed inverse would
        need functions whose last bit depends on the processor, so that logs would, too.
        """
        origin = self.origin
        latitude, longitude, altitude = origin.latitude_deg, origin.longitude_deg, origin.altitude_m
        left = east, north, (east * east + north * north) / (2.0 * self._north_radius)
        for _ in range(MAX_CORRECTIONS):
            latitude += math.degrees(left[1] / self._north_radius)
            longitude += math.degrees(left[0] / self._east_radius)
            altitude += left[2]
            if abs(left[0]) + abs(left[1]) + abs(left[2]) < CORRECTED:
                break
            there = self._topocentric(latitude, longitude, altitude)
            left = east - there[0], north - there[1], -there[2]
        return latitude, longitude, altitude

    def _topocentric(
        self, latitude_deg: float, longitude_deg: float, altitude_m: float
    ) -> tuple[float, float, float]:
        """East, north and up (m) by EPSG method 9837: pymap3d's formulas, in its order.

        The results equal pymap3d's where NumPy's sine is that of the C library. pymap3d's own
        functions take arrays and recompute the origin's angles for every message.
        """
        latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
        cos, sin = math.cos(latitude), math.sin(latitude)
        # abs(complex) and NumPy use the C library's hypot; `math.hypot` rounds differently.
        normal = _MAJOR_SQUARE / abs(complex(_MAJOR * cos, _MINOR * sin))
        x0, y0, z0 = self._centre
        x = (normal + altitude_m) * cos * math.cos(longitude) - x0
        y = (normal + altitude_m) * cos * math.sin(longitude) - y0
        z = (normal * _FLAT + altitude_m) * sin - z0
        cos, sin = self._longitude_turn
        outward, east = cos * x + sin * y, -sin * x + cos * y
        cos, sin = self._latitude_turn
        return east, -sin * outward + cos * z, cos * outward + sin * z


def along(yaw: float, east: float, north: float) -> float:
    """Component (m) of the vector (east, north) (m) in the direction `yaw` (rad).

    The scalar product with the unit vector, elementary algebra.
    """
    return east * math.cos(yaw) + north * math.sin(yaw)


def yaw_from_heading(heading_deg: float) -> float:
    """Yaw (rad, counter-clockwise from east) of a compass course (deg, clockwise from north).

    θ of Section III-B, counted from the X axis.
    """
    return math.remainder(math.radians(90.0 - heading_deg), math.tau)


def heading_from_yaw(yaw: float) -> float:
    """Compass course in [0, 360) deg of a yaw (rad, θ of Section III-B)."""
    heading_deg = (90.0 - math.degrees(yaw)) % 360.0
    return heading_deg if heading_deg < 360.0 else 0.0  # -1e-15 % 360 is 360 in floats
