"""Copies of a log with some messages changed."""

from collections.abc import Callable
from pathlib import Path

from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from vehicles.messages import Message


def changed_log(
    source: Path,
    target: Path,
    change: Callable[[Message], Message | None] = lambda message: message,
) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    reader = LogReader(source)
    with LogWriter(target) as writer:
        for at, _, message in reader.messages():
            changed = change(message)
            if changed is not None:
                writer.write(at, changed)
        for name, values in reader.metadata().items():
            writer.metadata(name, values)
        for name, data in reader.attachments().items():
            writer.attach(name, "application/octet-stream", data)
    return target
