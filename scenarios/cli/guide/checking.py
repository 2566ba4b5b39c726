"""`convoy check`: report on a scenario or a recorded drive, and draw the drive."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click
from rich.console import Console

from scenarios.cli.guide.check_table import print_report
from scenarios.cli.guide.drive_table import print_drive
from scenarios.definition.check.drive_report import drive_report
from scenarios.definition.check.drive_warnings import recording_warnings
from scenarios.definition.check.findings import whole_report
from scenarios.definition.errors import ScenarioError, require
from scenarios.definition.library import is_drive
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.studies.picture_style import picture_format_of


def check_scenario(
    name: str,
    overrides: Sequence[str],
    seed: int | None,
    *,
    explain: bool,
    output: Path | None,
    as_json: bool,
) -> None:
    """Print figures and warnings; raises ScenarioError if the scenario is refused.

    What is known of a recorded drive is printed and drawn even if it is refused.
    """
    if output is not None:
        require("--output", "studies", "matplotlib")
        picture_format_of(output)
    drives: list[DriveInPlane] = []
    try:
        scenario = load_scenario(name, overrides, seed, on_drive=drives.append)
    except ScenarioError as error:
        if drives and is_drive(name):
            _report_refused(drives[0], error, as_json=as_json)
            _draw(drives[0], None, output, quiet=as_json)
        raise
    if output is not None and not drives:
        raise ScenarioError([f"{name}: its path is no recorded drive, which --output draws"])
    drive = drives[0] if drives else None
    as_json = as_json or explain
    _report(scenario, drive, whole=not is_drive(name), explain=explain, as_json=as_json)
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
        click.echo(json.dumps({"drive": asdict(report), "errors": error.lines}, indent=2))
    else:
        print_drive(report, None, Console())


def _report(
    scenario: Scenario, drive: DriveInPlane | None, *, whole: bool, explain: bool, as_json: bool
) -> None:
    report = whole_report(scenario, drive, explain=explain)
    if as_json:
        click.echo(json.dumps(asdict(report), indent=2))
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
