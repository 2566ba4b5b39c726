"""A journal that was cut or damaged anywhere never gives other results; the rest is read."""

import json
import tempfile
from contextlib import AbstractContextManager
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine.journal import JOURNAL, RunJournal
from scenarios.studies.engine.journal import open_journal as open_reporting

ASKED = {"--seeds": 3, "--vary": ["a=1,2"]}
FLOATS = st.floats(allow_nan=False, allow_infinity=False)


def open_journal(folder: Path, asked: dict[str, Any]) -> AbstractContextManager[RunJournal]:
    return open_reporting(folder, asked, pytest.fail)


def refused(folder: Path, asked: dict[str, Any]) -> str:
    with pytest.raises(ScenarioError) as error, open_journal(folder, asked):
        pass
    (line,) = error.value.lines
    return line


@given(values=st.lists(FLOATS, min_size=1, max_size=6), data=st.data())
def test_cut_at_any_byte_it_goes_on(values: list[float], data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with open_journal(folder, ASKED) as journal:
            for number, value in enumerate(values):
                journal.add(str(number), {"figure": value})
        path = folder / JOURNAL
        whole = path.read_bytes()
        cut = data.draw(st.integers(0, len(whole)))
        path.write_bytes(whole[:cut])
        kept = max(whole[:cut].count(b"\n") - 1, 0)
        wanted = {str(k): {"figure": value} for k, value in enumerate(values[:kept])}
        with open_journal(folder, ASKED) as journal:
            assert journal.entries == wanted
            for number, value in enumerate(values[kept:], start=kept):
                journal.add(str(number), {"figure": value})
        assert path.read_bytes() == whole


def test_each_line_is_there_at_once(tmp_path: Path) -> None:
    with open_journal(tmp_path, ASKED) as journal:
        journal.add("0/1", {"figure": 0.1})
        lines = (tmp_path / JOURNAL).read_text().splitlines()
        assert json.loads(lines[-1]).items() >= {"run": "0/1", "entry": {"figure": 0.1}}.items()


def test_of_two_lines_of_one_run_the_later_counts(tmp_path: Path) -> None:
    with open_journal(tmp_path, ASKED) as journal:
        journal.add("0/1", {"error": "died"})
        journal.add("0/1", {"figure": 1.0})
    with open_journal(tmp_path, ASKED) as journal:
        assert journal.entries == {"0/1": {"figure": 1.0}}


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"--seeds": 4}, "--seeds: 3 there, 4 now; give"),
        ({"--limit": ["lane"]}, '--limit: null there, ["lane"] now; give'),
        ({"--vary": ["a=1"], "--seeds": 1}, '3 there, 1 now; --vary: ["a=1,2"] there, ["a=1"] now'),
        ({"--vary": ["a=" + "1" * 99]}, "--vary: not the same; give"),
    ],
)
def test_another_question_is_refused_with_what_differs(
    asked: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with open_journal(tmp_path, ASKED) as journal:
        journal.add("0/1", {})
    before = (tmp_path / JOURNAL).read_bytes()
    assert said in refused(tmp_path, ASKED | asked)
    assert (tmp_path / JOURNAL).read_bytes() == before


def test_a_question_without_answers_gives_way_to_another(tmp_path: Path) -> None:
    for asked in (ASKED, {"--seeds": 9}):
        with open_journal(tmp_path, asked) as journal:
            assert not journal.entries
        assert (tmp_path / JOURNAL).read_bytes().count(b"\n") == 1


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    with open_journal(tmp_path, ASKED):
        assert "another command writes into this folder" in refused(tmp_path, ASKED)


# ---- Damage


def small_journal(folder: Path, asked: dict[str, Any] = ASKED) -> bytes:
    """Write a journal of two jobs; its bytes."""
    with open_journal(folder, asked) as journal:
        journal.add("0/1", {"figure": 0.25})
        journal.add("0/2", {"error": "v2 failed"})
        wanted = dict(journal.entries)
    assert wanted == WANTED
    return (folder / JOURNAL).read_bytes()


WANTED: dict[str, dict[str, Any]] = {"0/1": {"figure": 0.25}, "0/2": {"error": "v2 failed"}}


def check_redone(folder: Path, line_of_damage: int | None) -> None:
    """Open a damaged journal: no other entries, the damage named once, and none left after that."""
    said: list[str] = []
    with open_reporting(folder, ASKED, said.append) as journal:
        assert journal.entries.items() <= WANTED.items()
        missing = WANTED.keys() - journal.entries.keys()
        if line_of_damage is not None:
            (line,) = said
            start = f"{folder / JOURNAL}, line {line_of_damage}: damaged"
            assert line.startswith(start)
        assert len(missing) <= 2
        for key in missing:
            journal.add(key, WANTED[key])
    with open_journal(folder, ASKED) as journal:
        assert journal.entries == WANTED


def test_every_flipped_bit_costs_one_job_at_most_and_changes_no_result(tmp_path: Path) -> None:
    whole = small_journal(tmp_path)
    path = tmp_path / JOURNAL
    ends = [place for place, byte in enumerate(whole) if byte == ord("\n")]
    for place, bit in product(range(len(whole)), range(8)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << bit
        path.write_bytes(damaged)
        is_end = place in ends or damaged[place] == ord("\n")
        line = whole[:place].count(b"\n") + 1
        check_redone(tmp_path, None if is_end else line)


@given(cut=st.integers(0, 400), length=st.integers(1, 60), data=st.data())
def test_overwritten_bytes_change_no_result(cut: int, length: int, data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = small_journal(folder)
        at = cut % len(whole)
        noise = data.draw(st.binary(min_size=length, max_size=length))
        header_is_whole = at > whole.index(b"\n")
        damaged = whole[:at] + noise + whole[at + length :]
        (folder / JOURNAL).write_bytes(damaged)
        try:
            with open_reporting(folder, ASKED, print) as journal:
                assert journal.entries.items() <= WANTED.items()
                refusal = ""
        except ScenarioError as error:
            refusal = str(error)
        if refusal:  # nothing shows any more what its lines answer
            assert not header_is_whole
            assert "line 1: damaged" in refusal


def test_a_line_of_another_question_is_damage(tmp_path: Path) -> None:
    """Even if its checksum was right where it came from."""
    other = small_journal(tmp_path / "other", {"--seeds": 9}).splitlines(keepends=True)
    lines = small_journal(tmp_path / "this").splitlines(keepends=True)
    (tmp_path / "this" / JOURNAL).write_bytes(b"".join([lines[0], other[1], lines[2]]))
    check_redone(tmp_path / "this", 2)


def test_a_damaged_question_is_written_again_and_its_answers_are_kept(tmp_path: Path) -> None:
    whole = small_journal(tmp_path)
    (tmp_path / JOURNAL).write_bytes(whole.replace(b"--vary", b"--very"))
    check_redone(tmp_path, 1)
    assert "--seeds: 3 there, 4 now" in refused(tmp_path, ASKED | {"--seeds": 4})


def test_answers_to_a_lost_question_are_not_overwritten(tmp_path: Path) -> None:
    whole = small_journal(tmp_path, {"--seeds": 9}).replace(b"--seeds", b"--seedy")
    (tmp_path / JOURNAL).write_bytes(whole)
    assert f"{tmp_path / JOURNAL}, line 1: damaged; give another folder" in refused(tmp_path, ASKED)
    assert (tmp_path / JOURNAL).read_bytes() == whole


def test_the_journal_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_text('{"schema":"convoy.journal/0"}\n{"run":"0/1"}\n')
    assert "schema: given convoy.journal/0" in refused(tmp_path, ASKED)
