"""A virtual run that is killed leaves a log that can be read and repaired."""

import subprocess
import sys
from pathlib import Path

from tests.system.logs import Run, assert_sound
from tests.system.processes import until
from transport.log.mcap_file import repair
from transport.log.reader import LogReader

ENOUGH_BYTES = 1_000_000


def test_a_killed_virtual_run_keeps_what_it_had_written(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scenarios.cli", "run", "highway", "--clock=virtual"]
    log = tmp_path / "run" / "run.mcap"
    with subprocess.Popen([*command, "--quiet", "--out=run"], cwd=tmp_path) as process:
        try:
            until(lambda: log.exists() and log.stat().st_size > ENOUGH_BYTES)
        finally:
            process.kill()
    reader = LogReader(log)
    assert reader.truncated
    assert not reader.damage
    held = sum(1 for _ in reader.messages())
    assert held > 1000
    assert repair(log)
    assert_sound(log)
    assert len(Run(tmp_path / "run").messages) == held
