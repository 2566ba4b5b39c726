"""Times of tables: dates, times of day and numbers."""

import math
import os
import time
from collections.abc import Iterator

import numpy as np
import pytest

from scenarios.definition.traces.formats.cells import read_times

NOON = 1_774_785_600.0
"""29 March 2026, 12:00 UTC."""

DATES: dict[str, tuple[list[str], float]] = {
    "ISO with Z": (["2026-03-29T12:00:00Z", "2026-03-29T12:00:00.25Z"], 0.25),
    "ISO with a zone": (["2026-03-29T14:00:00+02:00", "2026-03-29T14:00:01.5+02:00"], 1.5),
    "ISO without T and zone": (["2026-03-29 12:00:00", "2026-03-29 12:00:00,5"], 0.5),
    "ISO with nanoseconds": (["2026-03-29 12:00:00.000000000", "2026-03-29 12:00:02"], 2.0),
    "basic ISO": (["20260329T120000Z", "20260329T120001Z"], 1.0),
    "zone after a space": (["2026-03-29 05:30:00 -0630", "2026-03-29 12:00:03 UTC"], 3.0),
    "slashes": (["2026/03/29 12:00:00.000", "2026/03/29 12:00:00.200"], 0.2),
    "slashes, one digit": (["2026/3/29 12:00:00.0", "2026/3/29 12:00:00.2"], 0.2),
    "points": (["29.03.2026 12:00:00", "29.03.2026 12:00:01"], 1.0),
    "day first": (["29/03/2026 12:00:00", "29/03/2026 12:00:01"], 1.0),
    "month first": (["03/29/2026 12:00:00 PM", "3/29/2026 12:00:01 pm"], 1.0),
    "HTTP": (["Sun, 29 Mar 2026 12:00:00 GMT", "Sun, 29 Mar 2026 12:00:05 GMT"], 5.0),
    "ctime": (["Sun Mar 29 12:00:00 2026", "Sun Mar 29 12:00:05 2026"], 5.0),
    "words": (["Mar 29, 2026, 12:00:00 PM", "March 29, 2026 12:00:00.5 PM"], 0.5),
    "leap second": (["2026-03-29 11:59:60Z", "2026-03-29 12:00:01Z"], 1.0),
    "quoted": (["'2026-03-29T12:00:00Z'", ' "2026-03-29T12:00:01Z"'], 1.0),
    "s": (["1774785600", "1774785600.5"], 0.5),
    "ms": (["1774785600000", "1774785600200"], 0.2),
    "us": (["1774785600000000", "1774785600000250"], 0.00025),
    "ns": (["1774785600000000000", "1774785600000000001"], 1e-9),
    "exponent": (["1.7747856e18", "1.774785601e18"], 1.0),
    "decimal comma": (["1774785600,0", "1774785600,5"], 0.5),
}


@pytest.fixture(params=["UTC", "America/St_Johns"])
def _any_zone(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("TZ", request.param)
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("_any_zone")
def test_absolute_times_are_utc_on_any_machine() -> None:
    assert os.environ["TZ"]
    for name, (cells, later) in DATES.items():
        column = read_times(cells)
        assert column.clock == "unix", name
        assert column.zero_s == NOON, name
        assert column.seconds.tolist() == pytest.approx([0.0, later], abs=1e-12), name


def test_assumptions_are_remarked() -> None:
    without_zone = {"ISO without T and zone", "ISO with nanoseconds", "points", "ctime", "words"}
    for name, (cells, _) in DATES.items():
        remarks = " ".join(read_times(cells).remarks)
        assert ("read as UTC" in remarks) == (name in without_zone or "/" in cells[0]), name
        assert ("magnitude" in remarks) == (name in {"ms", "us", "ns", "exponent"}), name
        assert ("month first" in remarks) == (name == "month first"), name


@pytest.mark.parametrize(
    ("cells", "unit", "seconds", "clock"),
    [
        (["0", "0.5", "1"], None, [0.0, 0.5, 1.0], None),
        (["0", "500", "1000"], None, [0.0, 500.0, 1000.0], None),
        (["0", "500", "1000"], "ms", [0.0, 0.5, 1.0], None),
        (["0", "500000"], "us", [0.0, 0.5], None),
        (["-1e9", "0", "1e9"], "ns", [-1.0, 0.0, 1.0], None),
        (["2000000000000", "2000100000000"], "ns", [2000.0, 2000.1], None),
        (["1774785600000", "1774785600200"], "ms", [0.0, 0.2], "unix"),
        (["1774785600000", "1774785600200"], "s", [0.0, 0.2], "unix"),
        (["1774785600.0", "1774785600.2"], "ms", [0.0, 0.2], "unix"),
        (["1774785600", "", "abc", "nan", "1774785602"], None, [0, *[math.nan] * 3, 2], "unix"),
        (["0", "1", "1774785600", "3"], None, [0.0, 1.0, NOON, 3.0], None),
        (["0", "1774785600", "1774785601"], None, [-NOON, 0.0, 1.0], "unix"),
        (["12:00:00.2", "12:00:01", "0:00:01,5"], None, [43200.2, 43201.0, 1.5], "day"),
        (["23:59:59Z", "00:00:00Z"], None, [86399.0, 0.0], "day"),
        (["11:59:59 PM", "12:00:00 AM"], None, [86399.0, 0.0], "day"),
        (["", "2026-03-29T12:00:00Z", "?", "5"], None, [math.nan, 0.0, math.nan, math.nan], "unix"),
        (["99:99:99 nonsense", "2026-13-45T12:00:00"], None, [math.nan, math.nan], None),
        (["nan", "nan", "nan", "4"], None, [math.nan, math.nan, math.nan, 4.0], None),
        (["1774785600.1", "1e300", "1774785601"], None, [0.1, math.nan, 1.0], "unix"),
        (["a", ""], None, [math.nan, math.nan], None),
        ([], None, [], None),
    ],
)  # fmt: skip
def test_columns_keep_their_kind_in_spite_of_single_cells(
    cells: list[str], unit: str | None, seconds: list[float], clock: str | None
) -> None:
    column = read_times(cells, unit)
    assert column.clock == clock
    assert column.zero_s == (NOON if clock == "unix" else 0.0)
    np.testing.assert_allclose(column.seconds, seconds, atol=1e-6)
