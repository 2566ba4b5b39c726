"""NMEA 0183: merged sentences, dates, damaged lines, and pynmea2 as a second opinion."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.definition.traces.drive import DriveTable, TraceError
from scenarios.definition.traces.formats.nmea import read_nmea
from scenarios.definition.traces.formats.registry import decoded
from tests.made.scenarios.recorded_drives import sentence

NOON = 43_200
DAY_2026 = 1_774_742_400.0
"""29 March 2026."""

KS = range(5)


def place(k: int) -> str:
    return f"5230.{k:04d},N,01324.{k:04d},E"


def gga(k: int, at: str = "", where: str | None = None, quality: int = 4) -> str:
    position = place(k) if where is None else where
    return sentence(f"GNGGA,{at or clock(k)},{position},{quality},12,0.8,100.0,M,40.0,M,,")


def rmc(k: int, at: str = "", date: str = "290326", status: str = "A", talker: str = "GN") -> str:
    return sentence(f"{talker}RMC,{at or clock(k)},{status},{place(k)},{k}.0,90.0,{date},,,A")


def clock(k: int) -> str:
    return f"1200{k:02d}.00"


def read(*lines: str, end: str = "\r\n") -> DriveTable:
    return read_nmea(decoded(end.join(lines).encode()))


def ks_of(drive: DriveTable) -> list[int]:
    """The k of the points, after a comparison of both coordinates."""
    ks = np.rint((drive.position[0] - 52.5) * 600_000).astype(int)
    assert np.allclose(drive.position[1], 13.4 + ks / 600_000, rtol=0, atol=1e-12)
    return [int(k) for k in ks]


@pytest.mark.parametrize(
    "lines",
    [
        [line for k in KS for line in (gga(k), rmc(k))],
        [line for k in KS for line in (rmc(k), gga(k))],
        [*map(gga, KS), *map(rmc, KS)],  # in blocks
        [*map(rmc, KS), *map(gga, KS)],
        [line for k in range(6) for line in ([gga(k)] * (k < 5) + [rmc(k - 1)] * (k > 0))],  # late
        [line for k in range(6) for line in ([rmc(k)] * (k < 5) + [gga(k - 1)] * (k > 0))],  # early
        [line for k in KS for line in (gga(k), rmc(k, talker="GP"), rmc(k))],
        [line for k in KS for line in ([gga(k)] * (k != 2) + [rmc(k)])],
        [*map(gga, KS[:3]), *map(rmc, KS)],
    ],
)
def test_sentences_of_one_time_become_one_point_with_speed(lines: list[str]) -> None:
    drive = read(*lines)
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    assert np.allclose(drive.speed_mps, np.arange(5) * 1852 / 3600)
    assert (drive.clock, drive.zero_s) == ("unix", DAY_2026)
    assert drive.time_s.tolist() == [NOON + k for k in KS]
    assert {140.0} <= set(drive.altitude_m.tolist())
    assert drive.left_out.counts.total() == 0


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("\r".join(map(gga, KS)), [1, 2, 3, 4, 5]),
        ("".join(map(gga, KS)), [1, 1, 1, 1, 1]),
        ("\n\n".join(map(gga, KS)), [1, 3, 5, 7, 9]),
        ("\r\n".join(f"12:00 \0\0{gga(k)} x" for k in KS), [1, 2, 3, 4, 5]),
        ("\0\0\0" + "\n".join(gga(k)[:-2] + gga(k)[-2:].lower() for k in KS), [1, 2, 3, 4, 5]),
        ("\n".join(gga(k).replace("$", "\x01\x7f$") for k in KS), [1, 2, 3, 4, 5]),
        ("!AIVDM,1,1,,A,x,0*00\n" + "\n".join(map(gga, KS)) + "\n", [2, 3, 4, 5, 6]),
    ],
)
def test_sentences_are_found_anywhere_in_a_line(text: str, numbers: list[int]) -> None:
    drive = read_nmea(decoded(text.encode()))
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    assert drive.numbers.tolist() == numbers
    assert drive.left_out.counts.total() == 0
    assert (drive.clock, drive.zero_s) == ("day", 0.0)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (gga(2)[:-1] + "z", "wrong or missing checksum"),
        (gga(2)[:30], "wrong or missing checksum"),
        (gga(2).replace("5230", "5231"), "wrong or missing checksum"),
        ("rubbish", "not a sentence"),
        (gga(2, where=",,,", quality=0), "no fix"),
        (gga(2, where="52x0.1,N,01324.0,E"), "position is '52x0.1,N,01324.0,E'"),
        (gga(2, where="5230.1,,01324.0,E"), "position is '5230.1,,01324.0,E'"),
        (sentence("GNGGA,120002.00"), "no fix"),
    ],
)
def test_a_damaged_line_is_left_out(line: str, reason: str) -> None:
    drive = read(*(line if k == 2 else gga(k) for k in KS))
    assert ks_of(drive) == [0, 1, 3, 4]
    (record,) = drive.left_out.records
    assert (record.number, record.reason) == (3, reason)


def test_quality_and_status_never_remove_a_position() -> None:
    drive = read(*(gga(k, quality=int(k > 1)) for k in KS))
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    (remark,) = drive.remarks
    assert remark.startswith("2 positions have quality 0")
    assert ks_of(read(*(rmc(k, status="V") for k in KS))) == [0, 1, 2, 3, 4]


def test_checksums_may_be_missing_everywhere() -> None:
    drive = read(*(gga(k).partition("*")[0] for k in KS))
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    assert len(drive.remarks) == 1


def test_equal_and_missing_times_keep_their_points() -> None:
    drive = read(*(line for k in KS for line in (gga(k, "120000.00"), rmc(k, "120000.00"))))
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    assert drive.time_s.tolist() == [NOON] * 5
    drive = read(*(gga(k, " ") for k in KS))
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    assert drive.clock is None
    assert np.isnan(drive.time_s).all()


@pytest.mark.parametrize(
    ("clocks", "dates", "day", "times"),
    [
        (("235959.5", "000000.0", "000000.5"), ("290326", "300326", "300326"), 0, (0, 0.5, 1)),
        (("235959.0", "235959.5", "000000.0"), ("290326",) * 3, 0, (0, 0.5, 1)),  # a late date
        (("120000", "120001", "120002"), ("120806", "290326", "290326"), 0, (0, 1, 2)),
        (("120000", "120001", "130001"), ("290326", "290326", "310326"), 0, (0, 1, 176_401)),
        (("120000", "120001", "120002"), ("290395",) * 3, -11_323, (0, 1, 2)),
        (("120000", "120001", "120002"), ("310226", "", "290326"), 0, (0, 1, 2)),
    ],
)
def test_dates_make_unix_times(
    clocks: tuple[str, ...], dates: tuple[str, ...], day: int, times: tuple[float, ...]
) -> None:
    rows = [rmc(k, at, date) for k, (at, date) in enumerate(zip(clocks, dates, strict=True))]
    drive = read(*rows)
    assert (drive.clock, drive.zero_s) == ("unix", DAY_2026 + 86_400 * day)
    assert (drive.time_s - drive.time_s[0]).tolist() == pytest.approx(list(times))


def test_other_sentences_have_positions_speeds_and_dates() -> None:
    gll = [sentence(f"GPGLL,{place(k)},{clock(k)},A,A") for k in KS]
    gns = [sentence(f"GNGNS,{clock(k)},{place(k)},NA,12,0.8,100.0,40.0,,") for k in KS]
    vtg = [sentence(f"GPVTG,90,T,,M,{k}.0,N,9,K,A") for k in KS]
    zda = [sentence(f"GPZDA,{clock(k)},29,03,2026,00,00") for k in KS]
    assert ks_of(read(*gll)) == [0, 1, 2, 3, 4]
    drive = read(*(line for k in KS for line in (gns[k], vtg[k], zda[k])))
    assert ks_of(drive) == [0, 1, 2, 3, 4]
    assert np.allclose(drive.speed_mps, np.arange(5) * 1852 / 3600)
    assert drive.altitude_m.tolist() == [140.0] * 5
    assert (drive.clock, drive.zero_s) == ("unix", DAY_2026)


@pytest.mark.parametrize(
    "text", ["$GPGSV,1,1,00*79", "$PGRMC,A,1*00", "hello", "$", "$*00\n$GPGGA,*", sentence("GPGGA")]
)
def test_a_file_without_positions_is_refused(text: str) -> None:
    with pytest.raises(TraceError, match="no valid GGA, RMC, GLL or GNS sentence"):
        read_nmea(text)


@settings(max_examples=60, deadline=None)
@given(
    degrees=st.floats(-89.9, 89.9),
    meridian=st.floats(-179.9, 179.9),
    seconds=st.integers(0, 8_639_999),
    digits=st.integers(1, 9),
    knots=st.floats(0, 300),
)
def test_numbers_are_those_of_pynmea2(
    degrees: float, meridian: float, seconds: int, digits: int, knots: float
) -> None:
    import pynmea2  # noqa: PLC0415 - a second opinion

    def cell(value: float, width: int) -> str:
        whole = math.floor(abs(value))
        minutes = min(60 * (abs(value) - whole), 59.9)
        return f"{whole:0{width}d}{minutes:0{digits + 3}.{digits}f}"

    at = f"{seconds // 360_000:02d}{seconds // 6000 % 60:02d}{seconds % 6000 / 100:05.2f}"
    line = sentence(
        f"GPRMC,{at},A,{cell(degrees, 2)},{'NS'[degrees < 0]},"
        f"{cell(meridian, 3)},{'EW'[meridian < 0]},{knots:.3f},,290326,,"
    )
    (latitude,), (longitude,) = read_nmea(line).position
    expected = pynmea2.parse(line, check=True)
    assert (latitude, longitude) == (expected.latitude, expected.longitude)
    assert read_nmea(line).speed_mps[0] == expected.spd_over_grnd * (1852 / 3600)
    assert read_nmea(line).time_s[0] == pytest.approx(seconds / 100, abs=1e-9)
