"""Members of a run: processes with the recorder's fingerprint, each name once."""

import re
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from dataclasses import astuple, dataclass, fields

from scenarios.definition.scenario import Scenario
from scenarios.definition.versions import current_stamp, plug_in_digests
from scenarios.runs.end_confirmation import addressed, content_of
from transport.bus.bus import Bus, BusError, Member
from transport.clock import WallClock
from transport.texts import printable
from transport.topics import RUN_SENDER, clock_key
from vehicles.schedule import MILLISECOND, SECOND

# ---- How long the router has been out of reach, for recorder and vehicles


ROUTER_LOST_AFTER_NS = 5 * SECOND
"""The run is over when the router has been out of reach for this long."""


class RouterWatch:
    """Tracks whether the router is in reach; instants are ns."""

    def __init__(self) -> None:
        self.lost_at: int | None = None
        self.back_at = 0

    def look(self, now: int, *, connected: bool) -> int:
        """Note whether the router is in reach; returns the length (ns) of an ended outage."""
        if not connected:
            self.lost_at = self.lost_at or now
            return 0
        if self.lost_at is None:
            return 0
        outage, self.lost_at, self.back_at = now - self.lost_at, None, now
        return outage

    def is_lost_for_good(self, now: int) -> bool:
        return self.lost_at is not None and now - self.lost_at > ROUTER_LOST_AFTER_NS


# ---- Membership


RECORDER, VEHICLE = "recorder", "vehicle"
SETTLE_S = 0.2
"""Time after which two joining processes see each other's announcement."""
LEFT_AFTER_NS = 5 * SECOND
"""A recorder counts as gone once its token was absent this long while the router was in reach.

A recorder that was suspended needs up to a second to return.
"""
LONGEST_SHOWN = 60
"""Length of text from other processes in messages."""
MOST_WARNINGS = 20
"""Warnings about other members; a stranger can announce any number of them."""
SEPARATOR = "~"
_RUN_NAME = re.compile(r"[A-Za-z0-9_-]{1,100}")


def checked_run_name(name: str) -> str:
    """Return `name` if a run can have it, else raise BusError."""
    if not _RUN_NAME.fullmatch(name):
        raise BusError(
            f"--run {name!r}: allowed are up to 100 letters, digits, underscores and hyphens"
        )
    return name


def shown(text: str) -> str:
    """Shorten and escape text that another process announced."""
    text = printable(text)
    return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 3]}..."


@dataclass(frozen=True, slots=True, kw_only=True)
class Fingerprint:
    """Identity of a run and of the program, announced by each process.

    `digest` is that of the scenario's content except its name and its seed, `sources` that of the
    program, `plug_ins` those of the modules of user-defined classes, as "module:digest+...". All
    but the versions of Python and NumPy must be equal in all processes.
    """

    scenario: str
    seed: str
    version: str
    digest: str
    sources: str
    plug_ins: str
    python: str
    numpy: str

    @classmethod
    def of(cls, scenario: Scenario) -> "Fingerprint":
        stamp = current_stamp()
        digests = plug_in_digests(scenario.plug_ins)
        return cls(
            scenario=scenario.name,
            seed=str(scenario.seed),
            version=stamp.convoy,
            digest=scenario.digest,
            sources=stamp.sources,
            plug_ins="+".join(f"{module}:{digest}" for module, digest in digests.items()),
            python=stamp.python,
            numpy=stamp.numpy,
        )

    @property
    def chunk(self) -> str:
        return SEPARATOR.join(astuple(self))

    def difference(self, chunk: str) -> str:
        """Describe what excludes another fingerprint from the run; empty if nothing does."""
        other = self.read(chunk)
        if other is None:
            return f"has another version of the program, here it is {self.version}"
        rows = (
            ("has version {}, here it is {}", other.version, self.version),
            ("has scenario {}, here it is {}", other.scenario, self.scenario),
            ("has seed {}, here it is {}", other.seed, self.seed),
            ("runs other sources: {}, here {}", other.sources, self.sources),
            ("runs other user-defined classes: {}, here {}", other.plug_ins, self.plug_ins),
        )
        differences = [text.format(shown(a), shown(b)) for text, a, b in rows if a != b]
        if not differences and other.digest != self.digest:
            return f"has another content of scenario {self.scenario} (file or --set)"
        return "; ".join(differences)

    def other_versions(self, chunk: str) -> str:
        """Describe other versions of Python or NumPy, with which results may differ slightly."""
        other = self.read(chunk)
        if other is None:
            return ""
        rows = (
            ("Python", other.python, self.python),
            ("NumPy", other.numpy, self.numpy),
        )
        return ", ".join(f"{name} {shown(a)}, here {b}" for name, a, b in rows if a != b)

    @classmethod
    def read(cls, chunk: str) -> "Fingerprint | None":
        """Parse a fingerprint; None for that of another version of the program."""
        parts, names = chunk.split(SEPARATOR), [entry.name for entry in fields(cls)]
        return cls(**dict(zip(names, parts, strict=True))) if len(parts) == len(names) else None


class Membership:
    """Takes part in a run for this process and tracks the other members.

    The recorder decides what runs: a vehicle with another fingerprint than the recorder's is
    refused. Other processes under the name of the run are reported and have no effect.
    """

    def __init__(
        self,
        bus: Bus,
        run: str,
        role: str,
        name: str,
        fingerprint: Fingerprint,
        *,
        run_id: str = "",
    ) -> None:
        """Start to watch members; `join` announces this process.

        `run_id` is the identifier of a run that this process continues.
        """
        self.run_id = run_id
        """Identifier of the run, the name of its recorder: of the one that was present first, until
        the run has started also of its successor."""
        self._has_started = bool(run_id)
        self.run = run
        self.name = name
        self._bus = bus
        self._role = role
        self._fingerprint = fingerprint
        self._chunk = fingerprint.chunk
        self._others: frozenset[Member] = frozenset()
        self._reported: set[str] = set()
        self._before = bus.members()
        bus.watch(self._note)

    def join(self, *, sleep: Callable[[float], object] = time.sleep) -> None:
        """Join; raises BusError if a present recorder or a namesake excludes this process."""
        if self._role == VEHICLE and (refusal := self._refusal(self._before)):
            raise BusError(f"run {self.run}: {refusal}")
        self._refuse_namesake(self._before)
        self._bus.announce(self._role, self.name, self._chunk)
        sleep(SETTLE_S)
        self.check()

    def check(self) -> None:
        """Raise BusError for a namesake that joined at the same instant.

        The one with the lower session identifier stays. Where messages take long, namesakes notice
        each other only after `join`.
        """
        self._refuse_namesake([other for other in self._others if other.session < self._bus.zid])

    def keep_recorder(self) -> None:
        """Accept no other recorder from now on, as the run has started."""
        self._has_started = True

    @property
    def recorder_is_present(self) -> bool:
        return bool(self.run_id) and self.run_id in self._recorders()

    def _recorders(self) -> list[str]:
        return [other.name for other in self._mine() if other.role == RECORDER]

    @property
    def vehicles(self) -> set[str]:
        return {other.name for other in self._mine() if other.role == VEHICLE}

    def refusal(self) -> str:
        """Difference from the recorder that is present, if none has the own fingerprint."""
        return self._refusal(self._others)

    def excluded(self) -> dict[str, str]:
        """Differences that exclude present vehicles, by name, unless a namesake takes part."""
        present = self.vehicles
        return {
            other.name: difference
            for other in sorted(self._others, key=_order)
            if other.role == VEHICLE and other.name not in present
            if (difference := self._fingerprint.difference(other.fingerprint))
        }

    def new_warnings(self) -> list[str]:
        """Lines about members that do not take part or have other versions, each once."""
        lines = []
        for other in sorted(self._others, key=_order):
            if difference := self._fingerprint.difference(other.fingerprint):
                lines.append(f"{_named(other)} {difference}; it does not take part")
            elif versions := self._fingerprint.other_versions(other.fingerprint):
                lines.append(f"{_named(other)} runs {versions}: last digits may differ")
        new = [line for line in lines if line not in self._reported]
        new = new[: max(0, MOST_WARNINGS - len(self._reported))]
        self._reported.update(new)
        return new

    def _mine(self) -> list[Member]:
        return [other for other in self._others if self._takes_part(other)]

    def _takes_part(self, other: Member) -> bool:
        chunk = other.fingerprint
        return chunk == self._chunk or not self._fingerprint.difference(chunk)

    def _note(self, member: Member, alive: bool) -> None:
        if member.session == self._bus.zid:
            return
        self._others = self._others | {member} if alive else self._others - {member}
        if self.run_id and self._has_started:
            return
        recorders = self._recorders()
        if recorders and self.run_id not in recorders:
            self.run_id = recorders[0]

    def _refusal(self, others: Iterable[Member]) -> str:
        recorders = sorted((other for other in others if other.role == RECORDER), key=_order)
        if not recorders or any(map(self._takes_part, recorders)):
            return ""
        return f"{_named(recorders[0])} {self._fingerprint.difference(recorders[0].fingerprint)}"

    def _refuse_namesake(self, others: Iterable[Member]) -> None:
        for other in sorted(others, key=_order):
            if other.role != self._role:
                continue
            difference = self._fingerprint.difference(other.fingerprint)
            if self._role == RECORDER:
                which = f" that {difference}" if difference else ""
                raise BusError(
                    f"run {self.run}: there is a recorder already {_session(other)}{which}; "
                    "give another --run"
                )
            if other.name == self.name and not difference:
                raise BusError(
                    f"run {self.run}: there is a vehicle {self.name} already {_session(other)}; "
                    "give another --run"
                )


def _order(member: Member) -> tuple[str, str, str]:
    return member.role, member.name, member.session


def _named(member: Member) -> str:
    name = shown(member.name) if member.role == VEHICLE else f"the {shown(member.role)}"
    return f"{name} {_session(member)}"


def _session(member: Member) -> str:
    """Zenoh session of a process, which differs for a stranger of the same name."""
    return f"(session {shown(member.session)})"


class RecorderWatch:
    def __init__(self, membership: Membership, bus: Bus) -> None:
        self._membership = membership
        self._bus = bus
        self._met = False
        self._gone_since: int | None = None

    def has_left(self, now: int) -> bool:
        """Whether a recorder that was present has been absent for a while."""
        if self._membership.recorder_is_present:
            self._met, self._gone_since = True, None
        elif not self._bus.connected():
            self._gone_since = None
        elif self._gone_since is None:
            self._gone_since = now
        return self._met and self._gone_since is not None and now - self._gone_since > LEFT_AFTER_NS


# ---- Keeps the clock of each process on the recorder's, by queries over the bus
#
# Neither drift nor a wrong system clock then shows in a run. On one host all clocks are the same
# one from the beginning, and nothing is corrected.


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
