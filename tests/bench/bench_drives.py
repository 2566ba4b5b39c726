"""Cost of `convoy check` of long drives: `python -m tests.bench.bench_drives [--points 1000000]`.

Writes a drive of 50 fixes a second as CSV, GPX and NMEA, with that many points and a tenth of it.
Prints the processor time and the peak memory of a process that checks each file, and the ratio of
the times: more than 12 shows a cost that grows faster than the number of points. The yardstick is a
plain Python loop.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from tests.bench.bench_run import Row, plain_loop, print_rows, timed
from tests.made.spoiled.drive_files import sentence

LONGEST_S, MOST_MB, RATIO = 10.0, 1000.0, 12.0
SPEED, RATE_HZ, NOISE = 10.0, 50.0, 0.01
BEGIN = datetime(2026, 7, 1, tzinfo=UTC)

Rows = Iterator[tuple[float, float, float, float, float]]
"""Time (s), east, north (m), latitude and longitude (deg)."""

PROGRAM = """
import resource, sys
from scenarios.definition.check.findings import check
report = check(sys.argv[1])
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1000.0, report.points)
"""


def positions(count: int) -> Rows:
    """A road that winds with radii from 60 m on, on a large circle."""
    at = np.arange(count) / RATE_HZ
    s = SPEED * at
    yaw = s / 4000.0 + 1.2 * np.sin(s / 90.0) + 0.4 * np.sin(s / 31.0)
    noise = np.random.default_rng(1).normal(0.0, NOISE, (2, count))
    east = np.cumsum(np.cos(yaw)) * SPEED / RATE_HZ + noise[0]
    north = np.cumsum(np.sin(yaw)) * SPEED / RATE_HZ + noise[1]
    columns = (at, east, north, 48.1 + north / 111_200.0, 11.5 + east / 74_500.0)
    return zip(*(column.tolist() for column in columns), strict=True)


def csv(rows: Rows) -> Iterator[str]:
    yield "t_s,x_m,y_m,speed_mps"
    for t, x, y, _, _ in rows:
        yield f"{t:.2f},{x:.3f},{y:.3f},{SPEED}"


def gpx(rows: Rows) -> Iterator[str]:
    yield '<?xml version="1.0"?>\n<gpx version="1.1" creator="bench"><trk><trkseg>'
    for t, _, _, latitude, longitude in rows:
        at = (BEGIN + timedelta(seconds=t)).isoformat(timespec="milliseconds")
        yield (
            f'<trkpt lat="{latitude:.8f}" lon="{longitude:.8f}"><ele>500</ele>'
            f"<time>{at[:-6]}Z</time></trkpt>"
        )
    yield "</trkseg></trk></gpx>"


def nmea(rows: Rows) -> Iterator[str]:
    for t, _, _, latitude, longitude in rows:
        at = BEGIN + timedelta(seconds=t)
        place = f"48{60.0 * (latitude - 48.0):010.7f},N,011{60.0 * (longitude - 11.0):010.7f},E"
        clock = f"{at:%H%M%S}.{at.microsecond // 10_000:02d}"
        yield sentence(f"GNGGA,{clock},{place},4,12,0.8,500.0,M,40.0,M,,")
        yield sentence(f"GNRMC,{clock},A,{place},19.4384,90.0,{at:%d%m%y},,,A")


FORMATS: dict[str, Callable[[Rows], Iterator[str]]] = {"csv": csv, "gpx": gpx, "nmea": nmea}


def checked(folder: Path, form: str, count: int) -> tuple[float, float, int]:
    """Return processor time (s), peak memory (MB) and driven points of a check."""
    file = folder / f"drive.{form}"
    with file.open("w") as text:
        text.writelines(f"{line}\n" for line in FORMATS[form](positions(count)))
    scenario = folder / f"{form}.toml"
    scenario.write_text(
        f'name = "long"\n[path]\nkind = "trace"\nfile = "{file.name}"\n[speed]\nlead = "recorded"\n'
    )
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(scenario)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{form}, {count} points: {done.stderr.strip().splitlines()[-1]}")
    seconds, megabytes, points = done.stdout.split()
    return float(seconds), float(megabytes), int(points)


def rows(form: str, count: int) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        few, _, _ = checked(Path(name), form, count // 10)
        seconds, megabytes, points = checked(Path(name), form, count)
    start_s = timed_start()
    yield Row(f"{form}: time, s", f"{seconds:.2f}", f"{LONGEST_S:g}", seconds < LONGEST_S)
    yield Row(f"{form}: memory, MB", f"{megabytes:.0f}", f"{MOST_MB:g}", megabytes < MOST_MB)
    ratio = (seconds - start_s) / max(few - start_s, 1e-3)
    yield Row(f"{form}: time by that of a tenth", f"{ratio:.1f}", f"{RATIO:g}", ratio < RATIO)
    yield Row(f"{form}: points driven", f"{points}", f"{count}", points > 0.99 * count)


def timed_start() -> float:
    """Return the processor time (s) of a process that only imports `check`."""
    before = os.times()
    program = "import scenarios.definition.check.findings"
    subprocess.run([sys.executable, "-c", program], check=True)
    after = os.times()
    return (
        after.children_user
        + after.children_system
        - (before.children_user + before.children_system)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Cost of the check of long drives.")
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--formats", nargs="*", default=list(FORMATS), choices=list(FORMATS))
    given = parser.parse_args()
    loop_s = timed(plain_loop).processor_s
    print(f"yardstick: plain loop {loop_s:.2f} s")
    for form in given.formats:
        print_rows(f"{form} of {given.points} points", list(rows(form, given.points)))


if __name__ == "__main__":
    main()
