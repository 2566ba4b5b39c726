"""File calls that fail: the n-th call that changes a folder raises an error or writes only half.

Calls are counted in this process, at the system interface of Python: `open` for writing, `write`,
`fsync`, `truncate`, `close`, `rename`, `link` and `mkdir` of paths in the folder. Flushed buffers
appear as writes.
"""

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from inspect import signature
from pathlib import Path
from typing import IO, Any, Literal

import pytest

Fault = Literal["ENOSPC", "EIO", "short", "full"]
FAULTS: tuple[Fault, ...] = ("ENOSPC", "EIO", "short", "full")
"""An error of this call only, half of a write, and half of a write on a disk that is then full."""
FILLING = {"open", "write", "mkdir"}
"""Calls that fail on a full disk."""


@dataclass
class FailingCalls:
    """Fails call number `fails_at` (from 0) in `folder`; `made` lists the calls so far."""

    folder: Path
    fails_at: int | None = None
    fault: Fault = "ENOSPC"
    made: list[tuple[str, str]] = field(default_factory=list)

    def is_in(self, path: Any) -> bool:
        if isinstance(path, int):
            path = path_of(path)
        try:
            return Path(os.fsdecode(path)).absolute().is_relative_to(self.folder)
        except TypeError:
            return False

    def call(self, kind: str, path: Any, size: int = 0) -> int:
        """Count a call; return the number of bytes that a write may write. Raises OSError."""
        where = path_of(path) if isinstance(path, int) else os.fsdecode(path)
        number = len(self.made)
        self.made.append((kind, Path(where).name))
        if self.fault == "full" and self.fails_at is not None and number > self.fails_at:
            if kind in FILLING:
                raise failure("ENOSPC", kind, where)
        elif number == self.fails_at:
            if self.fault not in {"short", "full"}:
                raise failure(self.fault, kind, where)
            if kind == "write":
                return max(size // 2, min(size, 1))
        return size


def path_of(descriptor: int) -> str:
    return str(Path(f"/proc/self/fd/{descriptor}").readlink())


def failure(name: str, kind: str, path: str) -> OSError:
    """Error as the system raises it: without a path where the call has only a descriptor."""
    number = getattr(errno, name)
    paths = (path,) if kind in {"open", "rename", "mkdir", "link"} else ()
    return OSError(number, os.strerror(number), *paths)


class FailingFile(io.FileIO):
    def __init__(self, calls: FailingCalls, file: Any, mode: str, **options: Any) -> None:
        super().__init__(file, mode, **options)
        self.calls, self.where = calls, path_of(self.fileno())

    def write(self, data: Any, /) -> int:
        view = memoryview(data).cast("B")
        allowed = self.calls.call("write", self.where, view.nbytes)
        return super().write(view[:allowed])

    def truncate(self, size: int | None = None, /) -> int:
        self.calls.call("truncate", self.where)
        return super().truncate(size)

    def close(self) -> None:
        was_open = not self.closed
        super().close()
        if was_open and hasattr(self, "where"):
            self.calls.call("close", self.where)


OPEN = signature(io.open)


def opening(calls: FailingCalls, real: Callable[..., IO[Any]]) -> Callable[..., IO[Any]]:

    def opened(*positional: Any, **named: Any) -> Any:
        bound = OPEN.bind(*positional, **named)
        bound.apply_defaults()
        given = bound.arguments
        file, mode = given["file"], given["mode"]
        if not set(mode) & set("wxa+") or not calls.is_in(file):
            return real(*positional, **named)
        if not isinstance(file, int):
            calls.call("open", file)
        bare = mode.replace("b", "").replace("t", "")
        raw = FailingFile(calls, file, bare, closefd=given["closefd"], opener=given["opener"])
        if given["buffering"] == 0:
            return raw
        buffered: Any = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        if "b" in mode:
            return buffered
        return io.TextIOWrapper(buffered, given["encoding"], given["errors"], given["newline"])

    return opened


@contextmanager
def failing_calls(
    folder: Path, fails_at: int | None = None, fault: Fault = "ENOSPC"
) -> Iterator[FailingCalls]:
    calls = FailingCalls(folder.absolute(), fails_at, fault)
    with pytest.MonkeyPatch.context() as patched:
        opened = opening(calls, io.open)
        patched.setattr(io, "open", opened)
        patched.setattr(builtins, "open", opened)
        for name, kind in (
            ("replace", "rename"), ("rename", "rename"), ("mkdir", "mkdir"), ("fsync", "fsync"),
            ("link", "link"), ("ftruncate", "truncate"), ("truncate", "truncate"),
        ):  # fmt: skip
            patched.setattr(os, name, counted(calls, kind, getattr(os, name)))
        patched.setattr(os, "open", opening_descriptors(calls, os.open))
        patched.setattr(os, "write", writing_descriptors(calls, os.write))
        yield calls


def counted(calls: FailingCalls, kind: str, real: Callable[..., Any]) -> Callable[..., Any]:
    def call(path: Any, *others: Any, **options: Any) -> Any:
        if calls.is_in(path):
            calls.call(kind, others[0] if kind in {"rename", "link"} else path)
        return real(path, *others, **options)

    return call


def opening_descriptors(calls: FailingCalls, real: Callable[..., int]) -> Callable[..., int]:
    def opened(path: Any, flags: int, *others: Any, **options: Any) -> int:
        if flags & (os.O_WRONLY | os.O_RDWR) and calls.is_in(path):
            calls.call("open", path)
        return real(path, flags, *others, **options)

    return opened


def writing_descriptors(calls: FailingCalls, real: Callable[..., int]) -> Callable[..., int]:
    def write(descriptor: int, data: Any) -> int:
        if not calls.is_in(descriptor):
            return real(descriptor, data)
        return real(descriptor, memoryview(data)[: calls.call("write", descriptor, len(data))])

    return write
