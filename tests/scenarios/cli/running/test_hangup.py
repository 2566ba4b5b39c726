import json
import os
import pty
import sys
from pathlib import Path

from scenarios.results.files import SUMMARY_NAME
from scenarios.runs.stop import EXIT_FAILED

RUN = ("run", "lane_change", "--clock", "virtual", "--set", "duration_s=3")


def test_a_run_goes_on_without_its_terminal_and_its_exit_code_tells(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    pid, terminal = pty.fork()
    if pid == 0:
        command = [sys.executable, "-m", "scenarios.cli", *RUN, "--out", str(folder)]
        os.execv(sys.executable, command)
    assert b"writes" in os.read(terminal, 1024)
    os.close(terminal)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == EXIT_FAILED  # its tables were not printed
    summary = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))
    assert summary["outcome_line"].startswith("OK: 4 vehicles, 3.0 s, ")
