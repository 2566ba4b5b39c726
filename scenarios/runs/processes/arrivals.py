"""Messages that wait for the recorder, in bounded memory."""

from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from operator import itemgetter
from threading import Event, Lock

from transport.bus.telemetry import unpacked
from transport.clock import SYSTEM_TIME, SystemTime
from transport.codec import MAX_BYTES
from transport.topics import RefusalReason
from vehicles.schedule import SECOND

MOST_BYTES = 64 * 2**20
"""Size of all waiting messages, half a minute of forty vehicles. A key may always fill its own
share, so a flood under some keys displaces nothing under the others."""
OVERHEAD_BYTES = 160
"""Memory of a queued message in addition to its bytes."""
MOST_HELD_BYTES = 32 * 2**20
"""Size of messages held for reordering, ten times that of a hundred vehicles."""
OLDEST_NS = SECOND
"""Instants of sending are at most this long before the arrival."""
Arrival = tuple[int, str, bytes]
"""Instant (ns) of arrival, or at which a message of a batch was sent; key and bytes."""
_instant = itemgetter(0)


class Arrivals:
    """Bounded queue from the bus's thread to the recorder's; refusals are counted by reason."""

    def __init__(
        self,
        keys: Iterable[str],
        most_bytes: int = MOST_BYTES,
        *,
        larger: Mapping[str, int] | None = None,
        system: SystemTime = SYSTEM_TIME,
    ) -> None:
        """Accept messages under `keys`, and under those of `larger` with up to that many bytes."""
        self._system = system
        self._larger = dict(larger or {})
        self._keys = {key: key for key in (*keys, *self._larger)}
        self._most = most_bytes
        self._share = most_bytes // len(self._keys)
        self._held: Counter[str] = Counter()
        self._total = 0
        # Not a SimpleQueue: it waits forever if a signal handler outlasts its timeout (CPython 3.11
        # and 3.12).
        self._waiting: deque[Arrival] = deque()
        self._came, self._wanted = Event(), 1
        self._refused: Counter[RefusalReason] = Counter()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def came_first_at(self) -> int | None:
        """Arrival instant (ns) of the oldest waiting message, None without any."""
        first: Arrival | None = None
        with suppress(IndexError):
            first = self._waiting[0]
        return None if first is None else first[0]

    def put(self, at: int, key_expression: str, data: bytes) -> None:
        """Take a message that arrived at instant `at` (ns), if there is room; on any thread."""
        key = self._keys.get(key_expression)  # one shared string per key
        size = len(data) + OVERHEAD_BYTES
        with self._lock:
            if key is None:
                self._refused["unknown"] += 1
            elif len(data) > self._larger.get(key, MAX_BYTES):
                self._refused["oversized"] += 1
            elif self._total + size > self._most and self._held[key] + size > self._share:
                self._refused["overflow"] += 1
            else:
                self._held[key] += size
                self._total += size
                self._waiting.append((at, key, data))
                if len(self._waiting) >= self._wanted and not self._came.is_set():
                    self._came.set()

    def take(self, most: int, timeout_s: float) -> list[Arrival]:
        """Remove up to `most` of the oldest messages; wait up to `timeout_s` (s) for that many.

        So the recorder does not wake for each of thousands of messages per second. For one thread
        only.
        """
        if len(self._waiting) < most:
            self._wanted = most
            self._came.clear()
            if len(self._waiting) < most:  # checked again after clearing the event
                self._system.wait(self._came, timeout_s)
        taken = [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
        with self._lock:
            for _, key, data in taken:
                size = len(data) + OVERHEAD_BYTES
                self._held[key] -= size
                self._total -= size
        return taken

    def error_lines(self) -> Counter[RefusalReason]:
        """Return and reset the refusals by reason."""
        with self._lock:
            refused, self._refused = self._refused, Counter()
        return refused


class SendingOrder:
    """Sorts arrivals by the instant of sending: batches arrive later than single messages.

    A message that arrives after later ones were released follows them. Beyond `most_bytes` the
    oldest are released early.
    """

    def __init__(
        self,
        batches: Mapping[str, Mapping[str, str]] | None = None,
        most_bytes: int = MOST_HELD_BYTES,
    ) -> None:
        """`batches` maps the keys of batches to the keys of their messages by topic."""
        self._batches = batches or {}
        self._waiting: list[Arrival] = []
        self._most = most_bytes
        self._held = 0

    def put(self, arrival: Arrival) -> None:
        """Take a message or unpack a batch; raises RefusedMessageError.

        A topic that is not allowed in a batch keeps the batch's key, which the recorder refuses.
        """
        at, key, data = arrival
        keys = self._batches.get(key)
        if keys is None:
            self._waiting.append(arrival)
            self._held += len(data) + OVERHEAD_BYTES
            return
        oldest = at - OLDEST_NS
        for topic, sent_at, content in unpacked(data):
            sent_at = min(max(sent_at, oldest), at)  # noqa: PLW2901
            self._waiting.append((sent_at, keys.get(topic, key), content))
            self._held += len(content) + OVERHEAD_BYTES

    def until(self, instant: int | None = None) -> list[Arrival]:
        """Release messages sent up to an instant (ns), by default all."""
        waiting = self._waiting
        waiting.sort(key=_instant)
        end = len(waiting) if instant is None else bisect_right(waiting, instant, key=_instant)
        given = 0
        for place, (_, _, data) in enumerate(waiting):
            if place >= end and self._held <= self._most:
                break
            self._held -= len(data) + OVERHEAD_BYTES
            given = place + 1
        ready = waiting[:given]
        del waiting[:given]
        return ready
