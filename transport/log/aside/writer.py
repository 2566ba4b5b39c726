"""A log that another process writes, while this one goes on with what is to be logged.

What a run in virtual time takes for its log is a quarter of its time, of which most can be done on
another core. Here the values of messages are sent over a pipe, those of many messages at once; over
there a `LogWriter` does with the messages what it would have done here, so the file is the same to
the byte. If this process is killed, the other one completes the log with all that it was sent.
"""

import marshal
import struct
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from transport.closing import Closing
from transport.codec import decode, values_of
from transport.log.records import LogError
from transport.topics import TOPIC_OF, Topic
from vehicles.messages import Message

SENT_AT_ONCE = 256
"""So many calls wait for each other."""
MARSHAL_FORMAT = 2
"""Numbers as they are in memory, and no search for those that come twice."""
_LENGTH = struct.Struct("<I")
Call = tuple[Any, ...]
"""Name of a method of the log, and its arguments; instead of `write` stands the topic's name, and
as the last argument the message, of which the values are sent."""
Answer = tuple[str, bool]
"""What is said at the start and at the end: what is wrong, or nothing, and whether it is `fast`."""


class AsideWriter(Closing):
    """The log of a run, as far as this process is concerned; see `LogWriter` for its methods.

    That the file cannot be written any more a later call finds out, at the latest `close`. Not for
    use by several threads at once.
    """

    def __init__(self, path: Path, calls: BinaryIO, answers: BinaryIO) -> None:
        """Write to `path` by whoever does the `calls` and gives `answers`, see `server.serve`.

        Nothing is begun before the first call, which raises LogError if it cannot be.
        """
        self._path = path
        self._calls, self._answers = calls, answers
        self._waiting: list[Call] = []
        self.broken = False
        """True once the file cannot be written any more."""
        self.fast = True
        """False, once the log has begun, where the mcap package allows no faster way to add."""
        self._has_begun = False

    def write(  # noqa: PLR0917 (as in LogWriter)
        self,
        topic: Topic,
        vehicle: str,
        data: bytes | None,
        log_time: int,
        publish_time: int | None = None,
        message: Message | None = None,
    ) -> None:
        """Log one message and its standard twins."""
        if self.broken:
            return
        if message is None:
            if data is None:
                raise TypeError("neither bytes nor a message")
            message = decode(topic, data)
        self._waiting.append((topic.name, vehicle, data, log_time, publish_time, message))
        if len(self._waiting) >= SENT_AT_ONCE:
            self._send()

    def write_deviation(
        self, log_time: int, vehicle: str, true_at: int, error: float, gap: float
    ) -> None:
        """Log true error and gap (m) of a vehicle at an instant (ns), which nobody sent."""
        if self.broken:
            return
        # A number of NumPy's would arrive as bytes.
        deviation = float(error), float(gap)
        self._waiting.append(("write_deviation", log_time, vehicle, true_at, *deviation))

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the log, as of the last message."""
        self._call("attach", name, media_type, data)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Put named text values into the log."""
        self._call("metadata", name, dict(values))

    def flush(self) -> None:
        """Have everything written so far handed to the operating system, soon."""
        self._call("flush")

    def close(self) -> None:
        """Complete the log and wait until that is done; closing twice is harmless."""
        if self._calls.closed:
            return
        if self._waiting:
            self._send()
        with suppress(OSError):  # it has ended, and says why
            self._calls.close()
        if self._has_begun and (error := self._answer()):
            self._give_up(error)
        self._answers.close()

    def _call(self, *call: Any) -> None:
        if self.broken:
            return
        self._waiting.append(call)
        self._send()

    def _send(self) -> None:
        """Send what waits."""
        calls = [
            (*call[:-1], values_of(call[-1])) if type(call[-1]) in TOPIC_OF else call
            for call in self._waiting
        ]
        self._waiting = []
        try:
            put(self._calls, calls)
        except OSError:
            self._give_up(self._answer())
        if not self._has_begun:
            self._has_begun = True
            if error := self._answer():
                self._give_up(error)

    def _answer(self) -> str:
        """What is wrong, if anything, as is said at the start and at the end."""
        try:
            error, self.fast = got(self._answers)
        except (OSError, EOFError):
            return f"{self._path}: cannot write the log: the process that writes it has ended"
        return str(error)

    def _give_up(self, error: str) -> NoReturn:
        self.broken = True
        for stream in (self._calls, self._answers):
            with suppress(OSError):
                stream.close()
        raise LogError(error)


def put(stream: BinaryIO, what: list[Call] | Answer) -> None:
    """Write calls or an answer, for `got`; raises OSError."""
    data = marshal.dumps(what, MARSHAL_FORMAT)
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def got(stream: BinaryIO) -> Any:
    """The next thing that was put; raises EOFError behind the last one."""
    head = stream.read(_LENGTH.size)
    size = _LENGTH.unpack(head)[0] if len(head) == _LENGTH.size else -1
    data = stream.read(size) if size >= 0 else b""
    if len(data) != size:
        raise EOFError
    return marshal.loads(data)  # noqa: S302 - of a process of ours
