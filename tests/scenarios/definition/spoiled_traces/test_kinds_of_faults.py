"""Each kind of fault of recorders and exports, on ten drives in all formats it occurs in.

The spoiled file is driven like the good one, and the report counts and lists what is left out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import cycle, islice
from pathlib import Path
from random import Random

import pytest

from tests.made.spoiled import file_faults, record_faults
from tests.made.spoiled.drive_files import TABLES, WRITERS
from tests.made.spoiled.driven_paths import Driven, driven, largest_distance, lost_points, written
from tests.made.spoiled.record_faults import Fault
from tests.made.spoiled.synthetic_drives import (
    BEND,
    LOOP,
    S_BEND,
    STRAIGHT,
    U_TURN,
    Drive,
    Recording,
)

GEODETIC = TABLES["geodetic csv"]

CLOSE = 0.3
"""Largest distance (m) between the paths of a spoiled and the good file."""

DRIVES = (
    Drive(road=((115.0, 0.0),), speed=10.0, rate_hz=2.0),
    Drive(road=BEND, noise=0.02, seed=2),
    Drive(road=S_BEND, speed=9.0, rate_hz=5.0, noise=0.02, seed=3),
    Drive(road=LOOP, rate_hz=20.0, noise=0.01, seed=4),
    Drive(road=U_TURN, speed=8.0, noise=0.03, seed=5),
    Drive(road=STRAIGHT, speed=25.0, rate_hz=10.0, noise=0.05, seed=6),
    Drive(road=BEND, stops=((60.0, 12.0), (250.0, 6.0)), noise=0.02, seed=7),
    Drive(road=STRAIGHT, speed=15.0, rate_hz=1.0, noise=0.05, seed=8),
    Drive(road=S_BEND, rate_hz=25.0, noise=0.01, from_standstill=True, seed=9),
    Drive(road=LOOP, speed=7.0, rate_hz=4.0, noise=0.02, seed=10),
)


def as_it_is(recording: Recording, _: Random) -> Recording:
    return recording


def same_bytes(data: bytes, _: Random) -> bytes:
    return data


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of fault in some formats, and what the report must state.

    `counted`: the number of records left out is that of the spoiled ones, and their places are
    listed. `remark`: there is at least one more warning than for the good file. `lead`: the speed.
    """

    forms: tuple[str, ...]
    fault: Fault = as_it_is
    bytes_fault: Callable[[bytes, Random], bytes] = same_bytes
    counted: bool = False
    remark: bool = False
    lead: str = "recorded"
    speeds: bool = True


SPEEDS = ("plane csv", "geodetic csv", "nmea", "speeds gpx")
CSV = ("plane csv", "iso geodetic csv", "ms geodetic csv", "geodetic csv")
DATED = ("iso geodetic csv", "gpx", "us geodetic csv", "ns geodetic csv", "tab csv")
ALL = ("plane csv", "gpx", "nmea", "geodetic csv")
FIXES = ("gpx", "nmea", "geodetic csv", "kml track log", "mcap log")

KINDS: dict[str, Kind] = {
    "zero speeds": Kind(forms=SPEEDS, fault=record_faults.zero_speeds, remark=True),
    "sparse speeds": Kind(forms=SPEEDS[:2], fault=record_faults.sparse_speeds),
    "garbage speeds": Kind(forms=SPEEDS[:2], fault=record_faults.garbage_speeds),
    "absurd speed": Kind(forms=SPEEDS[:3], fault=record_faults.absurd_speed),
    "wrong time": Kind(forms=DATED, fault=record_faults.wrong_time, counted=True, remark=True),
    "unreadable times": Kind(forms=CSV, fault=record_faults.unreadable_times, remark=True),
    "times without zone": Kind(forms=("zoneless gpx", "zoneless geodetic csv"), remark=True),
    "same time": Kind(forms=DATED, fault=record_faults.same_time, lead="set", remark=True),
    "no times": Kind(forms=("gpx", "plane csv"), fault=record_faults.no_times, lead="set"),
    "no fix first": Kind(
        forms=FIXES, fault=record_faults.no_fix_first, counted=True, remark=True
    ),
    "no fix between": Kind(
        forms=FIXES, fault=record_faults.no_fix_between, counted=True, remark=True
    ),
    "missing heights": Kind(
        forms=("geodetic csv", "gpx", "nmea"), fault=record_faults.missing_heights
    ),
    "some heights": Kind(forms=("geodetic csv", "gpx", "nmea"), fault=record_faults.some_heights),
    "positions off": Kind(forms=ALL, fault=record_faults.positions_off, remark=True),
    "clock set back": Kind(
        forms=ALL, fault=record_faults.clock_set_back, remark=True, speeds=False
    ),
    "swapped records": Kind(forms=ALL, fault=record_faults.swapped_records),
    "late block": Kind(forms=ALL, fault=record_faults.late_block),
    "repeated records": Kind(forms=ALL, fault=record_faults.repeated_records),
    "repeated block": Kind(forms=ALL, fault=record_faults.repeated_block),
    "held positions": Kind(forms=ALL, fault=record_faults.held_positions, remark=True),
    "coarse times": Kind(forms=ALL, fault=record_faults.coarse_times, speeds=False),
    "forms of tables": Kind(
        forms=(
            "savetxt csv", "tab csv", "sep csv", "decimal csv", "utf-16 csv", "pos csv",
            "zoned geodetic csv", "us geodetic csv", "ns geodetic csv", "ms geodetic csv",
        ),
    ),
    "track databases": Kind(forms=("track csv", "places csv"), lead="set"),
    "other formats": Kind(forms=("kml track log", "mcap log", "pos csv")),
    "lines": Kind(forms=("kml line", "geojson line"), lead="set"),
    "utf-16": Kind(forms=ALL, bytes_fault=file_faults.utf_16),
    "zero bytes first": Kind(
        forms=("nmea", "plane csv", "geodetic csv"), bytes_fault=file_faults.zero_bytes_first
    ),
    "zero bytes last": Kind(forms=ALL, bytes_fault=file_faults.zero_bytes_last),
    "other line ends": Kind(forms=ALL, bytes_fault=file_faults.other_line_ends),
    "late sentences": Kind(forms=("late nmea",)),
}  # fmt: skip

CASES = [
    pytest.param(kind, form, drive, id=f"{name}, {form}, {number}")
    for name, kind in KINDS.items()
    for number, (form, drive) in enumerate(zip(islice(cycle(kind.forms), 10), DRIVES, strict=True))
]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Drive, str, str], Driven]:
    """Drive the good file of a drive in a format."""
    folder = tmp_path_factory.mktemp("good")

    @cache
    def load(drive: Drive, form: str, lead: str) -> Driven:
        suffix, write = WRITERS[form]
        return driven(folder, written(folder, f"good{suffix}", write(drive.recorded())), lead=lead)

    return load


@pytest.mark.spread(90)
@pytest.mark.parametrize(("kind", "form", "drive"), CASES)
def test_a_spoiled_file_is_driven_like_the_good_one(
    tmp_path: Path,
    good: Callable[[Drive, str, str], Driven],
    kind: Kind,
    form: str,
    drive: Drive,
) -> None:
    random = Random(drive.seed)
    suffix, write = WRITERS[form]
    recording = kind.fault(drive.recorded(), random)
    data = kind.bytes_fault(write(recording), random)
    unspoiled = good(drive, _plain(form), kind.lead)
    spoiled = driven(tmp_path, written(tmp_path, f"spoiled{suffix}", data), lead=kind.lead)

    assert largest_distance(spoiled, unspoiled) < CLOSE
    missing = len(recording.may_lack - {-1})
    spacing = drive.speed / drive.rate_hz
    assert spoiled.length == pytest.approx(unspoiled.length, abs=missing * spacing + 0.5)
    assert len(lost_points(spoiled, drive, recording)) <= 0.05 * len(drive.recorded().fixes)
    if kind.lead == "recorded" and kind.speeds:
        duration = unspoiled.scenario.duration_s + recording.added_s
        allowed = missing / drive.rate_hz + 1.5 + 1.0 / drive.rate_hz
        assert spoiled.scenario.duration_s == pytest.approx(duration, abs=allowed)
        mean = unspoiled.length / unspoiled.scenario.duration_s
        assert spoiled.length / spoiled.scenario.duration_s == pytest.approx(mean, rel=0.1)
    if kind.remark:
        known = {_without_name(line, unspoiled) for line in unspoiled.report.warnings}
        assert {_without_name(line, spoiled) for line in spoiled.report.warnings} - known
    if kind.counted:
        places = [k for k, fix in enumerate(recording.fixes) if fix.truth in recording.may_lack]
        assert spoiled.left_out == len(places)
        numbers = [_number(form, k) for k in places[:10]]
        assert {*numbers} <= {*spoiled.listed}


def _without_name(line: str, drive: Driven) -> str:
    return line.replace(drive.table.source, "")


def _plain(form: str) -> str:
    """Return the usual form of the good file that a spoiled one is compared with."""
    if form.endswith(("gpx", "nmea")):
        return form.rsplit(maxsplit=1)[-1]
    return "plane csv" if TABLES.get(form, GEODETIC).geodetic is False else "geodetic csv"


def _number(form: str, place: int) -> int:
    """Return the line, point or message of a record."""
    if form.endswith("csv"):
        return place + 2
    return 2 * place + 1 if form == "nmea" else place + 1
