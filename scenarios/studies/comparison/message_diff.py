"""The first message that differs between two logs, and the number of differing messages.

Messages are paired by vehicle, topic and number. Instants count from the start of each run, so that
runs in real time compare with each other and with virtual ones.
"""

from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, isnan
from typing import Any, Literal

from google.protobuf.message import DecodeError

from transport.codec import PROTOBUF
from transport.log.errors import LogError
from transport.log.reader import LogReader
from transport.topics import TOPICS, Topic, key
from vehicles.messages import RunStart
from vehicles.schedule import SECOND

LEFT_OUT = ("start", "end", "health", "log")
"""Topics that describe processes and files, and lines that follow from other messages."""
CAUSAL = ("change", "verdict", "gps", "trajectory", "tracking", "command", "truth")
"""Order of the messages of one instant, causes before their effects."""
INSTANT = "_at_ns"
"""Suffix of the fields with an instant."""
Side = Literal["A", "B"]


@dataclass(frozen=True, slots=True)
class FieldDifference:
    """A field of a message with its values; instants count from the start of the run (ns)."""

    name: str
    a: Any
    b: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageDifference:
    """A message with other content in the other log, or that `only_in` one log exists.

    `at_s` is its instant after the start of the run. For the verdict of a link, `judged` is the
    sender and the number of the judged message.
    """

    topic: str
    vehicle: str
    number: int
    at_s: float
    fields: tuple[FieldDifference, ...] = ()
    only_in: Side | None = None
    judged: tuple[str, int] | None = None

    @property
    def name(self) -> str:
        place = f"message {self.number} of {key(self.vehicle, TOPICS[self.topic])}"
        if self.judged is None:
            return place
        sender, number = self.judged
        return f"{place}, the verdict on pose {number} of {sender}"

    @property
    def sentence(self) -> str:
        if self.only_in:
            return f"At {self.at_s:.3f} s only {self.only_in} has {self.name}."
        first, *others = self.fields
        more = f"; {len(others)} more fields differ" if len(others) > 1 else ""
        if len(others) == 1:
            more = f"; {others[0].name} differs, too"
        values = f"{first.name} is {_shown(first.a)} in A and {_shown(first.b)} in B"
        return f"At {self.at_s:.3f} s {values}{more} ({self.name})."


def _shown(value: Any) -> str:
    return str(value) if value != "" else "empty"


@dataclass(slots=True)
class MessageComparison:
    """Numbers of messages that are equal, differ, or are in one log only, by topic.

    Messages that a damaged or incomplete log lacks are counted, but are no `first` difference.
    """

    first: MessageDifference | None = None
    equal: int = 0
    differing: Counter[str] = field(default_factory=Counter)
    only_in_a: Counter[str] = field(default_factory=Counter)
    only_in_b: Counter[str] = field(default_factory=Counter)

    @property
    def is_equal(self) -> bool:
        return not (self.differing or self.only_in_a or self.only_in_b)


def compare_messages(a: LogReader, b: LogReader) -> MessageComparison:
    """Compare all messages of two logs; raises LogError for invalid bytes."""
    pairing = _Pairing(a, b)
    pairing.run()
    return pairing.result


Queues = tuple[deque[bytes], deque[bytes]]
"""Encoded messages of A and of B that wait for their counterpart."""


class _Pairing:
    """Walks through both logs side by side, by the times of recording."""

    def __init__(self, a: LogReader, b: LogReader) -> None:
        self.result = MessageComparison()
        self._readers = (a, b)
        self._starts = tuple(start_of(reader) for reader in self._readers)
        self._is_whole = tuple(not reader.faults for reader in self._readers)
        self._first_rank = (inf, 0, "")

    def run(self) -> None:
        topics = [name for name in TOPICS if name not in LEFT_OUT]
        streams = [reader.encoded_messages(topics) for reader in self._readers]
        heads = [next(stream, None) for stream in streams]
        waiting: defaultdict[tuple[str, str], Queues] = defaultdict(lambda: (deque(), deque()))
        while heads[0] or heads[1]:
            times = [
                head[0] - start if head else inf
                for head, start in zip(heads, self._starts, strict=True)
            ]
            side = int(times[1] < times[0])
            if head := heads[side]:
                _, vehicle, topic, data = head
                queues = waiting[vehicle, topic.name]
                queues[side].append(data)
                if queues[0] and queues[1]:
                    self._match(vehicle, topic, queues)
            heads[side] = next(streams[side], None)
        for (vehicle, name), queues in waiting.items():
            for side, queue in enumerate(queues):
                for data in queue:
                    self._add_single(side, vehicle, TOPICS[name], self._parsed(side, name, data))

    def _match(self, vehicle: str, topic: Topic, queues: Queues) -> None:
        """Compare the first waiting messages; the lower number is missing in the other log."""
        ours, theirs = queues
        while ours and theirs:
            if ours[0] == theirs[0] and self._starts[0] == self._starts[1]:
                self.result.equal += 1
                ours.popleft()
                theirs.popleft()
                continue
            a, b = (self._parsed(side, topic.name, queues[side][0]) for side in (0, 1))
            if a.seq <= b.seq:
                ours.popleft()
            if b.seq <= a.seq:
                theirs.popleft()
            if a.seq == b.seq:
                self._add_pair(vehicle, topic, a, b)
            else:
                side = int(b.seq < a.seq)
                self._add_single(side, vehicle, topic, (a, b)[side])

    def _parsed(self, side: int, topic: str, data: bytes) -> Any:
        try:
            return PROTOBUF[TOPICS[topic].message].FromString(data)
        except DecodeError as error:
            raise LogError(f"{self._readers[side].path}: topic {topic}: {error}") from error

    def _add_pair(self, vehicle: str, topic: Topic, a: Any, b: Any) -> None:
        starts = self._starts
        fields = tuple(_field_differences(a, b, starts[0], starts[1]))
        if not fields:
            self.result.equal += 1
            return
        self.result.differing[topic.name] += 1
        at = min(
            getattr(message, topic.instant) - start
            for message, start in zip((a, b), starts, strict=True)
        )
        self._offer(vehicle, topic, a, at, fields=fields)

    def _add_single(self, side: int, vehicle: str, topic: Topic, message: Any) -> None:
        counts = (self.result.only_in_a, self.result.only_in_b)[side]
        counts[topic.name] += 1
        if self._is_whole[1 - side]:
            at = getattr(message, topic.instant) - self._starts[side]
            self._offer(vehicle, topic, message, at, only_in="AB"[side])

    def _offer(self, vehicle: str, topic: Topic, message: Any, at: int, **found: Any) -> None:
        """Keep a difference at `at` (ns after the start) if it is the first one."""
        rank = (at, CAUSAL.index(topic.name), vehicle)
        if rank >= self._first_rank:
            return
        self._first_rank = rank
        judged = (message.sender, message.pose_seq) if topic.name == "verdict" else None
        self.result.first = MessageDifference(
            topic=topic.name,
            vehicle=vehicle,
            number=message.seq,
            at_s=at / SECOND,
            judged=judged,
            **found,
        )


def start_of(reader: LogReader) -> int:
    """Start of the run (ns), or the first recorded instant where that is missing."""
    first_at: int | None = None
    for at, _, message in reader.messages(("start", "truth")):
        if isinstance(message, RunStart):
            return message.start_at_ns
        if first_at is not None and at - first_at > SECOND:
            break
        first_at = at if first_at is None else first_at
    return first_at or 0


def _field_differences(a: Any, b: Any, start_a: int, start_b: int) -> Iterator[FieldDifference]:
    """Yield fields with other values; a field that the log of another version lacks is equal."""
    for one in a.DESCRIPTOR.fields:
        name = one.name
        if one.has_presence and not (a.HasField(name) and b.HasField(name)):
            continue
        of_a, of_b = getattr(a, name), getattr(b, name)
        if one.is_repeated:
            of_a, of_b = tuple(of_a), tuple(of_b)
        elif name.endswith(INSTANT) and (of_a or of_b):  # 0: no such instant
            of_a, of_b = of_a and of_a - start_a, of_b and of_b - start_b
        if of_a != of_b and not _is_same(of_a, of_b):
            yield FieldDifference(name, of_a, of_b)


def _is_same(of_a: Any, of_b: Any) -> bool:
    """Whether two values are equal, where NaN equals NaN, also inside lists."""
    if isinstance(of_a, tuple) and isinstance(of_b, tuple):
        return len(of_a) == len(of_b) and all(map(_is_same, of_a, of_b))
    return bool(of_a == of_b) or (_is_nan(of_a) and _is_nan(of_b))


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and isnan(value)
