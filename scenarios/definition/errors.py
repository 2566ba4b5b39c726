"""Exceptions for invalid input; their texts are the lines that a user reads."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from transport.texts import ConvoyError, printable

Problem = tuple[str, str]
"""A key, and what is wrong with its value."""


class ScenarioError(ConvoyError, ValueError):
    """An invalid scenario, with a line for each problem."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.lines = tuple(map(printable, lines))
        super().__init__("\n".join(self.lines))

    def __reduce__(self) -> tuple[type["ScenarioError"], tuple[tuple[str, ...]]]:
        return type(self), (self.lines,)


class SettingError(ValueError):
    """An invalid setting on its way to a ScenarioError: its key, and the reason."""

    def __init__(self, key: str, why: str) -> None:
        self.key, self.why = key, why
        super().__init__(f"{key}: {why}")

    def __reduce__(self) -> tuple[type["SettingError"], tuple[str, str]]:
        return type(self), (self.key, self.why)


@contextmanager
def collected(problems: list[Problem]) -> Iterator[None]:
    """Append the SettingError of a block to `problems`."""
    try:
        yield
    except SettingError as error:
        problems.append((error.key, error.why))


class MissingExtraError(ConvoyError):
    """A missing optional package, in one line."""


def require(feature: str, extra: str, *packages: str) -> None:
    """Raise MissingExtraError if a package of `extra` that `feature` needs is missing."""
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise MissingExtraError(
            f"{feature}: needs {' and '.join(missing)}, not installed here: "
            f"pip install 'convoy-emulator[{extra}]'"
        )
