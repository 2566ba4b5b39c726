"""Positions that are left out of a drive, and those that only look like it."""

import numpy as np
import pytest

from scenarios.definition.traces.drive import DriveTable, Floats, TraceError
from scenarios.definition.traces.positions import usable_positions

STEPS = np.arange(200.0)
BERLIN = np.stack((52.5 + 1e-5 * STEPS, 13.4 + 2e-5 * STEPS))
UTM = np.stack((391_000.0 + STEPS, 5_820_000.0 + 2.0 * STEPS))
LOCAL = np.stack((STEPS, 0.01 * STEPS**2))


def drive_of(position: Floats, *, geodetic: bool) -> DriveTable:
    count = position.shape[1]
    return DriveTable(
        geodetic=geodetic,
        unit="line",
        numbers=np.arange(2, count + 2),
        position=position.copy(),
        altitude_m=np.full(count, np.nan),
        time_s=0.1 * np.arange(float(count)),
        speed_mps=np.full(count, np.nan),
    )


def left_of(position: Floats, *, geodetic: bool) -> tuple[list[int], dict[str, int], list[str]]:
    """Return the places that are left out, the count of each kind, and the reasons."""
    drive = usable_positions(drive_of(position, geodetic=geodetic))
    gone = sorted(set(range(position.shape[1])) - {int(n) - 2 for n in drive.numbers})
    left = drive.left_out
    return gone, dict(left.counts), [record.reason for record in left.records]


def changed(base: Floats, places: slice | list[int], value: tuple[float, float]) -> Floats:
    points = base.copy()
    points[:, places] = np.array(value)[:, None]
    return points


@pytest.mark.parametrize(
    ("base", "places", "value", "kind", "reason"),
    [
        (BERLIN, [7], (91.0, 13.4), "off the earth", "off the earth: 91, 13.4"),
        (BERLIN, [0, 1, 50, 199], (-1e30, 400.0), "off the earth", "off the earth: -1e+30, 400"),
        (BERLIN, [60], (0.0, 0.0), "no fix", "no fix: 0°/0°"),
        (BERLIN, slice(0, 150), (0.0, 0.0), "no fix", "no fix: 0°/0°"),
        (BERLIN, slice(0, 200, 2), (5e-7, -5e-7), "no fix", "no fix: 0°/0°"),
        (BERLIN, [60, 61, 90], (0.0, 13.4), "far away", "km"),
        (BERLIN, [199], (52.5, 0.0), "far away", "km"),
        (UTM, slice(0, 120), (0.0, 0.0), "no fix", "no fix: 0 m/0 m"),
        (UTM, [30], (391_000.0, 0.0), "far away", "km"),
        (UTM, [30, 31], (1e9, 5_820_000.0), "absurd position", "1e+09, 5820000"),
        (BERLIN, slice(0, 40), (52.6, 13.4), "far away", "11.1 km"),
        (BERLIN, [100, 150, 199], (52.5, 14.4), "far away", "67.6 km"),
        (LOCAL, [50, 51], (1800.0, 20.0), "far away", "1.7 km"),
    ],
)
def test_a_wrong_position_is_left_out_with_its_reason(
    base: Floats, places: slice | list[int], value: tuple[float, float], kind: str, reason: str
) -> None:
    points = changed(base, places, value)
    expected = np.arange(200)[places].tolist()
    gone, kinds, reasons = left_of(points, geodetic=base is BERLIN)
    assert gone == expected
    assert kinds == {kind: len(expected)}
    assert reason in reasons[0]


@pytest.mark.parametrize(
    ("position", "geodetic"),
    [
        (BERLIN, True),
        (UTM, False),
        (LOCAL, False),  # begins at (0, 0)
        (np.stack((10.0 * STEPS, np.maximum(0.0, STEPS - 150.0))), False),  # 1.5 km on an axis
        (np.stack((1e-5 * (STEPS - 100.0), 1e-5 * (STEPS - 100.0))), True),  # across 0°/0°
        (np.stack((51.5 + 0.0 * STEPS, np.round(1e-4 * (STEPS - 100.0), 6))), True),  # meridian
        (np.stack((-16.8 + 0.0 * STEPS, (179.999 + 1e-5 * STEPS + 180.0) % 360.0 - 180.0)), True),
        (np.stack((51.5 + 0.0 * STEPS, (1e-5 * (STEPS - 100.0)) % 360.0)), True),  # 0 to 360
    ],
)
def test_good_positions_stay(position: Floats, geodetic: bool) -> None:
    assert left_of(position, geodetic=geodetic) == ([], {}, [])


def test_no_position_at_all_is_refused_with_the_first_record() -> None:
    with pytest.raises(TraceError, match=r"no valid point, line 2 \(0.0 s\): no fix: 0°/0°"):
        usable_positions(drive_of(np.zeros((2, 9)), geodetic=True))
