"""Logs that repeat positions are thinned to distinct points; ordinary ones stay as they are."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scenarios.definition.traces.cleaning import without_repeats
from scenarios.definition.traces.drive import DriveTable

SPAN = 60.0
Floats = NDArray[np.floating[Any]]


def course(times: Floats) -> Floats:
    along = 12.0 * times + 15.0 * np.sin(times / 5.0)
    return np.array((along, 40.0 * np.sin(along / 150.0)))


def recorded(position: Floats, times: Floats | None) -> DriveTable:
    count = position.shape[1]
    numbers = np.arange(count)
    return DriveTable(
        geodetic=False,
        unit="line",
        numbers=numbers,
        position=position.astype(np.float64),
        altitude_m=numbers.astype(np.float64),
        time_s=np.full(count, np.nan) if times is None else times.astype(np.float64),
        speed_mps=numbers.astype(np.float64),
    )


def held(hold: float, rate: float) -> tuple[Floats, Floats]:
    """Times at `rate`, and positions that are updated every `hold` seconds."""
    times = np.arange(int(SPAN * rate)) / rate
    return times, course(np.floor(times / hold + 1e-9) * hold)


PATTERNS = {
    "10 Hz in 50 Hz": (0.1, 50.0),
    "10 Hz in 33 Hz": (0.1, 33.0),
    "10 Hz in 15 Hz": (0.1, 15.0),
    "every point twice": (0.1, 20.0),
    "1 Hz in 100 Hz": (1.0, 100.0),
}


@pytest.mark.parametrize(("hold", "rate"), PATTERNS.values(), ids=PATTERNS)
@pytest.mark.parametrize("timed", [True, False])
def test_repeated_positions_are_thinned(hold: float, rate: float, *, timed: bool) -> None:
    times, position = held(hold, rate)
    drive = without_repeats(recorded(position, times if timed else None))
    assert drive.count == round(SPAN / hold)
    assert np.diff(drive.position).any(axis=0).all()
    assert drive.speed_mps.tolist() == drive.numbers.tolist()
    if timed:
        appeared = np.arange(drive.count) * hold
        assert (drive.time_s >= appeared - 1e-9).all()
        assert (drive.time_s < appeared + 1.0 / rate).all()
        repeats = times.size - drive.count
        assert drive.remarks == (
            f"positions repeat: {1.0 / hold:.0f} Hz in records of {rate:.0f} Hz: "
            f"{repeats} repeats are ignored",
        )


def test_a_standstill_keeps_its_first_and_last_record() -> None:
    times = np.arange(3000) * 0.02
    moved = np.where(times < 20.0, times, np.maximum(20.0, times - 15.0))
    drive = without_repeats(recorded(course(np.floor(moved / 0.1 + 1e-9) * 0.1), times))
    assert drive.count == 450 + 1
    k = int(np.argmax(np.diff(drive.time_s)))
    assert drive.time_s[k : k + 2] == pytest.approx([20.0, 35.08], abs=0.03)
    assert (drive.position[:, k] == drive.position[:, k + 1]).all()


TIMES = np.arange(600) * 0.1
ORDINARY = {
    "moving": course(TIMES),
    **{f"rounded to {unit} m": np.round(course(TIMES) / unit) * unit for unit in (0.1, 1.0)},
    "standing half of the time": course(np.maximum(0.0, TIMES - 30.0)),
    "stop and go": course(np.cumsum(np.where(np.sin(TIMES) > 0.0, 0.05, 0.0))),
    "few points": course(np.array([0.0, 0.0, 1.0, 1.0])),
}


@pytest.mark.parametrize("position", ORDINARY.values(), ids=ORDINARY)
@pytest.mark.parametrize("timed", [True, False])
def test_ordinary_drives_are_returned_as_they_are(position: Floats, *, timed: bool) -> None:
    drive = recorded(position, TIMES[: position.shape[1]] if timed else None)
    kept = without_repeats(drive)
    assert kept is drive
