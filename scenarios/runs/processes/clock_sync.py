"""Keeps the clock of each process on the recorder's, by queries over the bus.

Neither drift nor a wrong system clock then shows in a run. On one host all clocks are the same one
from the beginning, and nothing is corrected.
"""

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass

from scenarios.runs.control.run_id import addressed, content_of
from transport.bus.bus import Bus
from transport.clock import WallClock
from transport.topics import RUN_SENDER, clock_key
from vehicles.schedule import MILLISECOND, SECOND

ROUNDS = 5
"""Number of round trips, of which the fastest counts: delays are rarely symmetric."""
PERIOD_NS = 10 * SECOND
"""Time between two measurements during the run."""
WAITING_PERIOD_NS = SECOND
"""Time between two measurements before the run."""
PATIENCE_NS = 5 * SECOND
"""How long an answer may take."""
RETRY_NS, LONGEST_RETRY_NS = SECOND // 20, SECOND
"""Time between two queries without an answer, doubled each time; late answers count too.

Queries before the recorder has joined have no answer.
"""
AGEING = 100e-6
"""Growth of the uncertainty of a measured offset: drift of common clocks."""
LARGEST_DRIFT = 1e-3
"""A faster change of the offset is a step, not a drift to be continued."""
LONGEST_NUMBER = 20
"""Digits of an instant in nanoseconds, with a sign."""


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """Offset of a vehicle's clock from the recorder's, with its uncertainty (ns)."""

    vehicle: str
    offset: int
    uncertainty: int

    def __str__(self) -> str:
        relation = "ahead of" if self.offset >= 0 else "behind"
        offset_ms, uncertainty_ms = (x / MILLISECOND for x in (abs(self.offset), self.uncertainty))
        return (
            f"the clock of {self.vehicle} is {offset_ms:.1f} ms {relation} the recorder's"
            f" (within {uncertainty_ms:.1f} ms)"
        )

    def pack(self) -> bytes:
        return f"{self.vehicle} {self.offset} {self.uncertainty}".encode()

    @classmethod
    def unpack(cls, data: bytes, vehicles: Collection[str]) -> "ClockOffset | None":
        """Read the report of one of `vehicles`; None for anything else."""
        vehicle, _, numbers = data[:500].decode(errors="replace").rpartition(" ")[0].partition(" ")
        offset, uncertainty = _integer(numbers.encode()), _integer(data.rpartition(b" ")[2])
        if vehicle not in vehicles or offset is None or uncertainty is None or uncertainty < 0:
            return None
        return cls(vehicle, offset, uncertainty)


def _integer(data: bytes) -> int | None:
    digits = data.removeprefix(b"-")
    return int(data) if digits.isdigit() and len(data) <= LONGEST_NUMBER else None


class ClockServer:
    """Answers queries for the recorder's clock, and keeps the offsets that vehicles report.

    A query is a text by which its sender recognises the answer, and perhaps a report in a second
    line. The answer is that text and the instant (ns).
    """

    def __init__(
        self, bus: Bus, now: Callable[[], int], vehicles: Collection[str], run_id: str
    ) -> None:
        self.offsets: dict[str, ClockOffset] = {}
        """Latest report of each vehicle."""
        self._now = now
        self._vehicles = frozenset(vehicles)
        self._run_id = run_id
        bus.answer(clock_key(RUN_SENDER), self._answer)

    def _answer(self, payload: bytes) -> bytes:
        """Answer a query of this run."""
        at, query = self._now(), content_of(payload, self._run_id)
        if query is None:
            return b""
        mark, _, report_text = query.partition(b"\n")
        if report_text and (report := ClockOffset.unpack(report_text, self._vehicles)):
            self.offsets[report.vehicle] = report
        return mark + b" " + str(at).encode()


@dataclass(frozen=True, slots=True)
class _Round:
    """One round trip: error of the own clock and uncertainty (ns)."""

    error: int
    uncertainty: int


class ClockSync:
    """Measures the offset of this process's clock, corrects it and reports it to the recorder.

    Before the run the clock is set, during the run it is slewed. An error within the uncertainty
    of its measurement is left as it is. Call `advance` often; nothing waits.
    """

    def __init__(
        self,
        bus: Bus,
        vehicle: str,
        clock: WallClock,
        run_id: Callable[[], str],
        *,
        sufficient_ns: int,
        running: bool = False,
    ) -> None:
        """Before the run, measurements follow each other until `sufficient_ns` is reached.

        `run_id` returns the identifier of the run, empty while its recorder is unknown.
        `running`: the clock was set before a restart.
        """
        self._bus = bus
        self._run_id = run_id
        self._vehicle = vehicle
        self._clock = clock
        self._sufficient_ns = sufficient_ns
        self.running = running
        self._answers: deque[tuple[int, int, int]] = deque()
        self._rounds: list[_Round] = []
        self._retry_ns = RETRY_NS
        self._due_at = clock.monotonic()
        self._measured_at: int | None = None
        self.uncertainty = 0
        """Uncertainty (ns) of the last measurement."""

    @property
    def is_measured(self) -> bool:
        return self._measured_at is not None

    @property
    def offset(self) -> int:
        """How far (ns) the uncorrected clock is ahead of the recorder's."""
        return -self._clock.corrected

    def advance(self) -> None:
        """Take answers, and send the next query if it is due."""
        now = self._clock.monotonic()
        while self._answers:
            self._take(*self._answers.popleft())
        if len(self._rounds) >= ROUNDS:
            self._finish(now)
        if now >= self._due_at and self._run_id():
            self._due_at = now + self._retry_ns
            self._retry_ns = min(2 * self._retry_ns, LONGEST_RETRY_NS)
            self._query(now)

    def _query(self, now: int, report: bytes = b"") -> None:
        mark = f"{self._vehicle} {now}".encode()

        def receive(answer: bytes) -> None:
            came_at = self._clock.monotonic()
            if report or not answer.startswith(mark + b" "):  # the latter: to an earlier query
                return
            if (theirs := _integer(answer[len(mark) + 1 :])) is not None and theirs >= 0:
                self._answers.append((now, came_at, theirs))

        payload = addressed(self._run_id(), mark + (b"\n" + report if report else b""))
        self._bus.request(clock_key(RUN_SENDER), receive, PATIENCE_NS / SECOND, payload)

    def _take(self, asked_at: int, came_at: int, theirs: int) -> None:
        """Take the recorder's time `theirs` (ns) as one round trip."""
        if self._measured_at is not None and asked_at <= self._measured_at:
            return  # of a measurement that is over
        self._retry_ns, self._due_at = RETRY_NS, came_at
        trip = came_at - asked_at
        error = self._clock.at(asked_at + trip // 2) - theirs
        self._rounds.append(_Round(error, trip - trip // 2))

    def _finish(self, now: int) -> None:
        """Correct the clock by the fastest round, and report it."""
        best = min(self._rounds, key=lambda each: each.uncertainty)
        self._rounds.clear()
        before, self._measured_at = self._measured_at, now
        self._retry_ns = RETRY_NS
        elapsed = 0 if before is None else now - before
        if abs(best.error) > best.uncertainty:
            self._correct(best.error, elapsed)
            self.uncertainty = best.uncertainty
        elif before is None:
            self.uncertainty = best.uncertainty
        else:
            aged = self.uncertainty + round(elapsed * AGEING)
            self.uncertainty = min(best.uncertainty, aged)
        if self.running:
            self._due_at = now + PERIOD_NS
        elif self.uncertainty <= self._sufficient_ns:
            self._due_at = now + WAITING_PERIOD_NS
        report = ClockOffset(self._vehicle, self.offset, self.uncertainty)
        self._query(now, report.pack())

    def _correct(self, error: int, elapsed: int) -> None:
        if not self.running:
            self._clock.set_back(error)
            return
        drift = error / elapsed if elapsed > PERIOD_NS // 2 else 0.0
        self._clock.slew(error, drift if abs(drift) <= LARGEST_DRIFT else 0.0)
