"""`convoy record`: gathers the convoy, starts it, writes its log and ends it."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.end_confirmation import EndConfirmations
from scenarios.runs.live import LiveRun
from scenarios.runs.node.sink import BATCH_NS
from scenarios.runs.observer import Observer, ThrottledObservers, Watcher
from scenarios.runs.processes.arrivals import Arrival, Arrivals, SendingOrder
from scenarios.runs.processes.conductor import RETURN_NS, Conductor, Phase
from scenarios.runs.processes.membership import (
    ROUTER_LOST_AFTER_NS,
    ClockOffset,
    ClockServer,
    Membership,
)
from scenarios.runs.run_log import RunLog
from scenarios.runs.run_status import StatusBoard
from scenarios.runs.stop import Stop
from transport.bus.bus import Bus
from transport.bus.telemetry import MAX_RECORDS_BYTES, records_key
from transport.clock import SYSTEM_TIME, SystemTime, WallClock, poll
from transport.codec import RefusedMessageError, encode
from transport.log.errors import LogError
from transport.topics import RUN_SENDER, TOPICS, key
from vehicles.messages import RunEnd
from vehicles.schedule import MILLISECOND, SECOND, Timer

POLL_S = 0.02
FLUSH_NS = SECOND // 5
"""Between two flushes of the log; a kill loses at most half a second."""
HELD_NS = BATCH_NS + SECOND // 10
"""How long a message waits for earlier ones in a batch."""
MOST_WAITING = 2000
"""Waiting messages and batches up to which the picture is drawn, two thirds of a second of a
hundred vehicles."""
MOST_AT_ONCE = 200
"""Messages and batches recorded between two looks at the run."""
BEHIND_NS = SECOND
"""A recorder further behind at the end of the run logs a warning."""
SHOW_NS = SECOND // 5
"""Between two looks for warnings about members."""
UPDATE_NS = SECOND // 2
"""Between two evaluations of the last seconds."""
ANNOUNCE_NS = SECOND // 4
"""Between two announcements of the start, for vehicles that subscribe late."""
EVERYTHING = "convoy/**"
GATHER_S = 60.0
CANCELLED_NS = SECOND
"""How long the recorder of a run that ends early waits for the vehicles' final counters."""
SHORT_TIMEOUT_S = 0.2
"""Patience with a router that brought no answer."""
CONFIRM_NS = 30 * SECOND
"""How long the recorder of a completed run waits for the vehicles to end.

A suspended vehicle is a member for 10 s, the lease of its session.
"""
RECONNECT_NS = ROUTER_LOST_AFTER_NS + RETURN_NS
"""How long it waits for a vehicle that left without a confirmation, and may be cut off."""


class RecorderProcess:
    """The recorder as a process: records what arrives, starts and ends the run."""

    def __init__(
        self,
        scenario: Scenario,
        bus: Bus,
        folder: Path,
        stop: Stop,
        membership: Membership,
        *,
        gather_s: float = GATHER_S,
        observers: Sequence[Observer] = (),
        watchers: Sequence[Watcher] = (),
        system: SystemTime = SYSTEM_TIME,
    ) -> None:
        """Prepare to record; the name of the member is the identifier of the run."""
        self._time = system
        self._clock = WallClock(system=system)
        self._bus = bus
        self._stop = stop
        self._membership = membership
        self._present: set[str] = set()
        self._settled_at = 0
        self._seen_at: dict[str, int] = {}
        self._is_completed = False
        self._clock_uncertainty_ns_max = scenario.clock_uncertainty_ns_max
        self._run_id = run_id = membership.name
        self._clock_server = ClockServer(bus, self._clock.now, scenario.vehicle_names, run_id)
        self._clock_offsets: dict[str, ClockOffset] = {}
        self._confirmations = EndConfirmations(bus, scenario.vehicle_names, run_id)
        self._conductor = Conductor(
            scenario.vehicle_names,
            duration_ns=round(scenario.duration_s * SECOND),
            continues_without_failed=scenario.continues_without_failed,
            gather_until=self._clock.now() + round(gather_s * SECOND),
        )
        self._live = LiveRun(scenario)
        self._board = StatusBoard(scenario, membership.run)
        self._watchers = [self._board, *watchers]
        self._shown = ThrottledObservers(observers, self._is_log_behind)
        self._run = RunLog(
            scenario,
            folder,
            clock="wall",
            run_id=run_id,
            live=self._live,
            observers=(self._conductor, self._live, self._shown),
        )
        self._announcing, self._reporting = Timer(ANNOUNCE_NS), Timer(SECOND)
        self._flushing, self._showing = Timer(FLUSH_NS), Timer(SHOW_NS)
        self._updating = Timer(UPDATE_NS)
        self._own: list[tuple[str, bytes]] = []
        batches = {
            records_key(name): {topic.name: key(name, topic) for topic in TOPICS.values()}
            for name in scenario.vehicle_names
        }
        self._arrivals = Arrivals(
            self._run.recorder.keys,
            larger=dict.fromkeys(batches, MAX_RECORDS_BYTES),
            system=system,
        )
        self._in_order = SendingOrder(batches)
        self._reported_behind = False
        self._board.serve(bus)
        bus.subscribe(EVERYTHING, self._arrive)

    def record_until_over(self) -> RunSummary:
        """Record until the run is over and complete the log; returns the summary."""
        while self._conductor.phase is not Phase.OVER:
            try:
                self._record_arrivals()
                self._advance()
            except LogError as error:  # the disk is full, or the log was removed
                self._conductor.stop(str(error))
        with suppress(LogError):  # the run has a reason to end already
            self._record_arrivals()
        if self._shown.skipped:
            count = self._shown.skipped
            line = f"the picture skipped {count} messages while the log was behind; they are logged"
            self._run.recorder.log(self._clock.now(), line, "warning")
        end = self._run.end(self._clock.now(), self._conductor.reason)
        for watcher in self._watchers:
            watcher.update(self._live)
        self._own_message("end", end)
        self._is_completed = not self._run.reason
        if self._conductor.reason:
            self._announce_end()
            self._await_final_counters()
        self._run.recorder.rejected.update(self._arrivals.error_lines())
        summary = self._run.close(self._clock.now())
        if self._is_completed and summary.reason:  # the log or the summary could not be written
            self._is_completed = False
            self._own_message("end", encode(self._end_message(summary.reason)))
        return summary

    def _end_message(self, reason: str) -> RunEnd:
        """End of the run for the vehicles; the log holds another one."""
        return RunEnd(
            vehicle=RUN_SENDER,
            seq=0,
            end_at_ns=self._clock.now(),
            reason=reason,
            run_id=self._run_id,
        )

    def announce_completion(self) -> list[str]:
        """Announce that the log is complete; vehicles wait for that before they end.

        The announcement of a completed run is repeated until the vehicles have ended, also while
        the router is away. That of a failed run was sent before. Returns the vehicles that have not
        confirmed it in time.
        """
        self._announce_end()
        if self._conductor.reason:
            return []
        begun = self._clock.now()
        self._settled_at = begun
        poll(
            lambda: self._stop.requested or self._all_ended(begun),
            every_s=POLL_S,
            system=self._time,
        )
        if self._stop.requested:
            return []
        return sorted(self._unconfirmed())

    def _unconfirmed(self) -> set[str]:
        """Vehicles that take a completed run for a failed one if they do not learn its end."""
        if not self._is_completed:
            return set()
        taking_part = self._conductor.taking_part | self._membership.vehicles
        return taking_part - self._confirmations.received

    def _announce_end(self) -> None:
        """Publish the end of the run.

        A stopped recorder without vehicles need not wait for a router that does not read.
        """
        if self._membership.vehicles or not self._stop.requested:
            self._bus.publish(*self._own[-1], urgent=True)

    def _all_ended(self, begun: int) -> bool:
        """Repeat the end; whether no vehicle waits for it any more."""
        now = self._clock.now()
        if self._announcing.is_due(now):
            self._announce_end()
        if not self._bus.connected():
            self._settled_at = now + RETURN_NS
            return now > begun + ROUTER_LOST_AFTER_NS
        if now < self._settled_at:  # the vehicles are still on their way back to the router
            return False
        present = self._membership.vehicles
        self._seen_at.update(dict.fromkeys(present, now))
        return now > self._settled_at + CONFIRM_NS or not present | {
            name
            for name in self._unconfirmed()
            if now < self._seen_at.get(name, begun) + RECONNECT_NS
        }

    def _await_final_counters(self) -> None:
        until = self._clock.now() + CANCELLED_NS
        while self._clock.now() < until and self._conductor.awaits_final_counters():
            with suppress(LogError):  # the run has a reason to end already
                self._record_arrivals()
            self._note_presences(self._clock.now())
        if self._conductor.awaits_final_counters():  # the router may hang
            self._bus.close_timeout_s = SHORT_TIMEOUT_S

    def _log_clocks(self, now: int) -> None:
        """Log the offsets of the vehicles' clocks, and warn of one that moved."""
        for vehicle, offset in sorted(self._clock_server.offsets.items()):
            before = self._clock_offsets.get(vehicle)
            if offset is before:
                continue
            self._clock_offsets[vehicle] = offset
            self._run.recorder.log(now, str(offset), "debug")
            moved = 0 if before is None else offset.offset - before.offset
            if abs(moved) > self._clock_uncertainty_ns_max:
                text = (
                    f"the clock of {vehicle} moved by {moved / MILLISECOND:.1f} ms during the run"
                )
                self._run.recorder.log(now, f"{text}: messages may be late", "alert")

    def _unready(self, vehicle: str) -> str:
        """Why a vehicle that takes part cannot start; empty if it can."""
        offset = self._clock_server.offsets.get(vehicle)
        if offset is None:
            return "its clock is not measured yet"
        if offset.uncertainty > self._clock_uncertainty_ns_max:
            allowed_ms = self._clock_uncertainty_ns_max / MILLISECOND
            return (
                f"its clock is known within {offset.uncertainty / MILLISECOND:.1f} ms, "
                f"needed are {allowed_ms:g} ms: half of links.latency_ms, "
                "or convoy.clock_uncertainty_ms_max"
            )
        return ""

    def _note_presences(self, now: int) -> None:
        """Note which vehicles take part, and what excludes others from the run."""
        members = self._membership.vehicles
        excluded = self._membership.excluded()
        present = members
        if self._conductor.phase is Phase.GATHERING:
            for vehicle in self._clock_server.offsets.keys() - members:
                self._clock_server.offsets.pop(vehicle, None)
            offsets = self._clock_server.offsets.values()
            self._conductor.delivery_ns = 2 * max((o.uncertainty for o in offsets), default=0)
            unready = {name: why for name in members if (why := self._unready(name))}
            excluded |= unready
            present = members - unready.keys()
        for vehicle in sorted(present ^ self._present):
            self._conductor.note_presence(vehicle, alive=vehicle in present, at=now)
        self._present = present
        self._conductor.excluded = excluded

    def _own_message(self, topic: str, data: bytes) -> tuple[str, bytes]:
        """Return a message of the run with its key; it is not recorded again from the bus."""
        own = key(RUN_SENDER, TOPICS[topic]), data
        self._own.append(own)
        return own

    def _arrive(self, key_expression: str, data: bytes) -> None:
        self._arrivals.put(self._clock.now(), key_expression, data)

    def _record_arrivals(self) -> None:
        """Record up to MOST_AT_ONCE arrivals; wait up to `POLL_S` for that many.

        The rest is left for the next call, so that a flood does not keep the run from advancing.
        """
        self._run.recorder.rejected.update(self._arrivals.error_lines())
        is_over = self._conductor.phase is Phase.OVER
        most = max(1, len(self._arrivals)) if is_over else MOST_AT_ONCE
        for arrival in self._arrivals.take(most, POLL_S):
            if arrival[1:] not in self._own:
                self._put_in_order(arrival)
        sent_until = None if is_over else self._clock.now() - HELD_NS
        for at, key_expression, data in self._in_order.until(sent_until):
            self._run.recorder.accept(key_expression, data, at)

    def _put_in_order(self, arrival: Arrival) -> None:
        try:
            self._in_order.put(arrival)
        except RefusedMessageError as refusal:
            self._run.recorder.rejected[refusal.reason] += 1

    def _advance(self) -> None:
        now = self._clock.now()
        self._note_presences(now)
        self._note_requests()
        recorded_until = self._arrivals.came_first_at or self._clock.now()
        now = self._clock.now()
        connected = self._bus.connected()
        for line in self._conductor.advance(
            now, connected=connected, recorded_until=recorded_until
        ):
            self._run.recorder.log(now, line)
        if self._conductor.phase is Phase.RUNNING:
            self._warn_if_behind(now, now - recorded_until)
            self._log_clocks(now)
            if not self._own:
                self._own_message("start", self._run.start(now, self._conductor.start_at))
            if self._announcing.is_due(now):
                self._bus.publish(*self._own[0], urgent=True)
            if self._reporting.is_due(now):
                self._run.recorder.report_health(now)
        if self._showing.is_due(now):
            for line in self._membership.new_warnings():
                self._run.recorder.log(now, line, "warning")
        if self._flushing.is_due(now):
            self._run.flush()
        if self._updating.is_due(now):
            self._update(now)

    def _is_log_behind(self) -> bool:
        return len(self._arrivals) > MOST_WAITING

    def _update(self, now: int) -> None:
        """Evaluate the last seconds; while the log is behind, nothing is shown."""
        if not self._is_log_behind() and self._run.update(now):
            for watcher in self._watchers:
                watcher.update(self._live)

    def _warn_if_behind(self, now: int, behind: int) -> None:
        """Warn once that a run whose time is up still records."""
        if behind > BEHIND_NS and now > self._conductor.end_at and not self._reported_behind:
            self._reported_behind = True
            line = f"the log is {behind / SECOND:.1f} s behind; it is completed before the run ends"
            self._run.recorder.log(now, line, "warning")

    def _note_requests(self) -> None:
        if self._stop.requested:
            self._conductor.stop(self._stop.reason)
        elif early := self._run.early_end:
            self._conductor.stop(early.reason)
