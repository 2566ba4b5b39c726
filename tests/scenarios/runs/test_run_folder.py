"""A folder is taken by one run at a time, and given back however that ends."""

import errno
import re
import signal
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.runs import run_folder
from scenarios.runs.run_folder import claimed, default_folder, is_claimed

HOLDER = """
import sys, time
from pathlib import Path
from scenarios.runs.run_folder import claimed

with claimed(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60.0)
"""
INTERRUPTED = f"""
from scenarios.runs.stop import end_on_signals
end_on_signals(report=False)
{HOLDER}"""


def test_runs_of_the_same_second_get_folders_of_their_own(tmp_path: Path) -> None:
    now = datetime(2026, 1, 2, 3, 4, 5)
    names = [default_folder("highway", now, tmp_path / "runs").name for _ in range(3)]
    first = "20260102-030405-highway"
    assert names == [first, f"{first}-2", f"{first}-3"]
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == names


def test_a_held_folder_is_refused_to_others_until_its_holder_ends(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True
    )
    with holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with (
            pytest.raises(ScenarioError, match=re.escape(f"{folder}: another run writes")),
            claimed(folder),
        ):
            pass
        holder.send_signal(signal.SIGKILL)
    with claimed(folder):
        assert list(folder.iterdir()) == []


def test_a_folder_with_a_log_or_a_summary_is_refused(tmp_path: Path) -> None:
    for name in ("run.mcap", "summary.json"):
        folder = tmp_path / name.partition(".")[0]
        folder.mkdir()
        (folder / name).write_text("precious")
        with (
            pytest.raises(ScenarioError, match=re.escape(f"{folder / name}: exists")),
            claimed(folder),
        ):
            pass
        assert (folder / name).read_text() == "precious"


def test_a_signal_leaves_no_empty_folder_that_was_made(tmp_path: Path) -> None:
    made, there, used = tmp_path / "made", tmp_path / "there", tmp_path / "used"
    there.mkdir()
    for folder in (made, there, used):
        holder = subprocess.Popen(
            [sys.executable, "-c", INTERRUPTED, str(folder)], stdout=subprocess.PIPE, text=True
        )
        with holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "held\n"
            if folder is used:
                (folder / "run.mcap").touch()
            holder.send_signal(signal.SIGINT)
        assert holder.returncode == 130
    assert not made.exists()
    assert there.exists()
    assert used.exists()


def test_a_folder_without_room_is_refused_before_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(**_: Any) -> Any:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(run_folder, "TemporaryFile", full)
    with pytest.raises(OSError, match="No space left") as refused, claimed(tmp_path / "run"):
        pass
    assert refused.value.filename == str(tmp_path / "run")


def test_only_a_folder_that_was_made_and_stayed_empty_is_removed(tmp_path: Path) -> None:
    made, there, used = tmp_path / "made", tmp_path / "there", tmp_path / "used"
    there.mkdir()
    for folder in (made, there, used):
        with claimed(folder):
            if folder is used:
                (folder / "run.mcap").touch()
    assert not made.exists()
    assert there.exists()
    assert used.exists()


def test_a_folder_is_claimed_while_a_run_writes_into_it(tmp_path: Path) -> None:
    assert not is_claimed(tmp_path)
    with claimed(tmp_path):
        assert is_claimed(tmp_path)
    assert not is_claimed(tmp_path)
