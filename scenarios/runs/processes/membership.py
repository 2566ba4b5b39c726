"""Members of a run: processes with the recorder's fingerprint, each name once."""

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, fields

from scenarios.definition.scenario import Scenario
from scenarios.results.versions import current_stamp, plug_in_digests
from transport.bus.bus import Bus, BusError, Member
from transport.texts import printable
from vehicles.schedule import SECOND

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
