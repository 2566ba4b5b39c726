"""Damaged files are driven or refused in one line, in a few seconds and within 1 GB."""

import resource
import time
from pathlib import Path
from random import Random

import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.errors import ScenarioError
from tests.made.spoiled.drive_files import WRITERS
from tests.made.spoiled.driven_paths import load, written
from tests.made.spoiled.file_faults import damaged
from tests.made.spoiled.synthetic_drives import BEND, LOOP, S_BEND, U_TURN, Drive

LONGEST_S = 10.0
MOST_KB = 1_000_000


@pytest.mark.campaign(25, 300)
def test_a_damaged_file_is_driven_or_refused_in_lines(tmp_path: Path, case: int) -> None:
    random = Random(case)
    form = sorted(WRITERS)[case % len(WRITERS)]
    suffix, write = WRITERS[form]
    drive = Drive(
        road=random.choice((BEND, LOOP, S_BEND, U_TURN)),
        rate_hz=random.choice((1.0, 5.0, 10.0, 20.0)),
        noise=random.choice((0.0, 0.03)),
    )
    data = damaged(write(drive.recorded()), random)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.monotonic()
    lines: tuple[str, ...] = ()
    try:
        scenario = load(tmp_path, written(tmp_path, f"damaged{suffix}", data))
        lines = report_of(scenario).warnings
    except ScenarioError as error:
        lines = tuple(error.lines)
    assert all(line.isprintable() and len(line) < 2000 for line in lines)
    assert time.monotonic() - begun < LONGEST_S
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_KB
