"""Finds the packages of this installation, whatever else has their names.

In a notebook the working directory precedes installed packages, and a folder `scenarios` in it
would be imported in place of the package.
"""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

PACKAGES = ("vehicles", "transport", "scenarios")
INSTALLED_IN = next(
    folder
    for folder in Path(__file__).absolute().parents
    if (folder / "scenarios" / "api").is_dir()
)
"""Folder with the packages: this file is in `convoy` of an installation, or in `scenarios/api`."""


def import_own_packages() -> None:
    """Import the packages of this installation.

    Raises ImportError if another package of one of their names was imported before.
    """
    for name in PACKAGES:
        folder = INSTALLED_IN / name
        imported = sys.modules.get(name)
        if imported is None:
            _import(name, folder)
        elif not any(Path(place).absolute() == folder for place in imported.__path__):
            place = next(iter(imported.__path__))
            raise ImportError(
                f"convoy needs its package {name}, but {place} was imported under this name: "
                "import convoy first, or rename that folder"
            )


def _import(name: str, folder: Path) -> None:
    spec = spec_from_file_location(name, folder / "__init__.py")
    if spec is None or spec.loader is None:
        raise ImportError(f"convoy: {folder} is no package")
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
