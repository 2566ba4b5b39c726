"""A journal that was cut at any byte goes on with the lines before; another question is refused."""

import json
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.errors import ScenarioError
from scenarios.studies.many.engine.journal import JOURNAL, open_journal

ASKED = {"--seeds": 3, "--vary": ["a=1,2"]}
FLOATS = st.floats(allow_nan=False, allow_infinity=False)


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
        assert json.loads(lines[-1]) == {"run": "0/1", "figure": 0.1}


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
    with open_journal(tmp_path, ASKED):
        pass
    before = (tmp_path / JOURNAL).read_bytes()
    assert said in refused(tmp_path, ASKED | asked)
    assert (tmp_path / JOURNAL).read_bytes() == before


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    with open_journal(tmp_path, ASKED):
        assert "another command writes into this folder" in refused(tmp_path, ASKED)


@pytest.mark.parametrize(
    ("place", "line"), [(1, b"{torn\n"), (1, b'{"seed": 1}\n'), (0, b"[]\n"), (1, b"\xff\n")]
)
def test_damage_before_the_last_line_is_refused(place: int, line: bytes, tmp_path: Path) -> None:
    with open_journal(tmp_path, ASKED) as journal:
        journal.add("0/1", {})
        journal.add("0/2", {})
    path = tmp_path / JOURNAL
    lines = path.read_bytes().splitlines(keepends=True)
    lines[place] = line
    path.write_bytes(b"".join(lines))
    assert f"{path}, line {place + 1}: damaged" in refused(tmp_path, ASKED)


def test_the_journal_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).write_text('{"schema":"convoy.journal/0","asked":{}}\n')
    assert "schema: given convoy.journal/0" in refused(tmp_path, ASKED)
