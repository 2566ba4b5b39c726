"""Errors of logs, without the libraries that read and write them."""

from transport.texts import ConvoyError


class LogError(ConvoyError):
    """A log that cannot be written or read, in one line."""


class UnwritableError(LogError):
    """A log or summary that cannot be written: a full disk, a removed file."""
