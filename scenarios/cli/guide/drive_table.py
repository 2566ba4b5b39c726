"""The table of `convoy check` for a recorded drive."""

from collections.abc import Iterator

from rich.console import Console
from rich.text import Text

from scenarios.cli.columns import grid_of
from scenarios.cli.guide.check_table import Row
from scenarios.definition.check.drive_report import DriveReport, PathFacts
from scenarios.definition.check.findings import CheckReport
from scenarios.definition.traces.recorded_drive import WRONG_TIME

MOST = 10
"""Number of holes, pauses and remarks that are listed."""


def print_drive(drive: DriveReport, report: CheckReport | None, console: Console) -> None:
    """Print the facts of a drive, and what a convoy can do with it, None if nothing."""
    title = ", ".join(filter(None, (drive.file, drive.format)))
    console.print(Text(title, style="bold"), highlight=False)
    waits = report is not None and report.lead_speed == "recorded"
    rows = [*_recording(drive, waits=waits), *_path(drive.path)]
    if report is not None:
        rows += _convoy(report)
    console.print(grid_of(rows))


def _recording(drive: DriveReport, *, waits: bool) -> Iterator[Row]:
    """Describe the recording; `waits` if the lead drives at recorded speed, pauses included."""
    if drive.begins_at:
        begin = drive.begins_at.replace("T", " ").removesuffix("Z").removesuffix(".000")
        yield "begins at", f"{begin} UTC"
    if drive.from_m > 0.0:
        since = f"{drive.from_s:.1f} s and " if drive.duration_s is not None else ""
        yield "part", f"from {since}{drive.from_m:.1f} m of the recording on"
    yield "duration", "no times" if drive.duration_s is None else _duration(drive)
    yield "length", f"{drive.length_m:.1f} m"
    yield "points", f"{drive.points} of {drive.records} records, {_noise(drive.noise_m)}"
    yield "speed", _speed(drive)
    holes = [
        f"{hole.length_m:.1f} m at {hole.at_m:.0f} m, after {hole.after}" for hole in drive.holes
    ]
    yield from _listed("hole", holes)
    pauses = [
        f"{pause.lasts_s:.1f} s at {pause.at_m:.0f} m, after {pause.after}"
        + (", cut" if pause.is_cut else "")
        for pause in drive.pauses
    ]
    yield from _listed("pause", pauses)
    if waits and any(not pause.is_cut for pause in drive.pauses):
        yield "", 'the lead waits there; path.pauses = "cut" leaves the time out'
    if drive.left_out:
        counts = {kind: n for kind, n in drive.left_out.items() if kind != WRONG_TIME}
        if counts:
            yield "left out", ", ".join(f"{kind}: {count}" for kind, count in counts.items())
        if wrong := drive.left_out.get(WRONG_TIME):
            yield "corrected", f"{WRONG_TIME}: {wrong}"
        yield from (("", line) for line in drive.left_out_first)
    yield from _listed("note", drive.remarks)


def _duration(drive: DriveReport) -> str:
    duration, rate = f"{drive.duration_s:.1f} s", drive.rate_hz
    if not rate:
        return duration
    return f"{duration} at {rate:.4g} Hz" if rate >= 1.0 else f"{duration}, every {1 / rate:.4g} s"


def _listed(what: str, lines: list[str] | tuple[str, ...]) -> Iterator[Row]:
    yield from ((what, line) for line in lines[:MOST])
    if len(lines) > MOST:
        yield "", f"and {len(lines) - MOST} more"


def _noise(noise_m: float) -> str:
    return f"noise {100.0 * noise_m:.1f} cm"


def _speed(drive: DriveReport) -> str:
    if drive.speed_mps_min is None or drive.speed_mps_max is None:
        return "not recorded"
    mean = f", mean {drive.speed_mps_mean:.1f} m/s" if drive.speed_mps_mean is not None else ""
    source = "recorded" if drive.speed_source == "recorded" else "from the recorded times"
    return f"{drive.speed_mps_min:.1f} to {drive.speed_mps_max:.1f} m/s{mean} ({source})"


def _path(path: PathFacts | None) -> Iterator[Row]:
    if path is None:
        return
    rms, largest = 100.0 * path.deviation_m_rms, 100.0 * path.deviation_m_max
    off = f"{rms:.1f} cm rms, {largest:.1f} cm max off the points"
    yield "path", f"smoothed over {path.smoothing_m:g} m to either side, {off}"
    if path.radius_m_min is None or path.bend_speed_mps_max is None:
        yield "tightest bend", "none, the road is straight"
        return
    fits = path.radius_m_min >= path.turning_radius_m
    yield (
        "tightest bend",
        f"radius {path.radius_m_min:.1f} m at {path.at_m:.0f} m, up to "
        f"{path.bend_speed_mps_max:.1f} m/s in it; "
        + ("cars turn at " if fits else "too tight, cars turn at ")
        + f"{path.turning_radius_m:.1f} m",
    )


def _convoy(report: CheckReport) -> Iterator[Row]:
    gaps = ", ".join(f"{gap:.4g}" for gap in report.gaps_m)
    yield "convoy", f"{', '.join(report.vehicles)}" + (f", gaps {gaps} m" if gaps else "")
    speeds = f"{report.speed_mps_min:.1f} to {report.speed_mps_max:.1f} m/s"
    lateral = f"up to {report.lateral_acceleration_mps2_max:.1f} m/s² in bends"
    yield "speed of the lead", f"{speeds} ({report.lead_speed}), {lateral}"
