"""What a log holds: duration, topics with rates and gaps, bytes, damage, identity."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenarios.results.log_summary import METADATA_NAME
from transport.log.errors import LogError, UnwritableError
from transport.log.mcap_file import write_again
from transport.log.reader import LogReader
from transport.topics import RUN_SENDER
from vehicles.schedule import SECOND

# ---- `convoy recover`: the readable messages of a truncated or damaged log as a new log


def recover_log(log: Path, output: Path) -> int:
    """Write every readable message of a truncated or damaged log; returns their number."""
    if output.exists():
        raise LogError(f"{output}: exists; a log is never overwritten")
    reader = LogReader(log)  # refuse other files
    try:
        write_again(reader.file, output)
    except OSError as error:
        raise UnwritableError(f"{output}: cannot write the log: {error.strerror}") from error
    return sum(reader.counts.values())


# ---- Log info


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelInfo:
    """Messages of a channel; `rate_hz` and `gap_s_max` are by the instants of recording.

    `missing` counts the numbers that the log lacks, None for standard messages.
    """

    channel: str
    messages: int
    rate_hz: float | None
    gap_s_max: float | None
    bytes: int
    missing: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """A log as a file; `first_at_ns` and `last_at_ns` are the instants of recording."""

    log: str
    bytes: int
    first_at_ns: int
    last_at_ns: int
    duration_s: float
    messages: int
    vehicles: tuple[str, ...]
    is_complete: bool
    faults: str
    thinned: Mapping[str, str]
    identity: Mapping[str, str]
    attachments: Mapping[str, int]
    channels: tuple[ChannelInfo, ...]


def info_of(log: Path) -> LogInfo:
    """Describe a log; raises LogError."""
    reader = LogReader(log)
    channels = tuple(_channels(reader))
    return LogInfo(
        log=str(log),
        bytes=log.stat().st_size,
        first_at_ns=reader.first_at,
        last_at_ns=reader.last_at,
        duration_s=(reader.last_at - reader.first_at) / SECOND,
        messages=sum(channel.messages for channel in channels),
        vehicles=tuple(name for name in reader.vehicles if name != RUN_SENDER),
        is_complete=not reader.faults,
        faults=reader.faults,
        thinned=reader.thinned,
        identity=reader.metadata().get(METADATA_NAME, {}),
        attachments={name: len(data) for name, data in reader.attachments().items()},
        channels=channels,
    )


def _channels(reader: LogReader) -> list[ChannelInfo]:
    messages = reader.file.without_content
    rows = []
    for number, channel in sorted(reader.file.channels.items(), key=lambda row: row[1].topic):
        chosen = messages.of(messages.channels == number)
        steps = np.diff(chosen.logged_at)
        span_s = float(steps.sum()) / SECOND
        _, _, *key = channel.topic.split("/")
        known = tuple(key) in reader.counts
        missing = reader.missing.get((key[0], key[-1]), (0, 0))[0] if known else None
        rows.append(
            ChannelInfo(
                channel=channel.topic,
                messages=len(chosen.order),
                rate_hz=len(steps) / span_s if span_s else None,
                gap_s_max=float(steps.max()) / SECOND if len(steps) else None,
                bytes=int((chosen.ends - chosen.starts).sum()),
                missing=missing,
            )
        )
    return rows
