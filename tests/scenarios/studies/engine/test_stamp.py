"""The stamp depends on the content of the packages, not on where they are installed."""

from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.studies.engine.job import run_batch
from scenarios.studies.engine.stamp import current_stamp, digest_of


def package(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        path = folder / "cars" / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder / "cars"


FILES = {"a_py": "x = 1\n", "b__c_toml": "y = 2\n"}


def test_a_digest_does_not_depend_on_the_folder(tmp_path: Path) -> None:
    one = package(tmp_path / "one", **FILES)
    other = package(tmp_path / "other", **FILES, notes_txt="not counted")
    (other / "__pycache__").mkdir()
    (other / "__pycache__" / "a.pyc").write_bytes(b"compiled")
    assert digest_of(one) == digest_of(other)


@pytest.mark.parametrize(
    "files",
    [
        {"a_py": "x = 2\n", "b__c_toml": "y = 2\n"},
        {"a_py": "x = 1\n", "b__d_toml": "y = 2\n"},
        {"a_py": "x = 1\n"},
        FILES | {"more_csv": ""},
    ],
)
def test_other_content_or_names_change_the_digest(files: dict[str, str], tmp_path: Path) -> None:
    assert digest_of(package(tmp_path / "one", **files)) != digest_of(
        package(tmp_path / "other", **FILES)
    )


def test_a_worker_with_other_versions_runs_nothing_and_names_the_differences() -> None:
    done: list[int] = []
    here = current_stamp()
    driver = replace(here, numpy="1.0", sources="0" * 12)
    with pytest.raises(ScenarioError) as refused:
        run_batch(driver, [lambda: done.append(1)])
    (line,) = refused.value.lines
    for fact in (f"numpy is {here.numpy}", "1.0", f"sources is {here.sources}"):
        assert fact in line
    assert not done
