"""Two runs that are given one folder, and what becomes of the log of the first."""

from pathlib import Path

from tests.system.logs import Run, assert_nothing_missing, assert_sound
from tests.system.processes import start

DURATION_S = 3.0
SHORT = ("run", "lane_change", "--set=convoy.vehicles=2", f"--set=duration_s={DURATION_S}")


def test_of_two_runs_into_one_folder_one_is_refused_and_the_other_is_whole(tmp_path: Path) -> None:
    arguments = (*SHORT, "--out", tmp_path / "run")
    with start(*arguments, folder=tmp_path) as one, start(*arguments, folder=tmp_path) as other:
        winner, loser = sorted((one, other), key=lambda process: process.wait())
        assert (winner.wait(), loser.wait()) == (0, 2), (winner.err, loser.err)
        assert len(loser.lines()) == 1
        assert str(tmp_path / "run") in loser.err
    run = Run(tmp_path / "run")
    assert_sound(run.log)
    assert_nothing_missing(run, DURATION_S)


def test_two_runs_of_the_same_second_have_folders_of_their_own(tmp_path: Path) -> None:
    with start(*SHORT, folder=tmp_path) as one, start(*SHORT, folder=tmp_path) as other:
        assert (one.wait(), other.wait()) == (0, 0), (one.err, other.err)
    folders = list((tmp_path / "runs").iterdir())
    assert len(folders) == 2
    for folder in folders:
        assert_sound(Run(folder).log)
