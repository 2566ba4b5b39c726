"""`convoy vehicle`: one vehicle as a process of its own, over Zenoh, on the wall clock."""

from collections.abc import Callable, Iterable, Iterator
from itertools import dropwhile
from math import ceil

from scenarios.definition.scenario import Scenario
from scenarios.results.link_account import LAST_LOOK_NS
from scenarios.runs.end_confirmation import confirm_end
from scenarios.runs.live_control import LiveControl
from scenarios.runs.node.node import AnyNode, VehicleFaultError, step_with_faults
from scenarios.runs.node.process_probe import THIS_MACHINE, Machine, ProcessProbe
from scenarios.runs.node.sink import BatchingSink
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.processes.membership import (
    VEHICLE,
    ClockSync,
    Fingerprint,
    Membership,
    RecorderWatch,
    RouterWatch,
)
from scenarios.runs.processes.restart import ProcessHandover, RestartRequestedError
from scenarios.runs.stop import EXIT_FAILED, Stop
from transport.bus.bus import Bus, BusError, Fetch
from transport.bus.zenoh_bus import ZenohOptions
from transport.clock import (
    SYSTEM_TIME,
    Clock,
    SystemTime,
    Tick,
    WallClock,
    late_threshold,
    poll,
)
from transport.codec import RefusedMessageError, decode
from transport.links.inbox import QUEUE, Inbox, IncomingLink
from transport.links.link import GPS
from transport.links.true_poses import KEPT, TRUTH
from transport.topics import RUN_SENDER, TOPICS, Topic, key
from vehicles.messages import Change, Health, Message, RunEnd, RunStart
from vehicles.schedule import SECOND, Timer

POLL_S = 0.01
LEFT_S = 3.0
"""How long a restarted process waits until the old one has left."""
WATCH_NS = SECOND // 4
"""Between two checks of router and recorder, and after the end between two repetitions of the final
counters."""
END_NS = 60 * SECOND
"""How long a finished vehicle waits for an announcement of a recorder that is present."""
UNKNOWN_END = "has an unknown end"
"""Outcome of a run for a vehicle with final counters that cannot receive the end."""
FAULT_S = 8.0
"""How long a vehicle with a fault waits for the end of the run."""
HELD_UP_NS = SECOND // 5
"""Lateness of a tick from which the whole process counts as held up."""
SETTLING_S = 0.02
"""Time for the transport to deliver messages after a hold-up."""
WAITING_S = 10.0
"""Time for which poses are queued while this process does not fetch them."""
Report = Callable[[str], None]


def run_vehicle(
    scenario: Scenario,
    name: str,
    options: ZenohOptions,
    stop: Stop,
    *,
    report: Report,
    report_error: Report,
    launched: bool,
    wait_s: float,
    before: ProcessHandover | None = None,
    machine: Machine = THIS_MACHINE,
) -> int:
    """Drive vehicle `name` of `scenario` for one run; returns the exit code.

    `report` and `report_error` print lines. A `launched` vehicle does not repeat announcements of
    the recorder, which its launcher prints. `before` is the handover of the process that this one
    replaces. Raises RestartRequestedError when the process has to restart.
    """
    builder = VehicleBuilder(scenario, name)
    try:
        with machine.open_bus(options) as bus:
            stop.begun = True
            if before is not None:
                await_replaced_process(bus, name, machine.time)
            member = Membership(
                bus,
                options.run,
                VEHICLE,
                name,
                Fingerprint.of(scenario),
                run_id=before.run_id if before else "",
            )
            vehicle = VehicleProcess(builder, bus, member, stop, before=before, machine=machine)
            vehicle.await_start(report, wait_s)
            vehicle.drive(report)
    except VehicleFaultError as fault:
        if launched:  # the recorder reports it
            return 0 if vehicle.is_cancelled else EXIT_FAILED
        report_error(str(fault))
        return EXIT_FAILED
    except RunCancelledError as error:
        if launched and error.announced:
            return 0
        report_error(f"{name}: {error}")
        return EXIT_FAILED
    return vehicle.exit_code


def await_replaced_process(bus: Bus, name: str, system: SystemTime) -> None:
    """Wait until the process that this one replaced is no longer a member."""

    def has_left() -> bool:
        return all((member.role, member.name) != (VEHICLE, name) for member in bus.members())

    poll(has_left, every_s=POLL_S, at_most_s=LEFT_S, system=system)


class RunCancelledError(Exception):
    """The run has ended or never started; `announced` if by the recorder."""

    def __init__(self, text: str, *, announced: bool = False) -> None:
        super().__init__(text)
        self.announced = announced


class RunAnnouncements:
    """Start and end of the run as the recorder announced them.

    Bytes of other messages may decode as a start: they are recognised by the vehicle that they
    name. Start and end count only with the identifier of the run. An end without a start cancels
    the run.
    """

    def __init__(self, bus: Bus, membership: Membership, now: Callable[[], int]) -> None:
        self.start: RunStart | None = None
        self.end: RunEnd | None = None
        self.is_refused = False
        """Whether a run starts whose recorder excludes this vehicle."""
        self.last_received_at = 0
        """Instant (ns) of the last announcement; they are repeated while the run is on."""
        self.foreign = 0
        """Count of starts and ends of another run."""
        self._now = now
        self._membership = membership
        for name in ("start", "end"):
            bus.subscribe(key(RUN_SENDER, TOPICS[name]), self._receive)

    def _receive(self, key_expression: str, data: bytes) -> None:
        try:
            message = decode(TOPICS[key_expression.rsplit("/", 1)[-1]], data, exact=True)
        except RefusedMessageError:
            return
        if message.vehicle != RUN_SENDER or not isinstance(message, RunStart | RunEnd):
            return
        if not (run_id := self._membership.run_id) or message.run_id != run_id:
            self.foreign += bool(run_id)
            self.is_refused |= isinstance(message, RunStart) and bool(self._membership.refusal())
            return
        if isinstance(message, RunStart):
            self.start = self.start or message
            self._membership.keep_recorder()
        else:
            self.end = self.end or message
        self.last_received_at = self._now()


class VehicleProcess:
    """A vehicle from joining to the end of the run."""

    def __init__(
        self,
        builder: VehicleBuilder,
        bus: Bus,
        membership: Membership,
        stop: Stop,
        *,
        before: ProcessHandover | None = None,
        machine: Machine = THIS_MACHINE,
    ) -> None:
        """Join the run; raises BusError if it refuses this vehicle.

        `before` is the handover of the process that this one continues.
        """
        self._builder = builder
        self._bus = bus
        self._membership = membership
        self._stop = stop
        self._before = before
        self._machine, self._time = machine, machine.time
        setting = before.clock if before else None
        self._clock = WallClock(lambda: stop.requested, setting, machine.time)
        self._clock_sync = ClockSync(
            bus,
            builder.name,
            self._clock,
            lambda: membership.run_id,
            sufficient_ns=builder.scenario.clock_uncertainty_ns_max,
            running=before is not None,
        )
        self._joined_at = self._clock.monotonic()
        self._announced = RunAnnouncements(bus, membership, self._clock.now)
        self._recorder = RecorderWatch(membership, bus)
        self._router = RouterWatch()
        self._watching = Timer(WATCH_NS)
        self._foreign_counted = 0
        self._repeated: list[tuple[str, bytes]] = list(before.changes) if before else []
        """Changes by hand, and at last the final counters, with their keys."""
        self._fetches: list[Fetch] = []
        self.exit_code = 0
        self._control = LiveControl(builder.scenario, builder.name, self._clock.now)
        self._control.listen(bus, lambda: membership.run_id)
        membership.join(sleep=machine.time.sleep)

    @property
    def _run(self) -> str:
        return f"run {self._membership.run}"

    @property
    def is_cancelled(self) -> bool:
        return self._stop.requested or self._announced.end is not None

    def await_start(self, report: Report, wait_s: float) -> None:
        """Wait for the start; raises RunCancelledError if there will be none for this vehicle.

        Returns at once after a restart.
        """
        if self._before is not None:
            return
        waits = "the start" if self._membership.recorder_is_present else "the recorder"
        report(f"{self._builder.name}: joined, waiting for {waits} of {self._run}")
        came = poll(
            lambda: self._has_waited(report), every_s=POLL_S, at_most_s=wait_s, system=self._time
        )
        start, end = self._announced.start, self._announced.end
        if self._stop.requested:
            return
        if refusal := self._membership.refusal():
            raise BusError(f"{self._run}: {refusal}")
        if not came:
            unmeasured = start is not None or self._membership.recorder_is_present
            why = ": its recorder's clock gave no answer" if unmeasured else ""
            why = "" if self._clock_sync.is_measured else why
            raise RunCancelledError(f"{self._run} did not start within {wait_s:g} s{why}")
        if start is not None:
            if start.start_at_ns <= self._clock.at(self._joined_at):
                raise RunCancelledError(f"{self._run} had started before this vehicle joined")
            self._clock_sync.running = True
        elif end is not None:
            raise RunCancelledError(
                f"{self._run} was cancelled: {end.reason or 'it is over'}", announced=True
            )
        else:
            raise RunCancelledError(f"{self._run} was cancelled: its recorder has left")

    def _has_waited(self, report: Report) -> bool:
        """Whether the wait for the start is over; report what excludes other members."""
        for line in self._membership.new_warnings():
            report(f"{self._builder.name}: {line}")
        self._membership.check()
        self._clock_sync.advance()
        return (
            (self._announced.start is not None and self._clock_sync.is_measured)
            or self.is_cancelled
            or self._announced.is_refused
            or self._recorder.has_left(self._clock.now())
        )

    def drive(self, report: Report) -> None:
        """Drive to the end of the run, send the final counters, wait for the recorder's end.

        Raises RunCancelledError when the run cannot continue, VehicleFaultError after announcing a
        fault of the vehicle, and RestartRequestedError when the process has to restart.
        """
        start_at = self._start_at
        if start_at is None:  # stopped before
            self.exit_code = self._stop.exit_code
            return
        before = self._before
        end_at = start_at + self._builder.duration_ns
        late_after_ns = late_threshold(self._builder.control_rate_hz)
        probe = self._machine.make_probe(
            late_after_ns,
            before.lateness if before else None,
            lambda: (self._clock_sync.offset, self._clock_sync.uncertainty),
        )
        is_measured = self._builder.scenario.is_measured(self._builder.name)
        sink = BatchingSink(
            self._builder.name,
            self._bus,
            self._clock.now,
            self._keep_if_repeated,
            logged_hz=self._builder.scenario.tables.log.rates_hz,
            unbatched={TRUTH.name} if is_measured else (),
        )
        node = self._builder.node(start_at, sink, probe, before.node if before else None)
        self._fetches = [
            self._bus.collect(
                key(sender, GPS), node.inbox.on_bytes, queue_limit(link), self._clock.now
            )
            for sender, link in node.inbox.links.items()
        ]
        if (target := self._builder.target) is not None:
            collect = self._bus.collect
            self._fetches.append(collect(target.key, target.on_bytes, KEPT, self._clock.now))
        self._control.begin(start_at, node.pending_changes)
        report(f"{self._builder.name}: {self._run} {'continues' if before else 'starts'}")
        self._drive(node, start_at, probe, sink)
        self._clock.wait_until(0 if self._announced.end is not None else end_at)
        finished = not self._stop.requested
        ended_at = min(self._clock.now(), end_at)
        self._time.sleep(LAST_LOOK_NS / SECOND)
        self._fetch(node.inbox)
        self._repeat()
        node.outbox.publish_health(ended_at, final=True)
        while not self.is_cancelled:
            self._repeat_final_counters(end_at)
            self._time.sleep(POLL_S)
        end = self._announced.end
        if end is None or not finished:
            self.exit_code = self._stop.exit_code
            return
        if reason := end.reason:
            raise RunCancelledError(f"{self._run} failed: {reason}", announced=True)
        confirm_end(self._bus, self._builder.name, self._membership.run_id, self._time)
        report(f"{self._builder.name}: {self._run} is over")

    @property
    def _start_at(self) -> int | None:
        if self._before is not None:
            return self._before.start_at
        start = self._announced.start
        return None if start is None else start.start_at_ns

    def _drive(self, node: AnyNode, start_at: int, probe: ProcessProbe, sink: BatchingSink) -> None:
        step = step_with_faults(node, self._builder.name, start_at)
        before = self._before.node if self._before else None
        ticks = self._builder.ticks(start_at)
        back_at = start_at
        if before is not None:
            ticks = dropwhile(lambda tick: tick.at <= before.at, ticks)
            back_at = before.until
        try:
            stagger_ns = self._builder.stagger_ns
            for tick in paced_ticks(
                ticks, self._clock, probe, self._time, stagger_ns=stagger_ns, back_at=back_at
            ):
                if self.is_cancelled:
                    break
                self._fetch(node.inbox)
                self._count_foreign(node.inbox)
                step(tick)
                self._clock_sync.advance()
                if tick.at >= back_at:
                    self._restart_if_down(node, tick.at, probe)
                if self._watching.is_due(now := self._clock.now()):
                    self._check_router_and_recorder(now, "failed")
            sink.flush_all()
        except RestartRequestedError:
            sink.flush_all()
            raise
        except VehicleFaultError as fault:
            sink.flush_all()
            node.outbox.publish_fault(self._clock.now(), fault.text)
            poll(lambda: self.is_cancelled, every_s=POLL_S, at_most_s=FAULT_S, system=self._time)
            raise

    def _fetch(self, inbox: Inbox) -> None:
        for fetch in self._fetches:
            if fetch():
                inbox.count_overflow()

    def _count_foreign(self, inbox: Inbox) -> None:
        if count := self._announced.foreign - self._foreign_counted:
            inbox.count_refused("foreign", count)
            self._foreign_counted += count

    def _restart_if_down(self, node: AnyNode, now: int, probe: ProcessProbe) -> None:
        handover = node.handover(now)
        if handover is not None:
            raise RestartRequestedError(
                ProcessHandover(
                    start_at=self._start_at or 0,
                    run_id=self._membership.run_id,
                    clock=self._clock.setting,
                    lateness=probe.lateness,
                    changes=tuple(self._repeated),
                    node=handover,
                )
            )

    def _check_router_and_recorder(self, now: int, outcome: str) -> None:
        """Raise RunCancelledError if router or recorder are lost: the run `outcome`."""
        self._router.look(now, connected=self._bus.connected())
        if self._router.is_lost_for_good(now):
            raise RunCancelledError(f"{self._run} {outcome}: the router was lost")
        if self._recorder.has_left(now):
            raise RunCancelledError(f"{self._run} {outcome}: its recorder has left")

    def _repeat_final_counters(self, end_at: int) -> None:
        """Repeat the final counters; raises RunCancelledError when no end will come."""
        now = self._clock.now()
        if not self._watching.is_due(now):
            return
        self._check_router_and_recorder(now, UNKNOWN_END)
        if now > max(end_at, self._router.back_at, self._announced.last_received_at) + END_NS:
            raise RunCancelledError(f"{self._run} {UNKNOWN_END}: the recorder announced none")
        self._repeat()

    def _repeat(self) -> None:
        """Repeat what the log must not lack: confirmed changes, then the final counters."""
        for address, data in self._repeated:
            self._bus.publish(address, data)

    def _keep_if_repeated(self, topic: Topic, data: bytes, message: Message) -> None:
        if (isinstance(message, Change) and message.by_hand) or (
            isinstance(message, Health) and message.final
        ):
            self._repeated.append((key(message.vehicle, topic), data))


def queue_limit(link: IncomingLink) -> int:
    return min(ceil(link.gate.rate_hz * WAITING_S), QUEUE)


def paced_ticks(
    ticks: Iterable[Tick],
    clock: Clock,
    probe: ProcessProbe,
    system: SystemTime = SYSTEM_TIME,
    *,
    stagger_ns: int,
    back_at: int,
) -> Iterator[Tick]:
    """Yield each tick `stagger_ns` after its instant.

    Missed ticks follow at once. Ticks before `back_at` (ns), the end of a requested absence, do not
    count as late. After a hold-up of the process the transport first gets SETTLING_S to deliver
    messages, which the missed ticks need.
    """
    was_held_up = False
    for tick in ticks:
        lateness = clock.wait_until(tick.at + stagger_ns)
        if tick.at >= back_at:
            probe.tick_began(lateness)
        is_held_up = lateness > HELD_UP_NS
        if is_held_up and not was_held_up:
            system.sleep(SETTLING_S)
        was_held_up = is_held_up
        yield tick
        probe.tick_ended()
