"""Takes every message of a run off the bus: into the log, the figures and the picture."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence

from scenarios.results.metrics import Metrics
from transport.codec import RefusedMessageError, decode, encode
from transport.log.writer import LogWriter
from transport.topics import CONDUCTOR, TOPIC_OF, TOPICS, Topic, instant, key
from vehicles.messages import GpsPose, Health, LogText, Message, RunStart
from vehicles.schedule import SECOND

AHEAD_NS = 60 * SECOND
"""A vehicle's clock may be ahead of the recorder's by so much."""
ROUNDING = 0.001
"""Periods; instants are rounded to nanoseconds."""

Listener = Callable[[int, Message], None]
"""Gets the instant of reception (ns) and each accepted message: viewer, progress, conductor."""


class Recorder:
    """Writes the messages of known vehicles; anything else on their keys is only counted.

    `valid_from` (ns) is the first instant of the run: what was valid earlier belongs to another.
    `gnss_rates_hz` says how often each vehicle measures. Who takes messages off a bus gives it: a
    pose numbered higher than its vehicle can have counted by then is refused, since one such
    number would make all those below it missing.
    """

    def __init__(
        self,
        *,
        vehicles: Sequence[str],
        writer: LogWriter,
        metrics: Metrics,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`listeners` see each message after it has been written."""
        self._topics: dict[str, tuple[str, Topic]] = {
            key(vehicle, topic): (vehicle, topic)
            for vehicle in (*vehicles, CONDUCTOR)
            for topic in TOPICS.values()
        }
        self._writer = writer
        self._metrics = metrics
        self._listeners = listeners
        self._seen: defaultdict[str, set[int]] = defaultdict(set)
        self._next: Counter[type[Message]] = Counter()
        self._start_at = 0
        self.valid_from = 0
        self.gnss_rates_hz: Mapping[str, float] = {}
        self.recorded = 0
        self.rejected: Counter[str] = Counter()

    def accept(self, key_expression: str, data: bytes, at: int) -> None:
        """Take one message received at instant `at` (ns)."""
        found = self._topics.get(key_expression)
        if found is None:
            self.rejected["unknown key"] += 1
            return
        vehicle, topic = found
        try:
            message = decode(topic, data, exact=True)
        except RefusedMessageError:
            self.rejected["malformed"] += 1
            return
        seen = self._seen[key_expression]
        if message.vehicle != vehicle:
            self.rejected["vehicle does not match key"] += 1
        elif message.seq in seen:
            self.rejected["repeated"] += 1
        elif vehicle == CONDUCTOR:
            self.rejected["in the run's own name"] += 1
        elif not self.valid_from <= instant(message) <= at + AHEAD_NS:
            self.rejected["of another run"] += 1
        elif isinstance(message, GpsPose) and self._is_ahead(message):
            self.rejected["ahead of its schedule"] += 1
        else:
            seen.add(message.seq)
            self._record(topic, vehicle, data, at, message)

    def _is_ahead(self, pose: GpsPose) -> bool:
        rate_hz = self.gnss_rates_hz.get(pose.vehicle)
        if rate_hz is None:
            return False
        return pose.seq > (pose.measured_at_ns - self._start_at) * rate_hz / SECOND + ROUNDING

    def witness(self, topic: Topic, data: bytes, message: Message, at: int) -> None:
        """Take a message from a vehicle of the same process at instant `at` (ns)."""
        self._record(topic, message.vehicle, data, at, message)

    def say(self, at: int, text: str, level: str = "info") -> None:
        """Write a line of the run's own into the log."""
        self.put(LogText, at, logged_at_ns=at, level=level, text=text)

    def report_health(self, at: int, *, final: bool = False) -> None:
        """Write the recorder's own counters into the log."""
        self.put(
            Health,
            at,
            reported_at_ns=at,
            ticks=0,
            late_ticks=0,
            lateness_ms_max=0.0,
            heard=self.recorded,
            dropped=0,
            late_messages=0,
            rejected_messages=self.rejected.total(),
            published=0,
            memory_bytes=0,
            cpu_ratio=0.0,
            final=final,
        )

    def put(self, kind: type[Message], at: int, **fields: object) -> bytes:
        """Write a message of the run's own (vehicle `run`) and return its bytes for publishing."""
        message = kind(vehicle=CONDUCTOR, seq=self._next[kind], **fields)  # type: ignore[arg-type]
        self._next[kind] += 1
        topic = TOPIC_OF[kind]
        data = encode(message)
        if isinstance(message, RunStart):
            self._start_at = message.start_at_ns
        self._seen[key(CONDUCTOR, topic)].add(message.seq)
        self._record(topic, CONDUCTOR, data, at, message)
        return data

    def _record(self, topic: Topic, vehicle: str, data: bytes, at: int, message: Message) -> None:
        self._writer.write(topic, vehicle, data, at, message=message)
        self.recorded += 1
        self._metrics.add(message)
        for listener in self._listeners:
            listener(at, message)
