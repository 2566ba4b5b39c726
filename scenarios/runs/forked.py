"""Runs that share their beginnings: each goes on from where an earlier one was the same, by forks.

A run is one process without threads or files. On its way it leaves copies of itself behind, made by
`fork`, which stay where they are. A run that is the same up to the instant of such a copy need not
be driven from the start: the copy is told which way to go, and a copy of it goes on and sends what
it came to. The root of them all has not begun yet. A copy ends when it is told to, or when the
process that asks has ended, whose end of its line is closed then.
"""

import ctypes
import gc
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle
from typing import Any, Generic, NoReturn, Protocol, Self, TypeVar

from scenarios.definition.errors import ScenarioError

PR_SET_CHILD_SUBREAPER = 36
MOST_STAY = 24
"""So many copies stay; each has some megabytes of its own."""


class Way(Protocol):
    """Which of the runs that may part from one another one is; it can be pickled."""

    def same_until(self, other: Self) -> int:
        """Up to which instant what was driven this way is what the `other` way begins with."""


AWay = TypeVar("AWay", bound=Way)


DIED = "a run died without saying why"


Drive = Callable[[AWay, "Journey[AWay]"], Any]
"""Drives one way from the start, or another one after a stay; what it came to can be pickled."""


class ForkedRunError(ScenarioError):
    """A run died."""


def can_fork() -> bool:
    """Whether runs can be forked here: elsewhere than on Linux libraries do not bear it."""
    return sys.platform == "linux"


# ---- In the process that asks


@dataclass(slots=True)
class _Staying(Generic[AWay]):
    """A copy that stays at an instant of a way, and when it was last of use."""

    way: AWay
    at: int
    line: Connection
    used: int


class ForkedRuns(Generic[AWay]):
    """Runs of one `drive`, so many `abreast`, each from the latest copy from which it can go on.

    At most so many copies stay: those that save the most, and were of use lately.
    """

    def __init__(self, drive: Drive[AWay], abreast: int, most: int = MOST_STAY) -> None:
        """Fork the root, from this process as it is; its other threads must hold no locks."""
        self._root, theirs = Pipe()
        self._process = os.fork()
        if not self._process:
            self._root.close()
            _serve(drive, theirs)
        theirs.close()
        self._abreast = abreast
        self._most = most
        self._staying: list[_Staying[AWay]] = []
        self._under_way: dict[Any, tuple[int, AWay]] = {}
        self._begun = 0

    def results(self, ways: Sequence[AWay]) -> list[Any]:
        """Drive all ways; what each came to.

        Raises what a run raised, or ForkedRunError if one died; nothing can be asked afterwards.
        """
        waiting, found = deque(enumerate(ways)), dict[int, Any]()
        try:
            while waiting or self._under_way:
                while waiting and len(self._under_way) < self._abreast:
                    self._begin(*waiting.popleft())
                for back in wait(list(self._under_way)):
                    self._hear(back, found)
        except BaseException:
            self.close()
            raise
        return [found[place] for place in range(len(ways))]

    def _begin(self, place: int, way: AWay) -> None:
        self._begun += 1
        before = [one for one in self._staying if one.at <= one.way.same_until(way)]
        latest = max(before, key=lambda one: one.at, default=None)
        if latest is not None:
            latest.used = self._begun
        line = latest.line if latest is not None else self._root
        back, theirs = Pipe()
        self._under_way[back] = place, way
        try:
            line.send(way)
            send_handle(line, theirs.fileno(), None)
        except OSError as error:
            raise ForkedRunError([DIED]) from error
        finally:
            theirs.close()

    def _hear(self, back: Any, found: dict[int, Any]) -> None:
        """Take what comes from a run: its line where a copy stays, an error, or its result."""
        place, way = self._under_way[back]
        try:
            word, what = back.recv()
            if word == "stays":
                line = Connection(recv_handle(back))
                self._staying.append(_Staying(way, what, line, self._begun))
                self._let_go()
                return
        except (EOFError, OSError) as error:
            raise ForkedRunError([DIED]) from error
        if word == "failed":
            raise what
        found[place] = what
        del self._under_way[back]
        back.close()

    def _let_go(self) -> None:
        """Let the copy end that is worth least, if there are too many."""
        if len(self._staying) > self._most:
            least = min(self._staying, key=self._worth)
            self._staying.remove(least)
            _end(least.line)

    def _worth(self, one: _Staying[AWay]) -> float:
        """What it saves, against the latest other one before it, by how long it was of no use."""
        before = (
            other.at
            for other in self._staying
            if other is not one and other.at <= min(one.at, other.way.same_until(one.way))
        )
        return (one.at - max(before, default=0)) / (1 + self._begun - one.used)

    def close(self) -> None:
        """Let all copies end, and wait until they have."""
        for back in self._under_way:
            back.close()
        for line in (*(one.line for one in self._staying), self._root):
            _end(line)
        self._under_way, self._staying = {}, []
        with suppress(ChildProcessError):
            os.waitpid(self._process, 0)


def _end(line: Connection) -> None:
    with suppress(OSError):  # it is closed, or its process has died
        line.send(None)
    line.close()


# ---- In the root and its copies


def _serve(drive: Drive[Any], line: Connection) -> NoReturn:
    """Be the root. What comes after the first line happens in its copies alone."""
    try:
        gc.freeze()  # a look at what was there before would copy its memory
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # they end with who asks
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # copies that ended go without being asked
        # Copies whose parent has arrived are the root's, so that none is left to anybody else.
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        Journey[Any](line).drive(drive)
    except BaseException:  # noqa: BLE001 - who asks has ended, or sees that this line is closed
        os._exit(1)
    os._exit(0)


class Journey(Generic[AWay]):
    """A run under way in this process, which way it goes, and the line back to who asked."""

    _way: AWay
    _back: Connection

    def __init__(self, line: Connection) -> None:
        self._way, self._back = _asked(line)

    def drive(self, drive: Drive[AWay]) -> None:
        """Drive, and send back what it came to."""
        try:
            word, what = "arrived", drive(self._way, self)
        except Exception as error:  # noqa: BLE001 - whatever it is, it is for who asked
            word, what = "failed", error
        self._back.send((word, what))

    def stay(self, at: int) -> AWay:
        """Leave a copy of this process at an instant; which way to go on, in a copy another one."""
        ours, theirs = Pipe()
        gc.freeze()
        if not os.fork():
            ours.close()
            self._back.close()
            self._way, self._back = _asked(theirs)
            return self._way
        theirs.close()
        self._back.send(("stays", at))
        send_handle(self._back, ours.fileno(), None)
        ours.close()
        return self._way

    def look(self) -> None:
        """End here if nobody asks any more; to be called now and then."""
        # Nothing is ever sent to here: what there is to read is that the other end is closed.
        if self._back.poll():
            os._exit(1)


def _asked(line: Connection) -> tuple[Any, Connection]:
    """Wait here, and return in copies of this process: for each way that comes, with a line back.

    In this process it does not return: that ends when it is told to, or nobody can ask any more.
    """
    while (way := _received(line)) is not None:
        back = Connection(recv_handle(line))
        if not os.fork():
            line.close()
            return way, back
        back.close()
    with suppress(ChildProcessError):  # all that it forked has ended
        os.waitpid(-1, 0)
    os._exit(0)


def _received(line: Connection) -> Any:
    try:
        return line.recv()
    except (EOFError, OSError):
        return None
