"""Small files with the faults that users reported, each with the figures of its drive.

A car drives 115 m eastwards at 10 m/s, and records its position twice a second: 24 points.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from tests.made.spoiled.drive_files import TABLES, Table, gpx, kml, nmea
from tests.made.spoiled.driven_paths import driven, written
from tests.made.spoiled.synthetic_drives import START, Drive, Fix, Recording

COUNT, LENGTH_M, DURATION_S, SPEED = 24, 115.0, 11.5, 10.0

GOOD = Drive(road=((LENGTH_M, 0.0),), heading=0.0, speed=SPEED, rate_hz=2.0).recorded()
EVERY = range(COUNT)

GEODETIC = TABLES["geodetic csv"]
PLANE = Table(columns=("t_s", "x_m", "y_m", "", ""))


def changed(change: Callable[[Fix], Fix], first: int = 0, last: int = COUNT) -> Recording:
    """Change the records from `first` to before `last`."""
    return GOOD.changed(
        change(fix) if first <= k < last else fix for k, fix in enumerate(GOOD.fixes)
    )


def shifted(seconds: float, first: int, last: int = COUNT) -> Recording:
    return changed(lambda fix: replace(fix, time=float(fix.time or 0.0) + seconds), first, last)


def in_order(*places: int) -> Recording:
    return GOOD.changed(GOOD.fixes[k] for k in places)


def held(fixes: tuple[Fix, ...]) -> Recording:
    """Each position is recorded five times, at 10 Hz."""
    times = [(fix, float(fix.time or 0.0) + 0.1 * k) for fix in fixes for k in range(5)]
    return GOOD.changed(replace(fix, time=time) for fix, time in times)


def milliseconds(recording: Recording) -> bytes:
    rows = PLANE.write(recording).decode().splitlines()
    cells = [row.split(",") for row in rows[1:]]
    return "\n".join([rows[0], *(f"{1000.0 * float(t):.0f},{x},{y}" for t, x, y in cells)]).encode()


@dataclass(frozen=True, kw_only=True)
class Known:
    """A file and the figures of its drive.

    `left_out` are the listed places of the records that are left out. `remark` is a word of a
    warning. `length_m` and `duration_s` are those of the drive, which has SPEED at `steady_at` (m).
    """

    file: str
    data: bytes
    left_out: tuple[int, ...] = ()
    remark: str = ""
    length_m: float = LENGTH_M
    duration_s: float = DURATION_S
    lead: str = "recorded"
    path: str = ""
    steady_at: tuple[float, ...] = (10.0, 30.0, 80.0, 90.0)


ZERO = changed(lambda fix: replace(fix, speed=0.0))
NO_FIX = (0.0, 0.0)
PAUSED = shifted(600.0, 12)

KNOWN: dict[str, Known] = {
    "all speeds zero": Known(file="a.csv", data=Table().write(ZERO), remark="speed"),
    "all speeds zero, nmea": Known(file="a.nmea", data=nmea(ZERO), remark="speed"),
    "times without zone": Known(file="a.gpx", data=gpx(GOOD, "iso"), remark="UTC"),
    "one point at 0/0": Known(
        file="a.gpx", data=gpx(GOOD.edited([10], degrees=NO_FIX)), left_out=(11,), remark="fix"
    ),
    "three first points at 0/0": Known(
        file="a.gpx", data=gpx(GOOD.edited([0, 1, 2], degrees=NO_FIX)),
        left_out=(1, 2, 3), remark="fix", length_m=100.0, duration_s=10.0,
    ),
    "three first points at 0/0, csv": Known(
        file="a.csv", data=GEODETIC.write(GOOD.edited([0, 1, 2], degrees=NO_FIX)),
        left_out=(2, 3, 4), remark="fix", length_m=100.0, duration_s=10.0,
    ),
    "same time everywhere": Known(
        file="a.gpx", data=gpx(GOOD.edited(EVERY, time=START)), remark="time", lead="set"
    ),
    "altitudes nan": Known(file="a.csv", data=GEODETIC.write(GOOD.edited(EVERY, height="nan"))),
    "altitudes -9999": Known(file="a.gpx", data=gpx(GOOD.edited(EVERY, height=-9999.0))),
    "first altitude absurd": Known(file="a.gpx", data=gpx(GOOD.edited([0], height=1e7))),
    "speeds in every third row": Known(
        file="a.csv", data=GEODETIC.write(GOOD.edited((k for k in EVERY if k % 3), speed=None))
    ),
    "header behind #": Known(
        file="a.csv", data=TABLES["track csv"].write(GOOD), lead="set"
    ),
    "semicolons, and a comma in a name": Known(
        file="a.csv",
        data=replace(PLANE, separator=";", extra=(("note, by driver", "ok"),)).write(GOOD),
    ),
    "utf-16": Known(file="a.csv", data=TABLES["utf-16 csv"].write(GOOD)),
    "utf-16 without a mark": Known(
        file="a.csv", data=replace(PLANE, encoding="utf-16-le").write(GOOD)
    ),
    "zero bytes first": Known(file="a.nmea", data=b"\0\0\0\r\n" + nmea(GOOD)),
    "zero bytes last": Known(file="a.gpx", data=gpx(GOOD) + b"\0" * 4096),
    "other line ends": Known(file="a.csv", data=GEODETIC.write(GOOD).replace(b"\n", b"\r")),
    "swapped records": Known(
        file="a.csv", data=PLANE.write(in_order(*range(8), 9, 8, *range(10, 24))), remark="order"
    ),
    "late block": Known(
        file="a.gpx", data=gpx(in_order(*range(5), *range(9, 14), *range(5, 9), *range(14, 24))),
        remark="order",
    ),
    "repeated block": Known(
        file="a.nmea", data=nmea(in_order(*range(15), *range(10, 24))), remark="repeat",
    ),
    "held positions": Known(
        file="a.csv", data=GEODETIC.write(held(GOOD.fixes)), remark="repeat", steady_at=()
    ),
    "coarse times": Known(
        file="a.csv",
        data=PLANE.write(changed(lambda fix: replace(fix, time=float(int(fix.time or 0.0))))),
        remark="same time",
    ),
    "clock set back by an hour": Known(
        file="a.csv", data=GEODETIC.write(shifted(-3600.0, 14)), remark="clock leaps"
    ),
    "unreadable times": Known(
        file="a.csv", data=PLANE.write(GOOD.edited([3, 9, 15], time="?")), remark="interpolated"
    ),
    "jump of 30 m": Known(
        file="a.csv",
        data=PLANE.write(changed(lambda fix: replace(fix, north=30.0), 11, 12)),
        left_out=(13,), remark="jump",
    ),
    "late sentences": Known(file="a.nmea", data=nmea(GOOD, 1)),
    "paused for ten minutes": Known(
        file="a.gpx", data=gpx(PAUSED), remark="a pause of", duration_s=DURATION_S + 600.0,
        steady_at=(10.0, 110.0),
    ),
    "paused for ten minutes, kept": Known(
        file="a.csv", data=TABLES["tab csv"].write(PAUSED), remark="a pause of",
        duration_s=DURATION_S + 600.0, path='pauses = "keep"', steady_at=(10.0, 110.0),
    ),
    "paused for ten minutes, cut": Known(
        file="a.gpx", data=gpx(PAUSED), remark="a pause of", path='pauses = "cut"'
    ),
    "paused for ten minutes, cut from nmea": Known(
        file="a.nmea", data=nmea(PAUSED), remark="a pause of", path='pauses = "cut"'
    ),
    "kml": Known(file="a.kml", data=kml(GOOD), lead="set"),
    "kml with times": Known(file="a.kml", data=kml(GOOD, times=True)),
    "one speed of 999": Known(file="a.csv", data=GEODETIC.write(GOOD.edited([7], speed=999.0))),
    "one wrong time": Known(
        file="a.csv", data=PLANE.write(shifted(5e4, 9, 10)), left_out=(11,), remark="time"
    ),
    "one position 300 km off": Known(
        file="a.csv", data=PLANE.write(changed(lambda fix: replace(fix, north=3e5), 9, 10)),
        left_out=(11,),
    ),
    "one line without numbers": Known(
        file="a.csv", data=PLANE.write(GOOD.edited([9], row="a,b,c")), left_out=(11,)
    ),
    "one line of nan": Known(
        file="a.csv", data=PLANE.write(GOOD.edited([9], row="nan,nan,nan")), left_out=(11,)
    ),
    "a wrong checksum": Known(
        file="a.nmea", data=nmea(GOOD).replace(b"*", b"*0", 1), left_out=(1,),
    ),
    "last line truncated": Known(
        file="a.csv", data=PLANE.write(GOOD)[:-9], length_m=110.0, duration_s=11.0, left_out=(25,)
    ),
    "gpx truncated within its last point": Known(
        file="a.gpx", data=gpx(GOOD)[: gpx(GOOD).rindex(b"lon=") + 9],
        length_m=110.0, duration_s=11.0, left_out=(24,),
    ),
}  # fmt: skip


@pytest.mark.parametrize("known", KNOWN.values(), ids=KNOWN)
def test_the_drive_has_its_figures(tmp_path: Path, known: Known) -> None:
    name = written(tmp_path, known.file, known.data)
    drive = driven(tmp_path, name, lead=known.lead, path=known.path)
    warnings = "\n".join(drive.report.warnings)
    assert drive.length == pytest.approx(known.length_m, abs=0.2)
    if known.lead == "recorded":
        run_in = drive.scenario.route.run_in
        duration = drive.scenario.duration_s - run_in
        assert duration == pytest.approx(known.duration_s, abs=0.6)
        speeds = [drive.speed_at(at) for at in known.steady_at]
        assert speeds == pytest.approx([SPEED] * len(speeds), abs=0.2)
    off = drive.path - drive.path[:, :1]
    assert abs(off[1]).max() < 0.05
    assert drive.left_out + drive.table.jumping_points == len(known.left_out)
    assert {*known.left_out} <= {*drive.listed}, warnings
    assert re.search(known.remark, warnings), warnings
    assert known.remark or known.left_out or known.lead == "set" or _quiet(warnings), warnings


def _quiet(warnings: str) -> bool:
    """Whether no warning is about the file."""
    return not re.search(r"\ba\.(csv|gpx|nmea|kml)", warnings)


def test_times_in_milliseconds_are_reported(tmp_path: Path) -> None:
    drive = driven(tmp_path, written(tmp_path, "a.csv", milliseconds(GOOD)))
    assert drive.length == pytest.approx(LENGTH_M, abs=0.2)
    assert re.search(r"\bms\b|millisecond", "\n".join(drive.report.warnings))


@pytest.mark.parametrize("second", ["iso", "iso z"])
def test_two_drives_have_a_common_clock_with_and_without_zone(tmp_path: Path, second: str) -> None:
    later = shifted(2.0, 0)
    written(tmp_path, "b.gpx", gpx(later, second))
    name = written(tmp_path, "a.gpx", gpx(GOOD))
    more = '[convoy]\nvehicles = 3\n[vehicle.v2]\nreplay = "b.gpx"\n'
    replays = driven(tmp_path, name, more=more).report.replays
    assert replays["v2"]["clock"] == "common"
    assert replays["v2"]["begun_s"] == pytest.approx(-2.0, abs=1.5)
