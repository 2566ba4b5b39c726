"""Digests depend on the content of modules, not on where they are installed."""

import importlib
from pathlib import Path

import pytest

from scenarios.definition.versions import _module_digest, digest_of, plug_in_digests


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


def digest_here(folder: Path, monkeypatch: pytest.MonkeyPatch, **files: str) -> dict[str, str]:
    """Digests of the controller `laws.own.Mine` of a process that imports from `folder`."""
    package(folder, **files)
    with monkeypatch.context() as patch:
        patch.syspath_prepend(folder / "cars")
        importlib.invalidate_caches()
        _module_digest.cache_clear()
        names = ["laws.own.Mine", "vehicles.driver.steering.Stanley"]
        digests = plug_in_digests(names)
    return dict(digests)


def test_a_controller_s_digest_is_that_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    law = {"laws__own_py": "class Mine: ...\n", "laws__gains_py": "K = 1\n"}
    here = digest_here(tmp_path / "here", monkeypatch, **law)
    assert set(here) == {"laws.own"}
    assert here == digest_here(tmp_path / "there", monkeypatch, **law)
    changed = law | {"laws__own_py": "class Mine: ...  # changed\n"}
    assert here != digest_here(tmp_path / "other", monkeypatch, **changed)
