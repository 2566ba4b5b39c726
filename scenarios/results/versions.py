"""Versions of installed packages, for the log and for the check of a run's processes."""

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from types import MappingProxyType

PACKAGES = ("convoy-emulator", "eclipse-zenoh", "mcap", "numpy", "protobuf", "pymap3d")
"""Packages whose versions are written into the log."""


@cache
def installed_versions() -> Mapping[str, str]:
    """Versions of Python and of PACKAGES; cached, because reading takes milliseconds."""
    versions = {"python": platform.python_version()}
    return MappingProxyType(versions | {package: version(package) for package in PACKAGES})
