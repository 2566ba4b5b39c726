"""Exceptions for invalid scenarios; `error_messages` writes their lines."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from transport.texts import printable

Problem = tuple[str, str]
"""A key, and what is wrong with its value."""


class ScenarioError(ValueError):
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
