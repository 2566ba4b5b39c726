"""KITTI's raw recordings: a folder of packets of an OXTS receiver, or a file of them.

Source: Geiger, Lenz, Stiller and Urtasun, "Vision meets robotics: The KITTI dataset", IJRR 2013.
"""

import math
from itertools import zip_longest
from pathlib import Path
from typing import Final

from scenarios.definition.traces.formats.cells import PointColumns, as_number
from scenarios.definition.traces.recorded_drive import NO_TIMES, RecordedDrive, TraceError

PACKET: Final = 30
"""Number of values of a packet: latitude, longitude, altitude, and others."""

FORWARD_SPEED: Final = 8
"""Index of the speed (m/s) in a packet."""

UNTIMED: Final = f"{{}} is missing: {NO_TIMES}"


def oxts_folder(path: Path) -> Path | None:
    """Return the oxts folder of a drive's folder, of itself, or of the data in it."""
    folders = (path / "oxts", path, path.parent if path.name == "data" else path)
    return next((folder for folder in folders if any(_packets(folder))), None)


def is_oxts(text: str) -> bool:
    """Whether the first line of a text is a packet."""
    cells = text.lstrip().partition("\n")[0].split()
    return len(cells) == PACKET and not any(math.isnan(as_number(cell)) for cell in cells)


def read_oxts_folder(path: Path) -> RecordedDrive:
    """Read the packets of an oxts folder by their names, with the times in timestamps.txt.

    The numbers of points count packets from 1. Raises TraceError without packets.
    """
    folder = oxts_folder(path)
    if folder is None:
        raise TraceError(
            "a folder without oxts/data/*.txt: give a file, or a folder of KITTI's raw recordings"
        )
    lines = [_text(packet).partition("\n")[0] for packet in sorted(_packets(folder))]
    times = folder / "timestamps.txt"
    if not times.is_file():
        return _drive(lines, [], "packet").with_remarks(UNTIMED.format(times.name))
    return _drive(lines, _text(times).splitlines(), "packet")


def read_oxts(text: str) -> RecordedDrive:
    """Read a packet per line; it has no times."""
    return _drive(text.splitlines(), [], "line").with_remarks(UNTIMED.format("timestamps.txt"))


def _packets(folder: Path) -> list[Path]:
    return [*(folder / "data").glob("*.txt")]


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _drive(lines: list[str], times: list[str], unit: str) -> RecordedDrive:
    columns = PointColumns()
    for line, time in zip_longest(lines, times[: len(lines)], fillvalue=""):
        cells = line.split()
        cells += [""] * (PACKET - len(cells))
        latitude, longitude, altitude = cells[:3]
        columns.add(latitude, longitude, altitude, time, cells[FORWARD_SPEED])
    return columns.drive(unit=unit)
