"""The other end of an `AsideWriter`: writes the file, in a process of its own."""

import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import chain
from typing import Any, BinaryIO

from transport.codec import Values, message_of
from transport.log.aside.writer import Call, got, put
from transport.log.records import LogError
from transport.log.writer import LogWriter
from transport.topics import TOPICS

_NUMBER = struct.Struct("=d")


def serve(begin: Callable[[], LogWriter], calls: BinaryIO, answers: BinaryIO) -> None:
    """Write the log that `begin` makes, by the calls of an `AsideWriter`, to the last one.

    The log is completed then, also if the process that called was killed. Without a call there is
    none.
    """
    batches = _all(calls)
    if (first := next(batches, None)) is None:
        return
    error, fast = "", True
    with suppress(OSError):  # nobody waits for an answer any more
        try:
            with begin() as log:
                fast = log.fast
                put(answers, ("", fast))
                for batch in chain([first], batches):
                    _do(log, batch)
        except LogError as failure:
            error = str(failure)
        put(answers, (error, fast))


def _do(log: LogWriter, calls: list[Call]) -> None:
    for method, *arguments in calls:
        topic = TOPICS.get(method)
        if topic is None:
            getattr(log, method)(*arguments)
        else:
            vehicle, data, log_time, publish_time, values = arguments
            message = message_of(topic, _plain(values))
            log.write(topic, vehicle, data, log_time, publish_time, message)


def _plain(values: Values) -> Values:
    """Return values as they were: a number of NumPy's, of 64 bits, arrives as its bytes."""
    kinds = {*map(type, values)}
    if bytes not in kinds and tuple not in kinds:
        return values
    return tuple([_plainly(one) for one in values])


def _plainly(value: Any) -> Any:
    if type(value) is tuple:
        return _plain(value)
    return _NUMBER.unpack(value)[0] if type(value) is bytes else value


def _all(calls: BinaryIO) -> Iterator[list[Call]]:
    with suppress(EOFError):
        while True:
            yield got(calls)
