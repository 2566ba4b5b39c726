"""`convoy check`: the figures and warnings of a scenario or a recorded drive."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import click
from rich.console import Console
from rich.text import Text

from scenarios.cli.output import grid_of
from scenarios.definition.channel.build import ExpectedChannel
from scenarios.definition.check.drive_report import DriveReport, PathFacts, drive_report
from scenarios.definition.check.findings import CheckReport, whole_report
from scenarios.definition.check.held_braking import TYRES, HeldBraking
from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import is_drive
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.results.figure_style import picture_format_of
from scenarios.results.files import json_text

Row = tuple[str, str]


def print_report(report: CheckReport | None, drive: DriveReport | None, console: Console) -> None:
    """Print the facts of a drive, if any, and what a convoy can do with it, None if nothing."""
    titles: tuple[str, ...] = (drive.file, drive.format) if drive else ()
    if report is not None and not (drive and report.name == Path(drive.file).stem):
        titles = report.name, report.description
    console.print(Text(": ".join(filter(None, titles)), style="bold"), highlight=False)
    rows = [*_recording(drive), *_path(drive.path)] if drive else []
    if report is not None:
        rows += _convoy(report)
    console.print(grid_of(rows))


# ---- A convoy: figures that the file of the scenario does not hold


def _convoy(report: CheckReport) -> Iterator[Row]:
    yield "vehicles", ", ".join(report.vehicles)
    if report.gaps_m:  # more than one vehicle
        yield "gaps at the start", ", ".join(f"{gap:.4g}" for gap in report.gaps_m) + " m"
    for name, replay in report.replays.items():
        begun = f"from its time {replay['begun_s']:.1f} s, by {replay['clock']} times"
        off = f"path {100.0 * replay['deviation_m_max']:.1f} cm off its points at most"
        yield "replayed", f"{name}: {replay['file']}, {begun}, {off}"
    yield "duration, seed", f"{report.duration_s:.1f} s, {report.seed}"
    yield "length of the path", f"{report.path_length_m:.0f} m"
    yield "distance driven", f"{report.driven_m:.0f} m"
    yield "tightest radius", f"{report.radius_m_min:.1f} m" if report.radius_m_min else "straight"
    speeds = f"{report.speed_mps_min:.1f} to {report.speed_mps_max:.1f} m/s"
    yield "speed of the lead", f"{speeds} ({report.lead_speed})"
    yield (
        "acceleration of the lead",
        f"up to {report.acceleration_mps2_max:.1f} m/s², braking up to "
        f"{report.braking_mps2_max:.1f} m/s², lateral up to "
        f"{report.lateral_acceleration_mps2_max:.1f} m/s²",
    )
    if report.held_braking is not None:
        yield "braking of the lead held", _held(report.held_braking)
    alphas = {
        name: f"{limit['largest_alpha_ratio']:.4f} at {limit['speed_mps']:.1f} m/s: errors fade "
        "from car to car with a smaller control.alpha_ratio, else those at "
        f"{limit['frequency_radps']:.1f} rad/s may grow"
        for name, limit in report.largest_alpha.items()
    }
    yield from _grouped("largest α", alphas)
    channels = {link: _channel(channel) for link, channel in report.channel.items()}
    yield from _grouped("requested channel", channels)


def _held(held: HeldBraking) -> str:
    without = held.without_data_mps2.items()
    return (
        f"{held.simulated_mps2:.1f} m/s²{' or more' if held.simulated_mps2 >= TYRES else ''} from "
        f"{held.speed_mps:.1f} m/s, simulated with {len(held.vehicles)} cars without losses; if "
        "nothing is received from its onset on: "
        + ", ".join(f"{braking:.1f} for {silence} s" for silence, braking in without)
    )


def _channel(channel: ExpectedChannel) -> str:
    loss, delay = "loss not predictable", "delay not predictable"
    if channel.loss_ratio is not None:
        bursts = channel.burst_messages
        in_row = f", {bursts:.3g} in a row" if bursts is not None else ""
        loss = f"loss {100.0 * channel.loss_ratio:.3g} %{in_row}"
    if channel.latency_ms_mean is not None:
        spread = f" ± {channel.latency_ms_deviation:.3g}" if channel.latency_ms_deviation else ""
        delay = f"delay {channel.latency_ms_mean:.3g}{spread} ms"
    return f"{loss}; {delay}"


def _grouped(heading: str, texts: Mapping[str, str]) -> Iterator[Row]:
    """Yield a row for each distinct text, with the names to which it applies if not to all."""
    distinct = dict.fromkeys(texts.values())
    for text in distinct:
        names = ", ".join(name for name, other in texts.items() if other == text)
        yield heading, f"{text}: {names}" if len(distinct) > 1 else text


# ---- A recorded drive


def _recording(drive: DriveReport) -> Iterator[Row]:
    if drive.begins_at:
        begin = drive.begins_at.replace("T", " ").removesuffix("Z").removesuffix(".000")
        yield "begins at", f"{begin} UTC"
    if drive.from_m > 0.0:
        since = f"{drive.from_s:.1f} s and " if drive.duration_s is not None else ""
        yield "part", f"from {since}{drive.from_m:.1f} m of the recording on"
    rate = f" at {drive.rate_hz:.4g} Hz" if drive.rate_hz else ""
    lasts = "no times" if drive.duration_s is None else f"{drive.duration_s:.1f} s{rate}"
    yield "recorded", f"{lasts}, {drive.length_m:.1f} m"
    noise = f"noise {100.0 * drive.noise_m:.1f} cm"
    yield "points", f"{drive.points} of {drive.records} records, {noise}"
    yield "recorded speed", _speed(drive)


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
    if path.radius_m_min is not None and path.bend_speed_mps_max is not None:
        is_too_tight = path.radius_m_min < path.turning_radius_m
        yield (
            "tightest bend",
            f"radius {path.radius_m_min:.1f} m at {path.at_m:.0f} m, up to "
            f"{path.bend_speed_mps_max:.1f} m/s in it; {'too tight, ' * is_too_tight}cars turn at "
            f"{path.turning_radius_m:.1f} m",
        )


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
    _report(scenario, drives[0] if drives else None, as_json=as_json)
    if drives:
        _draw(drives[0], scenario, output, quiet=as_json)
    if is_drive(name) and not as_json:
        sets = [f"--set={text}" for text in overrides]
        seeds = [] if seed is None else [f"--seed={seed}"]
        command = ("convoy", "run", name, *sets, *seeds, "--clock", "virtual")
        click.echo(f"run it with: {shlex.join(command)}")


def _report_refused(drive: DriveInPlane, error: ScenarioError, *, as_json: bool) -> None:
    facts = drive_report(drive, None)
    if as_json:
        click.echo(json_text({"drive": facts, "errors": error.lines}), nl=False)
    else:
        print_report(None, facts, Console())


def _report(scenario: Scenario, drive: DriveInPlane | None, *, as_json: bool) -> None:
    report = whole_report(scenario, drive)
    if as_json:
        click.echo(json_text(report), nl=False)
        return
    print_report(report, report.drive, Console())
    for line in report.warnings:
        click.echo(f"warning: {line}")


def _draw(
    drive: DriveInPlane, scenario: Scenario | None, output: Path | None, *, quiet: bool
) -> None:
    if output is None:
        return
    from scenarios.studies.drive_picture import draw_drive

    draw_drive(drive, scenario, output)
    if not quiet:
        click.echo(f"written: {output}")
