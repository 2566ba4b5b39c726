"""Texts from elsewhere, made fit for a terminal and a line of the log."""

from unicodedata import category

_CONTROL = {"Cc", "Cf", "Zl", "Zp"}
"""Unicode categories of characters that are not text but change how it is shown."""


def printable(text: str) -> str:
    """Escape control characters: of terminals, of the direction of writing, and line ends."""
    if text.isprintable():
        return text
    return "".join(
        char.encode("unicode_escape").decode() if category(char) in _CONTROL else char
        for char in text
    )
