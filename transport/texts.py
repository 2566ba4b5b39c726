"""Escaping of foreign texts for terminals and lines of the log."""

from unicodedata import category

_CONTROL = {"Cc", "Cf", "Zl", "Zp"}
"""Unicode categories of characters that control how text is displayed."""


def printable(text: str) -> str:
    """Escape control characters of terminals and writing directions, and line ends."""
    if text.isprintable():
        return text
    return "".join(
        char.encode("unicode_escape").decode() if category(char) in _CONTROL else char
        for char in text
    )
