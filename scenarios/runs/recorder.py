"""Writes every message of a run into the log and passes it to observers."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import cast

from scenarios.runs.observer import Observer, listeners_by_kind
from transport.codec import (
    MAX_RANGES,
    MessageNumbers,
    RefusedMessageError,
    decode,
    encode,
    escaped_bytes,
)
from transport.links.link import HORIZON_NS, ROUNDING, PoseGate, TimestampRefusals
from transport.log.writer import LogWriter
from transport.topics import RUN_SENDER, TOPICS, Topic, key, valid_at
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import (
    Change,
    Command,
    CompositeTrajectory,
    GpsPose,
    Health,
    Level,
    LogText,
    Message,
    RunEnd,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND

EARLY_NS = SECOND
"""How early final counters may arrive, in a run that is cancelled before its start."""
AHEAD_NS = SECOND
"""How far ahead of its schedule the number of a pose may be, for clocks that differ."""
ONCE_PER_STEP = frozenset({TruePose, Tracking, Command, CompositeTrajectory})
"""Messages of which a vehicle sends at most one at each instant of control."""
ANY_AGE_NS = 2**62
"""A pose is recorded however late it comes."""
REPEATED_IN_A_ROW = 20
"""Consecutive numbers that came before, from which on a topic has two writers."""


class Recorder:
    """Writes the messages of known vehicles and passes them to observers.

    `rejected` counts refused messages by reason; before `begin` all are refused.
    """

    def __init__(
        self,
        *,
        vehicles: Mapping[str, float],
        plane: LocalPlane,
        writer: LogWriter,
        control_rate_hz: float,
        observers: Sequence[Observer] = (),
        clock_errors_ns: Mapping[str, int] | None = None,
    ) -> None:
        """`vehicles` maps names to their highest rates of sending (Hz).

        Their clocks are off by up to `clock_errors_ns`. `plane` is that of the scenario;
        `observers` receive each message after it was written.
        """
        self._topics: dict[str, tuple[str, Topic]] = {
            key(vehicle, topic): (vehicle, topic)
            for vehicle in (*vehicles, RUN_SENDER)
            for topic in TOPICS.values()
        }
        self._rates_hz = vehicles
        self._clock_errors_ns = clock_errors_ns or {}
        self._plane = plane
        self._writer = writer
        self._control_rate_hz = control_rate_hz
        self._listeners = listeners_by_kind(observers)
        self._seen: defaultdict[str, MessageNumbers] = defaultdict(
            lambda: MessageNumbers(MAX_RANGES)
        )
        self._next: Counter[type[Message]] = Counter()
        self._start_at: int | None = None
        self._misdated = TimestampRefusals()
        self._repeatable: dict[str, set[bytes]] = {}
        self._gates: dict[str, PoseGate] = {}
        self.recorded = self.accepted = 0
        """Messages in the log, and those of them that vehicles sent."""
        self.last_at = 0
        self.rejected: Counter[str] = Counter()
        self._repeated: dict[str, tuple[int, int]] = {}
        self._doubled: dict[str, None] = {}

    @property
    def keys(self) -> list[str]:
        return list(self._topics)

    @property
    def doubled(self) -> str:
        """Topics that two programs write, each with their vehicle; empty without any."""
        return f"two programs write {', '.join(self._doubled)}" if self._doubled else ""

    def _note_repeated(self, key_expression: str, number: int) -> None:
        last, count = self._repeated.get(key_expression, (-1, 0))
        count = count + 1 if number == last + 1 else 1
        self._repeated[key_expression] = number, count
        if count >= REPEATED_IN_A_ROW:
            self._doubled[key_expression] = None

    def begin(self, at: int, start_at: int, run_id: str) -> bytes:
        """Log at instant `at` that the run starts at `start_at` (ns).

        Returns the announcement for the bus.
        """
        self._start_at = start_at
        self._gates = {
            name: PoseGate(
                sender=name,
                start_at=start_at,
                rate_hz=rate_hz,
                plane=self._plane,
                oldest_ns=ANY_AGE_NS,
                clock_error_ns=self._clock_errors_ns.get(name, 0),
            )
            for name, rate_hz in self._rates_hz.items()
        }
        return self._put(RunStart, at, start_at_ns=start_at, run_id=run_id)

    def end(self, at: int, reason: str, run_id: str) -> bytes:
        """Log that the run is over; returns the announcement for the bus."""
        return self._put(RunEnd, at, end_at_ns=at, reason=reason, run_id=run_id)

    def accept(self, key_expression: str, data: bytes, at: int) -> bool:
        """Take one message received at instant `at` (ns); return whether it was recorded.

        Repeated changes and final counters are recorded once.
        """
        try:
            message, seen = self._admit(key_expression, data, at)
        except RefusedMessageError as refusal:
            if data not in self._repeatable.get(key_expression, ()):
                self.rejected[refusal.reason] += 1
                self._note_misdated(key_expression, refusal.reason, at)
            return False
        seen.add(message.seq)
        if isinstance(message, Health):
            self._repeatable[key_expression] = {data}
        elif isinstance(message, Change):
            self._repeatable.setdefault(key_expression, set()).add(data)
        self.accepted += 1
        self.record(at, message, escaped_bytes(data, message))
        return True

    def _note_misdated(self, key_expression: str, reason: str, at: int) -> None:
        vehicle, _ = self._topics.get(key_expression, ("", None))
        if vehicle and (line := self._misdated.count(vehicle, reason)):
            self.log(at, line, "alert")

    def _admit(self, key_expression: str, data: bytes, at: int) -> tuple[Message, MessageNumbers]:
        """Decode and check a message; raises RefusedMessageError.

        Returns it with the numbers of earlier messages on its key.
        """
        address = self._topics.get(key_expression)
        if address is None:
            raise RefusedMessageError("unknown", f"no topic {key_expression}")
        vehicle, topic = address
        message = decode(topic, data, exact=True)
        if message.vehicle != vehicle:
            raise RefusedMessageError("foreign", f"{message.vehicle!r} under {key_expression}")
        if vehicle == RUN_SENDER:
            raise RefusedMessageError("reserved", "only the recorder itself has this name")
        if self._start_at is None:
            raise RefusedMessageError("early", "the run has not begun")
        if isinstance(message, GpsPose):
            self._gates[vehicle].check(message, at)
            due = (at + AHEAD_NS - self._start_at) * self._rates_hz[vehicle] / SECOND
        else:
            due = self._due(message, at, self._start_at)
        if message.seq > due + ROUNDING:
            raise RefusedMessageError("sequence", f"number {message.seq} is ahead of schedule")
        seen = self._seen[key_expression]
        if message.seq in seen:
            self._note_repeated(key_expression, message.seq)
            raise RefusedMessageError("duplicate", f"number {message.seq} came before")
        return message, seen

    def _due(self, message: Message, at: int, start_at: int) -> float:
        """Return the largest number that a message may have; raises RefusedMessageError."""
        valid = valid_at(message)
        if valid < start_at - EARLY_NS:
            raise RefusedMessageError("early", f"valid at {valid}")
        if valid > at + HORIZON_NS:
            raise RefusedMessageError("future", f"valid at {valid}")
        is_scheduled = type(message) in ONCE_PER_STEP
        return (valid - start_at) * self._control_rate_hz / SECOND if is_scheduled else inf

    def log(self, at: int, text: str, level: Level = "info", valid_at: int | None = None) -> None:
        """Log a line at instant `at` (ns), about an earlier instant `valid_at`."""
        self._put(LogText, at, logged_at_ns=valid_at or at, level=level, text=text)

    def report_health(self, at: int, *, final: bool = False) -> None:
        self._put(
            Health,
            at,
            reported_at_ns=at,
            ticks=0,
            late_ticks=0,
            lateness_ms_max=0.0,
            received=self.recorded,
            dropped=0,
            late_messages=0,
            rejected_messages=self.rejected.total(),
            published=0,
            memory_bytes=0,
            cpu_ratio=0.0,
            final=final,
        )

    def _put(self, kind: type[Message], at: int, **fields: object) -> bytes:
        """Log a message of the run itself; returns its bytes for publishing."""
        make = cast("Callable[..., Message]", kind)
        message = make(vehicle=RUN_SENDER, seq=self._next[kind], **fields)
        self._next[kind] += 1
        data = encode(message)
        self.record(at, message, data)
        return data

    def record(self, at: int, message: Message, data: bytes | None = None) -> None:
        """Write a message into the log at instant `at` (ns) and pass it to all observers.

        Without `data` it is encoded as it is written.
        """
        self.last_at = at
        kind = type(message)
        self._writer.write(at, message, data)
        self.recorded += 1
        for listen in self._listeners[kind]:
            listen(at, message)
