"""Reads the messages of a log, complete or truncated."""

from collections.abc import Collection, Iterable, Iterator
from functools import cached_property
from pathlib import Path

from transport.codec import RefusedMessageError, decode
from transport.columns import Columns
from transport.log.columns import read_columns
from transport.log.errors import LogError
from transport.log.mcap_file import REPAIRED, THINNED_NAME, McapFile
from transport.topics import TOPICS, key
from vehicles.messages import Message

OF_DECISIONS = {"trajectory"}
"""Topics whose messages have the numbers of decisions, but not every decision has one."""


class LogReader:
    """The messages, metadata and attachments of a log.

    A `truncated` log was not completed, because its recorder was killed: it contains everything up
    to the last `flush()`, and `repair` completes it. `damage` describes unreadable bytes in one
    line, empty if there are none; the rest is read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = McapFile(path)
        self.truncated, self.damage = self.file.truncated, self.file.damage
        counts = self.file.counts()
        self._keys = {
            number: key
            for number, channel in self.file.channels.items()
            if (key := _key_of(channel.topic))
        }
        self.counts: dict[tuple[str, str], int] = {
            key: counts.get(number, 0) for number, key in self._keys.items() if key[1] in TOPICS
        }
        """Number of messages by (vehicle, topic)."""
        if not self.counts:
            why = "is truncated before the first message"
            if self.file.channels or not self.truncated:
                why = (
                    "contains no messages of a convoy: no topic /convoy/<vehicle>/<topic> "
                    f"with <topic> one of {', '.join(TOPICS)}"
                )
            raise LogError(self.damage or f"{path}: {why}")
        self.first_at = min((head.first_at for head in self.file.chunks), default=0)
        """Instant (ns) at which the first message was recorded."""
        self.last_at = max((head.last_at for head in self.file.chunks), default=0)
        """Instant (ns) at which the last message was recorded."""
        self.vehicles = tuple(sorted({vehicle for vehicle, _ in self.counts}))

    def messages(
        self, topics: Collection[str] | None = None, vehicles: Collection[str] | None = None
    ) -> Iterator[tuple[int, str, Message]]:
        """Yield (log time in ns, vehicle, message) in the order of the log.

        `topics` and `vehicles` select messages; by default all are read. Raises LogError.
        """
        wanted = self._channels(TOPICS if topics is None else topics, vehicles)
        for chunk in self.file.chunks:
            if chunk.channels.isdisjoint(wanted):
                continue
            read = self.file.read([chunk])
            columns = read.channels, read.logged_at, read.starts, read.ends
            for channel, at, start, end in zip(*(c.tolist() for c in columns), strict=True):
                if channel not in wanted:
                    continue
                vehicle, topic = wanted[channel]
                try:
                    message = decode(TOPICS[topic], read.content[start:end])
                except RefusedMessageError as error:
                    name = key(vehicle, TOPICS[topic])
                    raise LogError(f"{self.path}: /{name}: {error}") from error
                yield at, vehicle, message

    def _channels(
        self, topics: Collection[str], vehicles: Collection[str] | None
    ) -> dict[int, tuple[str, str]]:
        """Numbers of the channels of some topics and vehicles."""
        return {
            number: key
            for number, key in self._keys.items()
            if key[1] in topics and (vehicles is None or key[0] in vehicles)
        }

    def columns(
        self,
        topics: Iterable[str],
        *,
        vehicles: Collection[str] | None = None,
        span_ns: tuple[int, int] | None = None,
    ) -> dict[tuple[str, str], Columns]:
        """Read messages as arrays by (vehicle, topic), 20 times as fast as `messages`.

        `vehicles` and `span_ns`, the first and the last instant of recording, select messages;
        only the chunks within the span are decoded. Unreadable messages are left out, see `damage`
        and `missing`.
        """
        span = span_ns or (0, 2**64)
        return read_columns(self.file, self._channels(set(topics), vehicles), span)

    @cached_property
    def missing(self) -> dict[tuple[str, str], tuple[int, int]]:
        """Numbers of missing messages and of all, by (vehicle, topic), where some are missing.

        A message is missing if its number was used but the log lacks it: the log is damaged, or the
        message did not reach the recorder. Thinned topics are left out.
        """
        missing, newest = {}, dict[int, int]()
        for chunk in reversed(self.file.chunks):  # of a channel, the last one is read
            if unknown := chunk.channels - newest.keys():
                read = self.file.read([chunk])
                for channel in unknown:
                    numbers = read.numbers[read.channels == channel]
                    newest[channel] = max(numbers.tolist(), default=-1)
        for channel, name in self._channels(TOPICS.keys() - self.thinned.keys(), None).items():
            total = self.file.stated.get(channel, self.counts[name])
            if name[1] not in OF_DECISIONS:
                total = max(total, newest.get(channel, -1) + 1)
            if total > self.counts[name]:
                missing[name] = total - self.counts[name], total
        return missing

    @property
    def faults(self) -> str:
        """Damage, interruption and holes of the log in one line; empty if it is complete."""
        return self.faults_in(TOPICS)

    def faults_in(self, topics: Collection[str]) -> str:
        """Damage and interruption of the log, and missing messages of these topics, in one line."""
        lines = [self.damage.removeprefix(f"{self.path}: ")]
        if self.truncated:
            lines.append("was not completed")
        elif REPAIRED in self.metadata():
            lines.append("was not completed, and repaired")
        for topic in dict.fromkeys(topic for _, topic in self.missing if topic in topics):
            of_topic = [figures for (_, name), figures in self.missing.items() if name == topic]
            lacking, total = (sum(column) for column in zip(*of_topic, strict=True))
            lines.append(f"{lacking} of {total} {topic} messages are missing")
        faults = "; ".join(filter(None, lines))
        return f"{self.path}: {faults}" if faults else ""

    @property
    def thinned(self) -> dict[str, str]:
        """Maximum rates (Hz) of thinned topics."""
        return self.metadata().get(THINNED_NAME, {})

    def require_all(self, *topics: str) -> None:
        """Raise LogError if one of these topics is thinned."""
        for topic, rate in self.thinned.items():
            if topic in topics:
                kept = "no messages" if rate == "0" else f"at most {rate} messages per second"
                raise LogError(
                    f"{self.path}: contains {kept} of topic {topic}, by [log] of the scenario; all "
                    "of them are needed"
                )

    def refuse_faults(self, *topics: str, remedy: str = "a complete log is needed") -> None:
        """Raise LogError if the log is damaged, incomplete, or lacks messages of these topics."""
        if faults := self.faults_in(topics):
            raise LogError(f"{faults}; {remedy}")

    def metadata(self) -> dict[str, dict[str, str]]:
        """Named text values of the log."""
        return dict(self.file.metadata)

    def attachments(self) -> dict[str, bytes]:
        """Attached files by name."""
        return {name: one.data for name, one in self.file.attachments.items()}


def _key_of(channel: str) -> tuple[str, str] | None:
    """Vehicle and topic of a channel `/convoy/<vehicle>/<topic>`; None for another one."""
    match channel.split("/"):
        case ["", "convoy", vehicle, name] if name in TOPICS:
            return vehicle, name
    return None
