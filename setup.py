"""Packages of the distribution; `convoy`, the Python interface, is the folder scenarios/api."""

from setuptools import find_packages, setup

LAYOUT = {
    "packages": [*find_packages(include=["vehicles*", "transport*", "scenarios*"]), "convoy"],
    "package_dir": {"convoy": "scenarios/api"},
}
setup(**LAYOUT)
