"""Run folders that two runs share, on a full disk, and with a removed log."""

import errno
import os
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest

from scenarios.results.files import LOG_NAME
from tests.system.logs import Run, assert_nothing_missing, assert_sound
from tests.system.processes import start
from transport.log.reader import LogReader

DURATION_S = 1.0
SHORT = (
    *("run", "lane_change", "--quiet"),
    *("--set=convoy.vehicles=2", f"--set=duration_s={DURATION_S}"),
)


def test_the_second_of_two_runs_into_one_folder_is_refused(tmp_path: Path) -> None:
    arguments = (*SHORT, "--out", tmp_path / "run")
    with start(*arguments, folder=tmp_path) as first, start(*arguments, folder=tmp_path) as second:
        winner, loser = sorted((first, second), key=lambda process: process.wait())
        assert (winner.wait(), loser.wait()) == (0, 2), (winner.err, loser.err)
        assert len(loser.lines()) == 1
        assert str(tmp_path / "run") in loser.err
    run = Run(tmp_path / "run")
    assert_sound(run.log)
    assert_nothing_missing(run, DURATION_S)


LONG = ("run", "lane_change", "--set=convoy.vehicles=2", "--set=duration_s=30")


def test_a_run_fails_immediately_if_its_log_is_removed(tmp_path: Path) -> None:
    log = tmp_path / "run" / LOG_NAME
    with start(*LONG, "--out", log.parent, folder=tmp_path) as convoy:
        convoy.drive(0.5)
        log.unlink()
        assert convoy.ends_in_time()
        assert convoy.wait() == 1
        assert "Traceback" not in convoy.err
    reason = Run(log.parent).summary["reason"]
    assert reason.startswith(f"{log}: ")
    assert reason.endswith(os.strerror(errno.ENOENT))
    assert reason in convoy.out


def test_a_run_on_a_full_disk_fails_with_a_readable_log(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "none", str(disk)],
        capture_output=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip("mounting a file system is not permitted")
    try:
        with start(*LONG, "--out", disk / "run", folder=tmp_path) as convoy:
            convoy.drive(1.0)
            with suppress(OSError), (disk / "filler").open("wb", buffering=0) as filler:
                while filler.write(bytes(4096)):
                    pass
            assert convoy.ends_in_time()
            assert convoy.wait() == 1
            assert f"{disk / 'run' / LOG_NAME}: " in convoy.out
            assert os.strerror(errno.ENOSPC) in convoy.out
            assert "Traceback" not in convoy.err
        log = LogReader(disk / "run" / LOG_NAME)
        assert log.truncated
        assert not log.damage
        assert sum(log.counts.values()) > 100
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_runs_started_in_the_same_second_use_separate_folders(tmp_path: Path) -> None:
    with start(*SHORT, folder=tmp_path) as first, start(*SHORT, folder=tmp_path) as second:
        assert (first.wait(), second.wait()) == (0, 0), (first.err, second.err)
    folders = list((tmp_path / "runs").iterdir())
    assert len(folders) == 2
    for folder in folders:
        assert_sound(Run(folder).log)
