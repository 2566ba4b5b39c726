"""`convoy check`: the figures and warnings of a scenario or a recorded drive."""

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.text import Text

from scenarios.cli.output import grid_of
from scenarios.definition.check.drive_report import (
    DriveReport,
    PathFacts,
    drive_report,
    recording_warnings,
)
from scenarios.definition.check.findings import CheckReport, RequestedChannel, whole_report
from scenarios.definition.check.held_braking import TYRES
from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import is_drive
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.traces.drive import WRONG_TIME
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.results.figure_style import picture_format_of
from scenarios.results.files import json_text

Row = tuple[str, str]


# ---- The table of a scenario: figures that its file does not hold


def print_report(report: CheckReport, console: Console) -> None:
    title = f"{report.name}: {report.description}" if report.description else report.name
    console.print(Text(title, style="bold"), highlight=False)
    parts = (_convoy, _road, _weights, _channel)
    console.print(grid_of(row for part in parts for row in part(report)))


def _convoy(report: CheckReport) -> Iterator[Row]:
    yield "vehicles", ", ".join(report.vehicles)
    if report.gaps_m:  # more than one vehicle
        yield "gaps at the start", ", ".join(f"{gap:.4g}" for gap in report.gaps_m) + " m"
    for name, replay in report.replays.items():
        begun = f"from its time {replay['begun_s']:.1f} s, by {replay['clock']} times"
        off = f"path {100.0 * replay['deviation_m_max']:.1f} cm off its points at most"
        yield "replayed", f"{name}: {replay['file']}, {begun}, {off}"
    yield "duration, seed", f"{report.duration_s:.1f} s, {report.seed}"


def _road(report: CheckReport) -> Iterator[Row]:
    yield "length of the path", f"{report.path_length_m:.0f} m"
    yield "distance driven", f"{report.driven_m:.0f} m"
    yield "tightest radius", f"{report.radius_m_min:.1f} m" if report.radius_m_min else "straight"
    if report.deviation_m_rms is not None and report.deviation_m_max is not None:
        rms, largest = report.deviation_m_rms * 100, report.deviation_m_max * 100
        figures = f"{rms:.1f} cm rms, {largest:.1f} cm max"
        yield "deviation of the path", f"{figures} from the recorded points"
        yield from _drive(report)
    speeds = f"{report.speed_mps_min:.1f} to {report.speed_mps_max:.1f} m/s"
    yield "speed of the lead", f"{speeds} ({report.lead_speed})"
    forward, braking = report.acceleration_mps2_max, report.braking_mps2_max
    lateral = f"lateral up to {report.lateral_acceleration_mps2_max:.1f} m/s²"
    changes = f"up to {forward:.1f} m/s², braking up to {braking:.1f} m/s², {lateral}"
    yield "acceleration of the lead", changes
    if (held := report.held_braking) is not None:
        more = " or more" if held.simulated_mps2 >= TYRES else ""
        without = held.without_data_mps2.items()
        lost = ", ".join(f"{braking:.1f} for {silence} s" for silence, braking in without)
        yield (
            "braking of the lead held",
            f"{held.simulated_mps2:.1f} m/s²{more} from {held.speed_mps:.1f} m/s, simulated with "
            f"{len(held.vehicles)} cars without losses; if nothing is received from its onset on: "
            f"{lost}",
        )


def _drive(report: CheckReport) -> Iterator[Row]:
    size = "1 hole of" if report.holes == 1 else f"{report.holes} holes up to"
    holes = f", {size} {report.hole_m_max:.1f} m" if report.holes else ""
    noise = f"noise {100.0 * (report.noise_m or 0.0):.1f} cm"
    yield "recorded points", f"{report.points}, {noise}{holes}"
    yield "smoothing", f"{report.smoothing_m:g} m half width"
    left_out = {
        ("unusable", "unusable"): report.skipped_lines,
        ("jump", "jumps"): report.jumping_points,
        ("standing", "standing"): report.standing_points,
    }
    if any(left_out.values()):
        counts = (f"{count} {names[count != 1]}" for names, count in left_out.items() if count)
        yield "points left out", ", ".join(counts)
    if any(report.coordinates_offset_m or ()):
        east, north = report.coordinates_offset_m or (0.0, 0.0)
        yield "coordinates offset", f"{east:.0f} m east, {north:.0f} m north"


def _weights(report: CheckReport) -> Iterator[Row]:
    """Describe alpha* = 1 / ||G||_inf of followers that have data of the lead."""
    rows = [
        (
            name,
            f"{limit['largest_alpha_ratio']:.4f} at {limit['speed_mps']:.1f} m/s: errors fade from "
            "car to car with a smaller control.alpha_ratio, else those at "
            f"{limit['frequency_radps']:.1f} rad/s may grow",
        )
        for name, limit in report.largest_alpha.items()
    ]
    yield from _grouped("largest α", rows)


def _channel(report: CheckReport) -> Iterator[Row]:
    yield from _grouped(
        "requested channel",
        [(link, _channel_text(channel)) for link, channel in report.channel.items()],
    )


def _channel_text(channel: RequestedChannel) -> str:
    loss = "loss not predictable"
    if channel.loss_ratio is not None:
        bursts = channel.burst_messages
        in_row = f", {bursts:.3g} in a row" if bursts is not None else ""
        loss = f"loss {100.0 * channel.loss_ratio:.3g} %{in_row}"
    if channel.latency_ms_mean is None:
        return f"{loss}; delay not predictable"
    spread = f" ± {channel.latency_ms_deviation:.3g}" if channel.latency_ms_deviation else ""
    return f"{loss}; delay {channel.latency_ms_mean:.3g}{spread} ms"


def _grouped(heading: str, rows: Iterable[tuple[str, str]]) -> Iterator[Row]:
    """Yield a row for each distinct text, with the names to which it applies if not to all."""
    distinct: dict[str, list[str]] = {}
    for name, text in rows:
        distinct.setdefault(text, []).append(name)
    for text, names in distinct.items():
        yield heading, f"{text}: {', '.join(names)}" if len(distinct) > 1 else text


# ---- The table of `convoy check` for a recorded drive


MOST = 10
"""Number of holes, pauses and remarks that are listed."""


def print_drive(drive: DriveReport, report: CheckReport | None, console: Console) -> None:
    """Print the facts of a drive, and what a convoy can do with it, None if nothing."""
    title = ", ".join(filter(None, (drive.file, drive.format)))
    console.print(Text(title, style="bold"), highlight=False)
    waits = report is not None and report.lead_speed == "recorded"
    rows = [*_recording(drive, waits=waits), *_path(drive.path)]
    if report is not None:
        rows += _convoy_of_drive(report)
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


def _convoy_of_drive(report: CheckReport) -> Iterator[Row]:
    gaps = ", ".join(f"{gap:.4g}" for gap in report.gaps_m)
    yield "convoy", f"{', '.join(report.vehicles)}" + (f", gaps {gaps} m" if gaps else "")
    speeds = f"{report.speed_mps_min:.1f} to {report.speed_mps_max:.1f} m/s"
    lateral = f"up to {report.lateral_acceleration_mps2_max:.1f} m/s² in bends"
    yield "speed of the lead", f"{speeds} ({report.lead_speed}), {lateral}"


# ---- `convoy check`: report on a scenario or a recorded drive, and draw the drive


def check_scenario(
    name: str,
    overrides: Sequence[str],
    seed: int | None,
    *,
    output: Path | None,
    as_json: bool,
    resolved: bool,
) -> None:
    """Print figures and warnings, or the `resolved` scenario.

    Raises ScenarioError if the scenario is refused. What is known of a recorded drive is printed
    and drawn even then.
    """
    if output is not None:
        picture_format_of(output)
    drives: list[DriveInPlane] = []
    try:
        scenario = load_scenario(name, overrides, seed, on_drive=drives.append)
    except ScenarioError as error:
        if drives and is_drive(name):
            _report_refused(drives[0], error, as_json=as_json)
            _draw(drives[0], None, output, quiet=as_json)
        raise
    if resolved:
        click.echo(scenario.text, nl=False)
        return
    if output is not None and not drives:
        raise ScenarioError([f"{name}: its path is no recorded drive, which --output draws"])
    drive = drives[0] if drives else None
    _report(scenario, drive, whole=not is_drive(name), as_json=as_json)
    if drive is not None:
        _draw(drive, scenario, output, quiet=as_json)
    if is_drive(name) and not as_json:
        sets = [f"--set={text}" for text in overrides]
        seeds = [] if seed is None else [f"--seed={seed}"]
        command = ("convoy", "run", name, *sets, *seeds, "--clock", "virtual")
        click.echo(f"run it with: {shlex.join(command)}")


def _report_refused(drive: DriveInPlane, error: ScenarioError, *, as_json: bool) -> None:
    report = drive_report(drive, None)
    if as_json:
        click.echo(json_text({"drive": report, "errors": error.lines}), nl=False)
    else:
        print_drive(report, None, Console())


def _report(scenario: Scenario, drive: DriveInPlane | None, *, whole: bool, as_json: bool) -> None:
    """Print the `whole` table of a scenario, or that of its drive."""
    report = whole_report(scenario, drive)
    if as_json:
        click.echo(json_text(report), nl=False)
        return
    listed: set[str] = set()
    if report.drive is None or whole:
        print_report(report, Console())
    else:
        print_drive(report.drive, report, Console())
        listed = _listed_faults(scenario)
    for line in report.warnings:
        if line not in listed:
            click.echo(f"warning: {line}")


def _listed_faults(scenario: Scenario) -> set[str]:
    """Return the warnings that the table of a drive replaces."""
    table, road = scenario.tables.path, scenario.route.smoothed
    if not isinstance(table, PointsPath) or road is None:
        return set()
    return set(recording_warnings(table, road))


def _draw(
    drive: DriveInPlane, scenario: Scenario | None, output: Path | None, *, quiet: bool
) -> None:
    if output is None:
        return
    from scenarios.studies.drive_picture import draw_drive

    draw_drive(drive, scenario, output)
    if not quiet:
        click.echo(f"written: {output}")
