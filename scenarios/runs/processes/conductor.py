"""Decides when a run starts and when it is over, from the vehicles present and their messages."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from enum import Enum, auto

from pydantic import ValidationError

from scenarios.definition.schema.change_tables import CrashTable
from scenarios.results.record import CUT_OFF_AFTER_NS
from scenarios.runs.processes.membership import RouterWatch
from vehicles.messages import Change, Health, LogText, Message
from vehicles.schedule import SECOND, nanoseconds

FAILED_AFTER_NS = SECOND // 2
"""A vehicle has failed when its token has been absent this long with the router in reach."""
LEFT_AFTER_NS = SECOND
"""A vehicle with early final counters has left when its token has been absent this long.

The launcher needs up to a second to notice the end of the process and send the reason.
"""
RETURN_NS = SECOND
"""How much later than the recorder a vehicle may reconnect to a router."""
FINAL_COUNTERS_NS = 3 * SECOND
"""How long to wait for final counters after the end, the latest ones, an outage of the router or a
hold-up."""
SILENCE_NS = 12 * SECOND
"""The same if none arrived although all vehicles are present: perhaps the router does not respond,
which shows after the lease of the session, 10 s."""
HELD_UP_NS = SECOND
"""A longer time between two advances means that the recorder was held up."""
RESTART_NS = 5 * SECOND
"""How much later than requested a restarted process may return."""
REPORT_MISSING_AFTER_NS = 3 * SECOND
"""Missing vehicles are reported after this time, and at each later change."""
LEAD_TIME_NS = SECOND // 2
"""From the announcement to the start: time for all vehicles to prepare."""


class Phase(Enum):
    GATHERING = auto()
    RUNNING = auto()
    OVER = auto()


class Conductor:
    """Waits for the vehicles, sets the start, decides on the end. Instants are ns of Unix time."""

    kinds: frozenset[type[Message]] = frozenset({Change, Health, LogText})

    def __init__(
        self,
        vehicles: Sequence[str],
        *,
        duration_ns: int,
        continues_without_failed: bool,
        gather_until: int,
    ) -> None:
        """All of `vehicles` must be present by `gather_until`."""
        self.phase = Phase.GATHERING
        self.reason = ""
        self.start_at = 0
        self.excluded: Mapping[str, str] = {}
        """Why vehicles do not take part although their processes are there."""
        self.delivery_ns = 0
        """How long the announcement of the start may take to the vehicles (ns)."""
        self._vehicles = tuple(vehicles)
        self._duration_ns = duration_ns
        self._continues = continues_without_failed
        self._gather_until = gather_until
        self._alive: set[str] = set()
        self._gone_since: dict[str, int] = {}
        self._reported_at: dict[str, int] = {}
        self._silent_from: dict[str, int] = {}
        self._new_lines: list[str] = []
        self._failed: set[str] = set()
        self._finished: set[str] = set()
        self._early: dict[str, int] = {}
        self._left: set[str] = set()
        self._faults: dict[str, str] = {}
        self._excused: dict[str, int] = {}
        self._router = RouterWatch()
        self._patient_from = 0
        self._advanced_at: int | None = None
        self._report_missing_at: int | None = None
        self._reported_missing: list[str] = []

    @property
    def end_at(self) -> int:
        """Planned end of the run (ns), once it has started."""
        return self.start_at + self._duration_ns

    @property
    def taking_part(self) -> set[str]:
        """Vehicles that neither failed nor left."""
        return set(self._vehicles) - self._failed - self._left

    def note_presence(self, vehicle: str, *, alive: bool, at: int) -> None:
        if vehicle not in self._vehicles:
            return
        if alive:
            self._alive.add(vehicle)
            self._gone_since.pop(vehicle, None)
        else:
            self._alive.discard(vehicle)
            self._gone_since.setdefault(vehicle, at)

    def listen(self, at: int, message: Message) -> None:
        """Note vehicles that have finished or failed."""
        if isinstance(message, LogText) and message.ends_vehicle:
            self._faults.setdefault(message.vehicle, message.text)
        if isinstance(message, Health) and message.vehicle in self._vehicles:
            self._note_report(message.vehicle, at)
        if isinstance(message, Health) and message.final and message.vehicle in self._vehicles:
            self._finished.add(message.vehicle)
            self._patient_from = max(self._patient_from, at)  # the others may be as late
            if message.reported_at_ns < self.end_at:
                self._early.setdefault(message.vehicle, at)

        if isinstance(message, Change):
            self._excuse(message)

    def _note_report(self, vehicle: str, at: int) -> None:
        """Note a report; a failed vehicle that reports again is back."""
        self._reported_at[vehicle] = at
        if vehicle in self._failed and vehicle in self._alive:
            self._failed.remove(vehicle)
            away_s = (at - self._silent_from[vehicle]) / SECOND
            self._new_lines.append(f"{vehicle} is back after {away_s:.1f} s")

    def _excuse(self, change: Change) -> None:
        """Allow a vehicle to be absent for the time of a requested crash."""
        with suppress(ValidationError):  # messages from the bus may be malformed
            crash = CrashTable.model_validate_json(change.table)
            if crash.for_s is not None:
                back_at = change.effective_at_ns + nanoseconds(crash.for_s)
                self._excused[change.vehicle] = back_at + RESTART_NS
                # If the run ends meanwhile, its new process has to send the final counters.
                again_at = change.effective_at_ns + RESTART_NS
                self._patient_from = max(self._patient_from, again_at)

    def missing(self) -> list[str]:
        return [name for name in self._vehicles if name not in self._alive]

    def awaits_final_counters(self) -> bool:
        return bool(self._alive - self._finished)

    def advance(self, now: int, *, connected: bool, recorded_until: int | None = None) -> list[str]:
        """Advance to `now`; returns lines for the log and the user.

        A recorder that is behind knows only messages that arrived until `recorded_until` (ns).
        """
        if self._advanced_at is not None and now - self._advanced_at > HELD_UP_NS:
            held_up_s = (now - self._advanced_at) / SECOND
            self._new_lines.append(f"the recorder was held up for {held_up_s:.1f} s")
            self._await_return(now)
        self._advanced_at = now
        if self.phase is Phase.GATHERING:
            return self._gather(now)
        if self.phase is Phase.RUNNING:
            known_until = now if recorded_until is None else min(now, recorded_until)
            return self._run(now, known_until, connected=connected)
        return []

    def stop(self, reason: str) -> None:
        """End the run now; the first reason stays."""
        if self.phase is not Phase.OVER:
            self.phase = Phase.OVER
            self.reason = reason

    def _gather(self, now: int) -> list[str]:
        missing = self.missing()
        if not missing:
            self.phase = Phase.RUNNING
            self.start_at = now + LEAD_TIME_NS + self.delivery_ns
            return [f"all {len(self._vehicles)} vehicles are present"]
        if now > self._gather_until:
            self.stop(f"not present in time: {self._named(missing)}")
            return []
        return self._report_missing(now, missing)

    def _report_missing(self, now: int, missing: list[str]) -> list[str]:
        if self._report_missing_at is None:
            self._report_missing_at = now + REPORT_MISSING_AFTER_NS
        if now < self._report_missing_at or missing == self._reported_missing:
            return []
        self._reported_missing = missing
        return [f"waiting for {self._named(missing)}"]

    def _named(self, missing: list[str]) -> str:
        """List missing vehicles, with what excludes them from the run."""
        return ", ".join(
            f"{name} ({self.excluded[name]})" if name in self.excluded else name for name in missing
        )

    def _run(self, now: int, known_until: int, *, connected: bool) -> list[str]:
        lines, self._new_lines = self._new_lines, []
        outage = self._router.look(now, connected=connected)
        if self._router.lost_at is not None:
            if not self._awaited():
                self._end_as_planned()
            elif self._router.is_lost_for_good(now):
                self.stop(self._when_lost())
            return lines
        if outage:
            lines.append(f"the router was out of reach for {outage / SECOND:.1f} s")
            self._await_return(now)
        if not self._continues:
            for vehicle, why in self._faults.items():
                self.stop(f"{vehicle}: {why}")
        lines += self._count_failed(known_until)
        lines += self._count_early(known_until)
        self._end_if_over(known_until)
        return lines

    def _await_return(self, now: int) -> None:
        """Give vehicles time to return after an outage of the router or of the recorder itself."""
        self._patient_from = now
        self._gone_since = dict.fromkeys(self._gone_since, now + RETURN_NS)

    def _when_lost(self) -> str:
        before_end = self.end_at - (self._router.lost_at or 0)
        when = f"{abs(before_end) / SECOND:.1f} s {'after' if before_end < 0 else 'before'}"
        return f"the router was lost {when} the end"

    def _end_if_over(self, now: int) -> None:
        vehicles = set(self._vehicles)
        if self._failed >= vehicles:
            self.stop("all vehicles failed")
        elif self._failed | self._left >= vehicles:
            self.stop("all vehicles failed or left")
        elif not (awaited := self._awaited()):
            self._end_as_planned()
        elif now > max(self.end_at, self._patient_from) + self._patience_ns:
            self.stop(f"no final counters from {', '.join(sorted(awaited))}")

    @property
    def _patience_ns(self) -> int:
        all_silent = not self._finished and self._alive == set(self._vehicles)
        return SILENCE_NS if all_silent else FINAL_COUNTERS_NS

    def _awaited(self) -> set[str]:
        """Vehicles of which the final counters are missing."""
        return set(self._vehicles) - self._finished - self._failed

    def _end_as_planned(self) -> None:
        if self._left == self._early.keys():  # else the reason of the last one is not known yet
            self.stop("")

    def _count_failed(self, now: int) -> list[str]:
        lines: list[str] = []
        for name, since in self._gone_since.items():
            if name in self._finished | self._failed or now - since < FAILED_AFTER_NS:
                continue
            if now < self._excused.get(name, now):
                continue
            self._failed.add(name)
            never = self.start_at if self._reported_at else since  # while others reported
            self._silent_from[name] = min(since, self._reported_at.get(name, never))
            line = self._failure(name, since)
            if self._continues:
                lines.append(f"{line}; the convoy continues without it")
            else:
                self.stop(line)
        return lines

    def _failure(self, name: str, since: int) -> str:
        """Describe the loss of a vehicle whose token has been absent since an instant (ns)."""
        silent_from = self._silent_from[name]
        if since - silent_from < CUT_OFF_AFTER_NS:
            return f"{name} failed {self._when(since)}"
        return f"{name} was cut off or stopped responding {self._when(silent_from)}"

    def _count_early(self, now: int) -> list[str]:
        lines: list[str] = []
        for name, at in self._early.items():
            if name in self._left or not self._has_left(name, at, now):
                continue
            if self._continues:
                self._left.add(name)
                lines.append(f"{name} left {self._when(at)}; the convoy continues without it")
            else:
                self.stop(f"left before the end: {', '.join(sorted(self._early))}")
        return lines

    def _has_left(self, name: str, finished_at: int, now: int) -> bool:
        """Whether a vehicle with early final counters has left or will not send any more."""
        gone_since = self._gone_since.get(name)
        if gone_since is None:
            return now - finished_at > FINAL_COUNTERS_NS
        return now - gone_since > LEFT_AFTER_NS

    def _when(self, at: int) -> str:
        seconds = (at - self.start_at) / SECOND
        return f"{seconds:.1f} s after the start" if seconds >= 0.0 else "before the start"
