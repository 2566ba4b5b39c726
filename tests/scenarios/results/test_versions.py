"""Digests depend on the content of modules, not on where they are installed."""

import importlib
import sys
from pathlib import Path

import pytest

from scenarios.results.versions import _module_digest, digest_of, plug_in_digests


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


def digest_here(folder: Path, monkeypatch: pytest.MonkeyPatch, **files: str) -> dict[str, str]:
    """Digests of the controller `laws.own.Mine` of a process that imports from `folder`."""
    package(folder, **files)
    with monkeypatch.context() as patch:
        patch.syspath_prepend(folder / "cars")
        importlib.invalidate_caches()
        _module_digest.cache_clear()
        names = ["laws.own.Mine", "vehicles.driver.steering.Stanley"]
        digests = plug_in_digests(names)
    assert "further" not in sys.modules
    return dict(digests)


LAW = {
    "laws__own_py": "import near\nfrom . import gains\nfrom numpy import pi\nclass Mine: ...\n",
    "laws__gains_py": "K = 1\n",
    "near_py": "def help():\n    from further import x\n",
    "further_py": "x = 1\n",
    "unused_py": "y = 1\n",
}


@pytest.mark.parametrize("changed", sorted(LAW))
def test_a_controller_s_digest_covers_the_modules_that_it_imports(
    changed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = digest_here(tmp_path / "here", monkeypatch, **LAW)
    assert set(here) == {"laws.own"}
    assert here == digest_here(tmp_path / "there", monkeypatch, **LAW)
    files = LAW | {changed: LAW[changed] + "# changed\n"}
    other = digest_here(tmp_path / "other", monkeypatch, **files)
    assert (other != here) is (changed != "unused_py")
