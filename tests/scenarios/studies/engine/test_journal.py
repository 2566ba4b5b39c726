"""A truncated or damaged journal never changes results; its intact lines are used."""

import tempfile
from contextlib import AbstractContextManager
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine import JOURNAL, RunJournal
from scenarios.studies.engine import open_journal as open_reporting

IDENTITY = {"--seeds": 3, "--vary": ["a=1,2"]}
FLOATS = st.floats(allow_nan=False, allow_infinity=False)


def open_journal(folder: Path, identity: dict[str, Any]) -> AbstractContextManager[RunJournal]:
    return open_reporting(folder, identity, pytest.fail)


def refused(folder: Path, identity: dict[str, Any]) -> str:
    with pytest.raises(ScenarioError) as error, open_journal(folder, identity):
        pass
    (line,) = error.value.lines
    return line


@given(values=st.lists(FLOATS, min_size=1, max_size=6), data=st.data())
def test_a_journal_truncated_at_any_byte_resumes(values: list[float], data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with open_journal(folder, IDENTITY) as journal:
            for number, value in enumerate(values):
                journal.add(str(number), {"figure": value})
        path = folder / JOURNAL
        whole = path.read_bytes()
        cut = data.draw(st.integers(0, len(whole)))
        path.write_bytes(whole[:cut])
        kept = max(whole[:cut].count(b"\n") - 1, 0)
        wanted = {str(k): {"figure": value} for k, value in enumerate(values[:kept])}
        with open_journal(folder, IDENTITY) as journal:
            assert journal.entries == wanted
            for number, value in enumerate(values[kept:], start=kept):
                journal.add(str(number), {"figure": value})
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("identity", "fact"),
    [
        ({"--seeds": 4}, "--seeds: 3 "),
        ({"--limit": ["lane"]}, "--limit: null "),
        ({"--vary": ["a=1"], "--seeds": 1}, '--vary: ["a=1,2"] '),
        ({"--vary": ["a=" + "1" * 99]}, "--vary: "),
    ],
)
def test_another_study_is_refused_with_the_differences(
    identity: dict[str, Any], fact: str, tmp_path: Path
) -> None:
    with open_journal(tmp_path, IDENTITY) as journal:
        journal.add("0/1", {})
    before = (tmp_path / JOURNAL).read_bytes()
    assert fact in refused(tmp_path, IDENTITY | identity)
    assert (tmp_path / JOURNAL).read_bytes() == before


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    with open_journal(tmp_path, IDENTITY):
        assert refused(tmp_path, IDENTITY).startswith(f"{tmp_path}: in use")


# ---- Damage


def small_journal(folder: Path, identity: dict[str, Any] = IDENTITY) -> bytes:
    with open_journal(folder, identity) as journal:
        journal.add("0/1", {"figure": 0.25})
        journal.add("0/2", {"error": "v2 failed"})
        wanted = dict(journal.entries)
    assert wanted == WANTED
    return (folder / JOURNAL).read_bytes()


WANTED: dict[str, dict[str, Any]] = {"0/1": {"figure": 0.25}, "0/2": {"error": "v2 failed"}}


def check_repaired(folder: Path, line_of_damage: int | None) -> None:
    """Open a damaged journal, add what is missing, and open it again."""
    lines: list[str] = []
    with open_reporting(folder, IDENTITY, lines.append) as journal:
        assert journal.entries.items() <= WANTED.items()
        missing = WANTED.keys() - journal.entries.keys()
        if line_of_damage is not None:
            (line,) = lines
            start = f"{folder / JOURNAL}, line {line_of_damage}: damaged"
            assert line.startswith(start)
        assert len(missing) <= 2
        for key in missing:
            journal.add(key, WANTED[key])
    with open_reporting(folder, IDENTITY, lines.append) as journal:
        assert journal.entries == WANTED


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
            with open_reporting(folder, IDENTITY, print) as journal:
                assert journal.entries.items() <= WANTED.items()
                refusal = ""
        except ScenarioError as error:
            refusal = str(error)
        if refusal:  # the identity of its lines is lost
            assert not header_is_whole
            assert "line 1: damaged" in refusal


def test_the_entries_after_a_damaged_identity_are_kept(tmp_path: Path) -> None:
    whole = small_journal(tmp_path)
    (tmp_path / JOURNAL).write_bytes(whole.replace(b"--vary", b"--very"))
    check_repaired(tmp_path, 1)
    assert "line 1: damaged" in refused(tmp_path, IDENTITY | {"--seeds": 4})


def test_a_flipped_bit_repeats_at_most_one_job(tmp_path: Path) -> None:
    whole = small_journal(tmp_path)
    path = tmp_path / JOURNAL
    ends = [place for place, byte in enumerate(whole) if byte == ord("\n")]
    for place, bit in product(range(len(whole)), range(8)):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << bit
        path.write_bytes(damaged)
        is_end = place in ends or damaged[place] == ord("\n")
        line = whole[:place].count(b"\n") + 1
        check_repaired(tmp_path, None if is_end else line)


def test_a_line_of_another_study_is_damage(tmp_path: Path) -> None:
    """Even if its checksum was valid there."""
    other = small_journal(tmp_path / "other", {"--seeds": 9}).splitlines(keepends=True)
    lines = small_journal(tmp_path / "this").splitlines(keepends=True)
    (tmp_path / "this" / JOURNAL).write_bytes(b"".join([lines[0], other[1], lines[2]]))
    check_repaired(tmp_path / "this", 2)


def test_the_later_of_two_lines_of_a_run_counts(tmp_path: Path) -> None:
    with open_journal(tmp_path, IDENTITY) as journal:
        journal.add("0/1", {"error": "died"})
        journal.add("0/1", {"figure": 1.0})
    with open_journal(tmp_path, IDENTITY) as journal:
        assert journal.entries == {"0/1": {"figure": 1.0}}


def test_an_empty_journal_is_removed(tmp_path: Path) -> None:
    for identity in (IDENTITY, {"--seeds": 9}):
        with open_journal(tmp_path / "out", identity) as journal:
            assert not journal.entries
        assert not (tmp_path / "out").exists()
