"""Members of a run: each process joins once, or is refused with the difference."""

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from scenarios.definition.scenario import Scenario
from scenarios.results.versions import installed_versions
from transport.bus.bus import Bus, BusError, Member
from transport.texts import printable
from vehicles.schedule import SECOND

RECORDER, VEHICLE = "recorder", "vehicle"
SETTLE_S = 0.2
"""Time after which two joining processes see each other's announcement."""
LEFT_AFTER_NS = 2 * SECOND
"""The recorder has left when its token has been absent this long with the router in reach."""
LONGEST_SHOWN = 60
"""Length of text from other processes in messages."""
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


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """What must be equal in all processes of a run: scenario, overrides, seed, version.

    `digest` is that of the scenario's content except its name and its seed.
    """

    scenario: str
    seed: str
    version: str
    digest: str

    @classmethod
    def of(cls, scenario: Scenario) -> "Fingerprint":
        here = installed_versions()["convoy-emulator"]
        return cls(scenario.name, str(scenario.seed), here, scenario.digest)

    @property
    def chunk(self) -> str:
        return "~".join((self.scenario, self.seed, self.version, self.digest))

    def difference(self, chunk: str) -> str:
        """Describe how another fingerprint differs from this one; empty if it does not."""
        if chunk == self.chunk:
            return ""
        parts = chunk.split("~")
        if len(parts) != 4:
            return f"another version of the program, here it is {self.version}"
        other = Fingerprint(*map(shown, parts))
        rows = (
            ("version", other.version, self.version),
            ("scenario", other.scenario, self.scenario),
            ("seed", other.seed, self.seed),
        )
        differences = [
            f"{name} {theirs}, here it is {ours}" for name, theirs, ours in rows if theirs != ours
        ]
        return (
            "; ".join(differences) or f"another content of scenario {self.scenario} (file or --set)"
        )


class Membership:
    """Takes part in a run for this process and tracks the other members.

    Only a joining process checks, so it never harms present members.
    """

    def __init__(self, bus: Bus, run: str, role: str, name: str, fingerprint: Fingerprint) -> None:
        """Start to watch members; `join` announces this process."""
        self.run = run
        self.name = name
        self._bus = bus
        self._role = role
        self._fingerprint = fingerprint
        self._others: frozenset[Member] = frozenset()
        self._before = bus.members()
        bus.watch(self._note)

    def join(self, *, sleep: Callable[[float], object] = time.sleep) -> None:
        """Join; raises BusError on an equal name or another fingerprint.

        Of two that join at the same instant the one with the lower session identifier stays.
        """
        self._refuse(self._before)
        self._bus.announce(self._role, self.name, self._fingerprint.chunk)
        sleep(SETTLE_S)
        self._refuse({other for other in self._others if other.session < self._bus.zid})

    @property
    def recorder_is_present(self) -> bool:
        return any(other.role == RECORDER for other in self._mine())

    @property
    def vehicles(self) -> set[str]:
        return {other.name for other in self._mine() if other.role == VEHICLE}

    def _mine(self) -> list[Member]:
        chunk = self._fingerprint.chunk
        return [other for other in self._others if other.fingerprint == chunk]

    def _note(self, member: Member, alive: bool) -> None:
        if member.session == self._bus.zid:
            return
        self._others = self._others | {member} if alive else self._others - {member}

    def _refuse(self, others: Iterable[Member]) -> None:
        # Compare with the recorder first.
        for other in sorted(others, key=lambda member: (member.role, member.name, member.session)):
            member = "the recorder" if other.role == RECORDER else shown(other.name)
            if difference := self._fingerprint.difference(other.fingerprint):
                raise BusError(f"run {self.run}: {member} has {difference}")
            if (other.role, other.name) == (self._role, self.name):
                duplicate = "a recorder" if other.role == RECORDER else f"a vehicle {other.name}"
                raise BusError(f"run {self.run}: there is {duplicate} already; give another --run")


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
