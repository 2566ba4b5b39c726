"""Wrong, unordered, missing and coarse times are made usable without the loss of a position."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.definition.traces.drive import DriveTable
from scenarios.definition.traces.time_order import in_time_order

COUNT, INTERVAL, SPEED = 400, 0.1, 10.0
DAY = 86_400.0
UNIX = 1_774_746_000.0
WEEKS_1024 = 1024 * 7 * DAY
TRUE = np.arange(COUNT) * INTERVAL

Floats = NDArray[np.floating[Any]]
Order = list[int] | NDArray[np.signedinteger[Any]]


def recorded(times: Floats, order: Order | None = None) -> DriveTable:
    """A winding drive at constant speed with these times, its records in this order."""
    places = np.arange(len(times)) if order is None else np.asarray(order)
    along = np.arange(len(times)) * INTERVAL * SPEED
    unknown = np.full(len(places), np.nan)
    return DriveTable(
        geodetic=False,
        unit="line",
        numbers=places.astype(np.int64),
        position=np.array((along, 40.0 * np.sin(along / 80.0)))[:, places],
        altitude_m=unknown,
        time_s=times[places].astype(np.float64),
        speed_mps=unknown,
    )


def changed(first: int, last: int, by: float) -> Floats:
    times = TRUE.copy()
    times[first:last] += by
    return times


def assert_true_times(drive: DriveTable, tolerance: float = 1e-6) -> None:
    """All positions are there in their order, with the true times but for the clock's zero."""
    assert drive.numbers.tolist() == list(range(COUNT))
    off = drive.time_s - TRUE
    assert off - off[COUNT // 2] == pytest.approx(np.zeros(COUNT), abs=tolerance)


@pytest.mark.parametrize("by", [-1e9, -DAY, -5.0, 5.0, 3600.0, DAY])
@pytest.mark.parametrize("count", [1, 3])
def test_wrong_times_of_a_few_records_are_interpolated_and_listed(by: float, count: int) -> None:
    drive = in_time_order(recorded(changed(200, 200 + count, by)))
    assert_true_times(drive, 1e-4)
    assert [record.number for record in drive.left_out.records] == [*range(200, 200 + count)]


@pytest.mark.parametrize("by", [-1.0, -3600.0, -DAY, -WEEKS_1024, WEEKS_1024])
@pytest.mark.parametrize("place", [30, 250])
def test_times_after_a_leap_of_the_clock_are_shifted(by: float, place: int) -> None:
    """The longer part keeps its times."""
    drive = in_time_order(recorded(changed(place, COUNT, by)))
    assert_true_times(drive, 1e-3)
    kept = slice(place, None) if place == 30 else slice(place)
    assert drive.time_s[kept] == pytest.approx(changed(place, COUNT, by)[kept], abs=1e-9)
    assert (drive.left_out.counts.total(), len(drive.remarks)) == (0, 1)


def test_a_drive_of_several_days_keeps_its_times() -> None:
    drive = in_time_order(recorded(changed(200, COUNT, 3.0 * DAY)))
    assert drive.time_s.tolist() == changed(200, COUNT, 3.0 * DAY).tolist()


BLOCK = [*range(200), *range(230, 260), *range(200, 230), *range(260, COUNT)]
PAIRS = np.arange(COUNT).reshape(-1, 2)[:, ::-1].ravel()


@pytest.mark.parametrize(
    ("order", "repeated"),
    [
        ([*range(200), 201, 200, *range(202, COUNT)], 0),
        (BLOCK, 0),
        ([*range(200), *range(150, COUNT)], 50),
        (PAIRS, 0),
        ([*range(100), *range(COUNT)], 100),
        ([*range(COUNT)][::-1], 0),
    ],
    ids=[
        "late record",
        "late block",
        "block sent twice",
        "pairs",
        "begun twice",
        "backward",
    ],
)
def test_records_out_of_order_are_sorted(order: Order, repeated: int) -> None:
    drive = in_time_order(recorded(TRUE, order))
    assert_true_times(drive)
    assert drive.time_s.tolist() == TRUE.tolist()
    assert drive.left_out.counts.total() == 0
    assert len(drive.remarks) == 1
    assert drive.remarks[0].startswith(f"{repeated} records") == (repeated > 0)


def test_laps_on_a_clock_that_starts_again_are_not_sorted() -> None:
    drive = in_time_order(recorded(np.asarray(TRUE % 8.0, dtype=np.float64)))
    assert_true_times(drive)


@pytest.mark.parametrize(
    ("times", "remark"),
    [
        (np.full(24, 7.0), "all 24 points have the same time: the drive has no times"),
        (np.arange(24) // 12 * 1.0, "24 points have only 2 different times: "),
        (np.where(np.arange(24) < 11, np.arange(24.0), np.nan), "only 11 of 24 points have a time"),
        (np.arange(24) % 2 * 9.0 + np.arange(24) % 3, "time runs back at "),
    ],
    ids=["one time", "two times", "few times", "no order"],
)
def test_drives_without_usable_times_have_none(times: Floats, remark: str) -> None:
    drive = in_time_order(recorded(times))
    assert (drive.count, drive.left_out.counts.total()) == (24, 0)
    assert np.isnan(drive.time_s).all()
    assert drive.remarks[-1].startswith(remark)
