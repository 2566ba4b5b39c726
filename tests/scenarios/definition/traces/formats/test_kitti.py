"""Folders and files of KITTI's raw recordings."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.traces.formats.kitti import (
    is_oxts,
    oxts_folder,
    read_oxts,
    read_oxts_folder,
)
from scenarios.definition.traces.recorded_drive import TraceError

NOON = 1_316_865_600.0
"""24 September 2011, 12:00 UTC."""

REST = " ".join(["0.01"] * 21)


def packet(k: int) -> str:
    return f"49.{k:04d} 8.5 116.{k} 0.03 0.0 2.6 1.0 2.0 {10 + k}.5 {REST}\n"


def write(drive: Path, count: int = 12, times: int | None = 12) -> Path:
    (drive / "oxts" / "data").mkdir(parents=True)
    for k in range(count):
        (drive / "oxts" / "data" / f"{k:010d}.txt").write_text(packet(k))
    if times is not None:
        stamps = (f"2011-09-24 12:00:{k // 10:02d}.{k % 10}00000256\n" for k in range(times))
        (drive / "oxts" / "timestamps.txt").write_text("".join(stamps))
    return drive


@pytest.mark.parametrize("inside", ["", "oxts", "oxts/data"])
def test_a_drive_is_read_from_any_of_its_folders(tmp_path: Path, inside: str) -> None:
    drive = read_oxts_folder(write(tmp_path / "drive_0001_sync") / inside)
    assert drive.geodetic
    assert (drive.unit, drive.clock, drive.zero_s) == ("packet", "unix", NOON)
    np.testing.assert_allclose(drive.position[0], [49 + k / 1e4 for k in range(12)])
    np.testing.assert_allclose(drive.position[1], 8.5)
    np.testing.assert_allclose(drive.altitude_m[:10], [116 + k / 10 for k in range(10)])
    np.testing.assert_allclose(drive.speed_mps, np.arange(12) + 10.5)
    np.testing.assert_allclose(drive.time_s, np.arange(12) / 10, atol=1e-6)
    assert len(drive.remarks) == 1  # no zone


@pytest.mark.parametrize("content", ["", "\n", "abc def\n", "49.1\n", "nan nan 1\n", "\0\0\0"])
def test_a_spoiled_packet_is_left_out(tmp_path: Path, content: str) -> None:
    write(tmp_path)
    (tmp_path / "oxts" / "data" / f"{3:010d}.txt").write_text(content)
    drive = read_oxts_folder(tmp_path)
    assert drive.numbers.tolist() == [1, 2, 3, *range(5, 13)]
    np.testing.assert_allclose(drive.time_s[3], 0.4, atol=1e-6)
    assert [record.number for record in drive.left_out.records] == [4]


def test_a_file_of_packets_has_no_times() -> None:
    text = "".join(map(packet, range(12)))
    assert is_oxts(text)
    drive = read_oxts(text)
    assert (drive.unit, drive.count) == ("line", 12)
    assert not np.isfinite(drive.time_s).any()
    np.testing.assert_allclose(drive.speed_mps, np.arange(12) + 10.5)
    assert len(drive.remarks) == 1


def test_a_folder_without_packets_is_refused(tmp_path: Path) -> None:
    assert oxts_folder(tmp_path) is None
    with pytest.raises(TraceError, match="KITTI"):
        read_oxts_folder(tmp_path)
