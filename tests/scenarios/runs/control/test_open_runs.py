"""The runs of this machine: found while they go on, and not longer, however they end."""

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

from scenarios.runs.open_runs import OpenRun, announced, open_runs

ONE = OpenRun("one", "tcp/127.0.0.1:7001", "/runs/one")
TWO = OpenRun("two", "tcp/127.0.0.1:7002", "/runs/two")


def test_a_run_is_found_while_it_goes_on(tmp_path: Path) -> None:
    assert open_runs(tmp_path / "nowhere") == []
    with announced(TWO, tmp_path / "open"):
        with announced(ONE, tmp_path / "open"):
            assert open_runs(tmp_path / "open") == [ONE, TWO]
        assert open_runs(tmp_path / "open") == [TWO]
    assert open_runs(tmp_path / "open") == []
    assert list((tmp_path / "open").iterdir()) == []
    assert (tmp_path / "open").stat().st_mode & 0o077 == 0


def test_files_of_a_killed_run_are_removed(tmp_path: Path) -> None:
    program = textwrap.dedent(f"""
        import time
        from pathlib import Path
        from scenarios.runs.open_runs import OpenRun, announced
        with announced(OpenRun("one", "tcp/127.0.0.1:7001", "/runs/one"), Path({str(tmp_path)!r})):
            print("there", flush=True)
            time.sleep(60)
    """)
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        assert open_runs(tmp_path) == [ONE]
        process.send_signal(signal.SIGKILL)
    assert len(list(tmp_path.glob("*.json"))) == 1
    assert open_runs(tmp_path) == []
    assert list(tmp_path.glob("*.json")) == []
