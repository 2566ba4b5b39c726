"""Where a point is: WGS84 against the local east-north plane, compass course against yaw.

World frame: the plane that touches the ellipsoid at the scenario's origin; yaw is counted
counter-clockwise from east. Degrees and compass courses exist only here and on the wire.
"""

import math
from dataclasses import dataclass

import pyproj

REACH = 100_000.0
"""Points further from the origin than this (m) are refused: a flat plane says little there."""

_FULL_TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the local plane touches the WGS84 ellipsoid: geodetic degrees, ellipsoidal metres."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    def __post_init__(self) -> None:
        if not -90.0 <= self.latitude_deg <= 90.0:
            raise ValueError(f"latitude {self.latitude_deg} deg is not within -90 to 90")
        if not -180.0 <= self.longitude_deg <= 180.0:
            raise ValueError(f"longitude {self.longitude_deg} deg is not within -180 to 180")
        if not math.isfinite(self.altitude_m):
            raise ValueError(f"altitude {self.altitude_m} m is not a finite number")


class LocalPlane:
    """The east-north plane at `origin`, with up counted along the ellipsoid's normal there.

    The transformation is the exact topocentric one (EPSG method 9837), not an approximation by
    arc lengths; there and back again differs by nanometres.
    """

    def __init__(self, origin: Origin) -> None:
        self.origin = origin
        self._transformer = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
            f"+lon_0={origin.longitude_deg:.17g} +lat_0={origin.latitude_deg:.17g} "
            f"+h_0={origin.altitude_m:.17g}"
        )

    def to_plane(
        self, latitude_deg: float, longitude_deg: float, altitude_m: float
    ) -> tuple[float, float]:
        """East and north of a geodetic point, metres; ValueError when beyond REACH."""
        east, north, up = self._transformer.transform(longitude_deg, latitude_deg, altitude_m)
        # Written so that NaN and infinity, which PROJ answers to nonsense, are refused too.
        if not east * east + north * north + up * up <= REACH * REACH:
            raise ValueError(
                f"latitude {latitude_deg} deg, longitude {longitude_deg} deg, altitude "
                f"{altitude_m} m is further than {REACH / 1000.0:.0f} km from the origin"
            )
        return east, north

    def to_geodetic(self, east: float, north: float) -> tuple[float, float, float]:
        """Latitude (deg), longitude (deg), altitude (m) of a point in the plane (up = 0)."""
        longitude_deg, latitude_deg, altitude_m = self._transformer.transform(
            east, north, 0.0, direction="INVERSE"
        )
        return latitude_deg, longitude_deg, altitude_m


def wrap_angle(angle: float) -> float:
    """Bring an angle (rad) into (-pi, pi] without changing its direction."""
    wrapped = math.remainder(angle, _FULL_TURN)
    return math.pi if wrapped <= -math.pi else wrapped


def yaw_from_heading(heading_deg: float) -> float:
    """Yaw (rad, counter-clockwise from east) of a compass course (deg, clockwise from north)."""
    return wrap_angle(math.radians(90.0 - heading_deg))


def heading_from_yaw(yaw: float) -> float:
    """Compass course in [0, 360) deg of a yaw (rad)."""
    heading_deg = (90.0 - math.degrees(yaw)) % 360.0
    return heading_deg if heading_deg < 360.0 else 0.0  # -1e-15 % 360 is 360 in floats
