"""Requested crash of a vehicle's process: it is replaced by a new one under the same number.

The same program with the same arguments takes its place, so its supervisor notices nothing. The
software is built again from the scenario; only the car and the clock are handed over.
"""

import os
import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from tempfile import TemporaryFile
from typing import IO, Any, NoReturn, cast

from scenarios.runs.node.node import SoftwareHandover
from scenarios.runs.node.process_probe import Lateness
from transport.clock import ClockSetting

VARIABLE = "CONVOY_HANDOVER"
"""Environment variable with the descriptor of the file of the handover."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessHandover:
    """State that a vehicle's process passes to its successor.

    `start_at` (ns) and `run_id` are those of the run, `clock` is the setting of the process's
    clock, `lateness` that of its ticks so far. `changes` are messages on changes by hand, with
    their keys.
    """

    start_at: int
    run_id: str
    clock: ClockSetting
    lateness: Lateness
    changes: tuple[tuple[str, bytes], ...] = ()
    node: SoftwareHandover


class RestartRequestedError(Exception):
    """The process has to restart with `handover`."""

    def __init__(self, handover: ProcessHandover) -> None:
        self.handover = handover
        super().__init__("the process restarts")


class _Pickler(pickle.Pickler):
    """Pickles compiled dataclasses by their fields: they have no empty state to restore."""

    def reducer_override(self, thing: Any) -> Any:
        kind = type(thing)
        if not (is_dataclass(kind) and hasattr(kind, "__mypyc_attrs__")):
            return NotImplemented
        return _made, (kind, {f.name: getattr(thing, f.name) for f in fields(kind) if f.init})


def _made(kind: type[Any], values: dict[str, Any]) -> Any:
    return kind(**values)


def pack(handover: object, file: IO[bytes]) -> None:
    """Write a handover, for `pickle.load`."""
    _Pickler(file).dump(handover)


@contextmanager
def restarted_on_request() -> Iterator[ProcessHandover | None]:
    """Yield the handover of the process that this one replaced; restart if a block requests it."""
    try:
        yield received_handover()
    except RestartRequestedError as request:
        restart_process(request.handover)


def restart_process(handover: ProcessHandover) -> NoReturn:
    """Replace this process by the same program, which receives `handover`."""
    with TemporaryFile(buffering=0) as file:  # unnamed, so it is removed with its last reader
        pack(handover, file)
        file.seek(0)
        os.set_inheritable(file.fileno(), True)
        os.environ[VARIABLE] = str(file.fileno())
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])  # noqa: S606 - no shell


def received_handover() -> ProcessHandover | None:
    """Handover of the process that this one replaced, None if there was none."""
    number = os.environ.pop(VARIABLE, None)
    if number is None:
        return None
    with os.fdopen(int(number), "rb") as file:
        handover = pickle.load(file)  # noqa: S301 - written by this process
    return cast("ProcessHandover", handover)
