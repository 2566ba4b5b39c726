"""Texts for users: errors, and escaped texts of other programs for terminals and log lines."""

from unicodedata import category


class ConvoyError(Exception):
    """An error that the user can correct; its text is what the command line prints.

    The text has a line for each problem. In Python this class is `convoy.Error`.
    """


_CONTROL = {"Cc", "Cf", "Zl", "Zp"}  # Control and formatting characters, line separators


def printable(text: str) -> str:
    """Escape control characters, writing directions and line ends."""
    if text.isprintable():
        return text
    return "".join(
        char.encode("unicode_escape").decode() if category(char) in _CONTROL else char
        for char in text
    )
