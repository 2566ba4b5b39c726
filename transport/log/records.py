"""The records of an MCAP file, up to where its recorder was killed if it was."""

import fcntl
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO

MAGIC = b"\x89MCAP0\r\n"
"""An MCAP file begins and ends with these bytes (MCAP specification, section Magic)."""
_HEAD = struct.Struct("<BQ")  # what each record begins with: opcode, length of the rest
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_FOOTER = 0x02
_MESSAGE = 0x05
CHUNK = 0x06
ATTACHMENT = 0x09
METADATA = 0x0C
_DATA_END = 0x0F
_OPCODES = range(0x01, 0x10)


class LogError(Exception):
    """A log that cannot be written or read: one line that says what, where and what is allowed."""


def lock(file: IO[bytes], path: Path) -> None:
    """Hold a log for writing until `file` is closed; raises LogError if another process does."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise LogError(f"{path}: is being written by another process") from error
    except OSError:  # a file system without locks
        return


def map_log(path: Path) -> tuple[mmap.mmap, bool]:
    """Map the complete records of an MCAP file, and say whether the file breaks off after them.

    Raises LogError if there is no such file or it is no MCAP.
    """
    try:
        with path.open("rb") as file:
            whole = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            if whole[: len(MAGIC)] != MAGIC:
                raise LogError(f"{path}: is not an MCAP log (run.mcap in a run's folder is one)")
            end, truncated = _measure(whole)
            return mmap.mmap(file.fileno(), end, access=mmap.ACCESS_READ), truncated
    except ValueError as error:  # nothing to map
        raise LogError(f"{path}: is empty, not an MCAP log") from error
    except OSError as error:
        raise LogError(f"{path}: cannot read the log: {error.strerror}") from error


def _measure(whole: mmap.mmap) -> tuple[int, bool]:
    """Find where the last complete record ends, and whether the log breaks off there."""
    at, size = len(MAGIC), len(whole)
    while at + _HEAD.size <= size:
        opcode, length = _HEAD.unpack_from(whole, at)
        after = at + _HEAD.size + length
        if opcode not in _OPCODES or after > size:
            break
        at = after
        if opcode == _FOOTER and whole[at:] == MAGIC:
            return size, False
    return at, True


def records_in(log: mmap.mmap, opcode: int) -> Iterator[bytes]:
    """Give the contents of the records of one kind in the data section but not in its chunks."""
    at = len(MAGIC)
    while at < len(log):
        found, length = _HEAD.unpack_from(log, at)
        at += _HEAD.size
        if found == opcode:
            yield log[at : at + length]
        if found == _DATA_END:
            return
        at += length


def messages_in(chunk: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Give (channel, log time, data) of the messages in an unpacked chunk."""
    at = 0
    while at < len(chunk):
        opcode, length = _HEAD.unpack_from(chunk, at)
        at += _HEAD.size
        if opcode == _MESSAGE:
            channel, _, log_time, _ = _MESSAGE_HEAD.unpack_from(chunk, at)
            yield channel, log_time, chunk[at + _MESSAGE_HEAD.size : at + length]
        at += length
