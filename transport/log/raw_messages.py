"""Undecoded messages of an MCAP file of another program."""

from collections.abc import Iterator
from pathlib import Path

from mcap.reader import NonSeekingReader
from mcap.records import Channel, Message, Schema

from transport.log.errors import LogError

RECORD_BYTES_MAX = 2**28
"""Maximum length of a record; a larger one is damage."""


def raw_messages(path: Path) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """Yield the messages of a file in its order; raises LogError at the first damage."""
    try:
        with path.open("rb") as file:
            reader = NonSeekingReader(file, record_size_limit=RECORD_BYTES_MAX)
            yield from reader.iter_messages(log_time_order=False)
    except OSError as error:
        raise LogError(f"cannot read the log: {error.strerror}") from error
    except Exception as error:  # zstandard and struct raise their own
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise LogError(f"damaged or truncated, the rest cannot be read: {reason}") from error
