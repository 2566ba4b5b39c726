"""What has come for the recorder and waits to be recorded: bounded, whoever sends it."""

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from heapq import heappop, heappush
from itertools import count
from threading import Event, Lock

from transport.codec import MAX_BYTES
from transport.reasons import RefusalReason

MOST_BYTES = 64 * 2**20
"""What may wait of all keys together, half a minute of what forty vehicles send; each key may
fill its share of it even then. So a flood under some keys pushes out nothing under the others."""
OVERHEAD_BYTES = 160
"""What a message takes in the queue beside its bytes."""
MOST_HELD_BYTES = 32 * 2**20
"""What may wait for what was sent before it, ten times what a hundred vehicles send meanwhile."""
Arrival = tuple[int, str, bytes]
"""Instant of arrival (ns), key and bytes."""


class Arrivals:
    """A queue from the bus's thread to the recorder's; what it refuses it counts, by reason."""

    def __init__(
        self,
        keys: Iterable[str],
        most_bytes: int = MOST_BYTES,
        *,
        larger: Mapping[str, int] | None = None,
    ) -> None:
        """Take nothing but what comes under `keys`, or under one that may have `larger` bytes."""
        self._larger = dict(larger or {})
        self._keys = {key: key for key in (*keys, *self._larger)}
        self._most = most_bytes
        self._share = most_bytes // len(self._keys)
        self._held: Counter[str] = Counter()
        self._total = 0
        # Not a SimpleQueue: of a signal that comes while it waits, and is handled for longer than
        # is left of the time to wait, it makes a wait without end (CPython 3.11 and 3.12).
        self._waiting: deque[Arrival] = deque()
        self._came = Event()
        self._refused: Counter[RefusalReason] = Counter()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def came_first_at(self) -> int | None:
        """Instant (ns) at which came what waits the longest; None if nothing waits."""
        first: Arrival | None = None
        with suppress(IndexError):
            first = self._waiting[0]
        return None if first is None else first[0]

    def put(self, at: int, key_expression: str, data: bytes) -> None:
        """Take what has come at instant `at` (ns), if there is room; called on any thread."""
        key = self._keys.get(key_expression)  # always the same string, not one for each message
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
                if not self._came.is_set():
                    self._came.set()

    def take(self, most: int, timeout_s: float) -> list[Arrival]:
        """Return what came first, `most` of it; if nothing is there, wait for `timeout_s` (s).

        For one thread alone.
        """
        if not self._waiting:
            self._came.clear()
            if not self._waiting:  # nothing has come since the first look either
                self._came.wait(timeout_s)
        taken = [self._waiting.popleft() for _ in range(min(most, len(self._waiting)))]
        with self._lock:
            for _, key, data in taken:
                size = len(data) + OVERHEAD_BYTES
                self._held[key] -= size
                self._total -= size
        return taken

    def refusals(self) -> Counter[RefusalReason]:
        """Return what was refused since the last call, by reason."""
        with self._lock:
            refused, self._refused = self._refused, Counter()
        return refused


class SendingOrder:
    """What has come, by the instants at which it was sent: batches come later than what is alone.

    What comes so late that others have been given away already comes after them. Of more than
    `most_bytes` the first do not wait any longer.
    """

    def __init__(self, most_bytes: int = MOST_HELD_BYTES) -> None:
        self._heap: list[tuple[int, int, Arrival]] = []
        self._numbers = count()
        self._most = most_bytes
        self._held = 0

    def put(self, sent_at: int, arrival: Arrival) -> None:
        """Take what was sent at `sent_at` (ns)."""
        self._held += len(arrival[2]) + OVERHEAD_BYTES
        heappush(self._heap, (sent_at, next(self._numbers), arrival))

    def until(self, instant: int | None = None) -> Iterator[Arrival]:
        """Yield, and give away, what was sent up to an instant (ns); without one everything."""
        heap = self._heap
        while heap and (instant is None or heap[0][0] <= instant or self._held > self._most):
            arrival = heappop(heap)[2]
            self._held -= len(arrival[2]) + OVERHEAD_BYTES
            yield arrival
