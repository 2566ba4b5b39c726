"""Times without a zone are UTC, whatever the zone of the machine."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.made.spoiled.drive_files import TABLES, gpx
from tests.made.spoiled.driven_paths import written
from tests.made.spoiled.synthetic_drives import STRAIGHT, Drive

ZONES = ("America/New_York", "Asia/Tokyo")

PROGRAM = """
import dataclasses, json, sys
from scenarios.definition.check.findings import check
for name in sys.argv[1:]:
    print(json.dumps(dataclasses.asdict(check(name)), default=str, sort_keys=True))
"""


@pytest.fixture
def scenarios(tmp_path: Path) -> list[str]:
    """Scenarios of files without zones, the second drive of each with a zone."""
    recording = Drive(road=STRAIGHT).recorded()
    written(tmp_path, "lead.gpx", gpx(recording, "iso"))
    written(tmp_path, "lead.csv", TABLES["zoneless geodetic csv"].write(recording))
    written(tmp_path, "second.gpx", gpx(recording))
    for name in ("gpx", "csv"):
        (tmp_path / f"{name}.toml").write_text(
            f'name = "zone"\n[path]\nkind = "trace"\nfile = "lead.{name}"\n'
            '[speed]\nlead = "recorded"\n[convoy]\nvehicles = 3\n'
            '[vehicle.v2]\nreplay = "second.gpx"\n'
        )
    return [str(tmp_path / f"{name}.toml") for name in ("gpx", "csv")]


def test_the_report_is_the_same_in_all_zones(scenarios: list[str]) -> None:
    started = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *scenarios],
            env={**os.environ, "TZ": zone},
            stdout=subprocess.PIPE,
            text=True,
        )
        for zone in ZONES
    ]
    first, second = (process.communicate(timeout=60)[0] for process in started)
    assert first == second
    reports = [json.loads(line) for line in first.splitlines()]
    assert len(reports) == len(scenarios)
    for report in reports:
        assert report["replays"]["v2"]["clock"] == "common"
        assert any("UTC" in warning for warning in report["warnings"])
