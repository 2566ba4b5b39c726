"""Simulates one run: its processes as roles that execute the product's own loops."""

from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cache, partial
from io import StringIO
from pathlib import Path
from random import Random
from threading import Event
from typing import Any, cast

from scenarios.cli.change_requests import VehicleAnswer, request_change
from scenarios.cli.common_options import DisplayOptions
from scenarios.cli.recorder_run import record_run
from scenarios.cli.wall_clock_run import launch_and_report
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.node.process_probe import Machine, ProcessProbe, Resources, ThreadTimes
from scenarios.runs.processes.membership import RECORDER as RECORDER_ROLE
from scenarios.runs.processes.membership import VEHICLE, Fingerprint
from scenarios.runs.processes.restart import RestartRequestedError
from scenarios.runs.processes.supervisor import Child, LaunchPlan, Supervisor
from scenarios.runs.processes.vehicle_process import run_vehicle
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED, Stop, exit_code_of_signal
from tests.scenarios.runs.simulation.disk import Disk, folder_of
from tests.scenarios.runs.simulation.network import SimulatedBus, SimulatedNetwork
from tests.scenarios.runs.simulation.plan import LAUNCHER, RECORDER, ROUTER, Fault, HostError, Plan
from tests.scenarios.runs.simulation.scheduler import HostClock, Role, Scheduler
from transport.bus.bus import BusError
from transport.bus.zenoh_options import ZenohOptions
from transport.clock import SystemTime
from transport.codec import encode
from transport.log.errors import LogError, UnwritableError
from transport.topics import RUN_SENDER, TOPICS, key
from vehicles.messages import RunEnd
from vehicles.schedule import MILLISECOND, SECOND

BASE = (
    "control.rate_hz=10",
    "gnss.rate_hz=10",
    "sending.path_history_m=0",
    "links.latency_ms=40",
)
"""Cheap vehicles: a tenth of a second between two decisions."""
LONGEST_NS = 400 * SECOND
"""No role may run longer."""
RUN = "simulated"
DISPLAY = DisplayOptions(quiet=True)


@cache
def scenario_of(variant: tuple[str, ...], vehicles: int, duration_s: float) -> Scenario:
    overrides = (*BASE, f"convoy.vehicles={vehicles}", f"duration_s={duration_s}", *variant)
    return load_scenario("lane_change", overrides)


@dataclass
class Process:
    """A process as its role, with the methods of `subprocess.Popen` that a supervisor uses."""

    name: str
    role: Role | None
    stop: Stop
    world: "World"
    lines: list[str] = field(default_factory=list)
    """Reports, and errors with the prefix "error: "."""
    stdout: None = None
    is_faulty: bool = False
    """Whether a fault killed or stopped it."""
    joined_at: int | None = None

    @property
    def stdin(self) -> "Process":
        return self

    def write(self, data: bytes) -> int:
        """Take the reason of a stop from the launcher."""
        if data:
            self.stop.request(data.decode(), EXIT_FAILED)
        return len(data)

    def flush(self) -> None:
        """Nothing is buffered."""

    @property
    def exitcode(self) -> int | None:
        if self.role is None:
            return None if self.world.network.is_up else self.world.router_code
        return self.role.exit_code if self.role.ended else None

    def join(self) -> None:
        while self.exitcode is None:
            running = self.world.scheduler.current
            assert running is not None
            running.wait(MILLISECOND)

    def terminate(self) -> None:
        self.signal(15)

    def signal(self, number: int) -> None:
        if self.role is None:
            self.world.network.stop_router()
        elif self.stop.ignores_signals:
            return
        elif self.stop.begun:
            self.stop.signals.append(number)
        else:
            self.role.exit_code = exit_code_of_signal(number)
            self.role.kill()

    def kill(self) -> None:
        if self.role is None:
            self.world.router_code = -9
            self.world.network.stop_router()
        else:
            self.role.kill()

    def orphan(self) -> None:
        """The launcher has ended."""
        if self.role is None:
            self.world.scheduler.after(2 * SECOND, self.world.network.stop_router)
        elif not self.role.ended:
            self.is_faulty = True
            if not self.stop.begun:
                self.role.exit_code = EXIT_FAILED
                self.role.kill()
            self.stop.orphaned = True
            self.stop.request("the launcher has ended", EXIT_FAILED)


class SimulatedSupervisor(Supervisor):
    """Starts roles instead of processes."""

    def __init__(self, world: "World", system: SystemTime) -> None:
        super().__init__(lambda _: None, system=system)
        self._world = world

    def start_router(self) -> str:
        self._world.network.start_router()
        router = Process(ROUTER, None, Stop(), self._world)
        self._world.processes.append(router)
        self.children.append(Child(ROUTER, cast("Any", router)))
        return "tcp/127.0.0.1:7447"

    def start(self, name: str, arguments: Sequence[str], *, piped: bool = False) -> Child:
        del arguments, piped
        child = Child(name, cast("Any", self._world.start(name)))
        self.children.append(child)
        return child


@dataclass
class LiveRequest:
    """A live change that was requested, with its answers, None if it failed."""

    entry: dict[str, Any]
    answers: list[VehicleAnswer] | None = None


class World:
    """Everything that exists while one plan is simulated."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan = plan
        self.random = Random(f"world {plan.seed}")
        self.scheduler = Scheduler(self.random)
        self.network = SimulatedNetwork(self.scheduler, plan.network)
        self.scenario = scenario_of(plan.variant, plan.vehicles, plan.duration_s)
        self.disk = Disk(plan.full_at, plan.full_for, plan.disk_error)
        self.folder = folder_of(folder / "run", self.disk, lambda: self.scheduler.current)
        self.processes: list[Process] = []
        self.requests: list[LiveRequest] = []
        self.router_code = 0
        self.is_over = False
        self.stuck: dict[str, str] = {}
        self.printed: list[str] = []
        errors = plan.hosts or (HostError(),)
        self.clocks = [
            HostClock(self.scheduler, offset=error.offset, drift=error.drift) for error in errors
        ]

    def run(self) -> None:
        """Simulate the run until all roles have ended."""
        plan = self.plan
        for fault in plan.faults:
            self.scheduler.at(fault[1], partial(self._cause, fault))
            self.scheduler.busy_until = max(self.scheduler.busy_until, fault[1] + 2 * SECOND)
        if plan.launched:
            self.start(LAUNCHER)
        else:
            self.network.start_router()
            for name, at in plan.starts:
                self.scheduler.at(at, partial(self.start, name))
                self.scheduler.busy_until = max(self.scheduler.busy_until, at)
        self.scheduler.keep_busy(round((plan.duration_s + 3.0) * SECOND))
        self._hold_open()
        with redirect_stderr(StringIO()) as printed, redirect_stdout(StringIO()):
            self.is_over = self.scheduler.run(LONGEST_NS)
        self.printed = printed.getvalue().splitlines()
        if not self.is_over:
            self.stuck = {
                role.name: role.waits_in() for role in self.scheduler.roles if not role.ended
            }
            self.scheduler.unwind()

    def _hold_open(self) -> None:
        """Keep the simulation going until all processes and faults have begun."""
        last = max(
            [at for _, at in self.plan.starts] + [fault[1] for fault in self.plan.faults] + [0]
        )

        def wait() -> int:
            holder.wait(last + MILLISECOND)
            return 0

        holder = Role(self.scheduler, "holder", wait)
        holder.start()

    # ---- Roles

    def process(self, name: str) -> Process | None:
        """Latest process of a name."""
        return next((each for each in reversed(self.processes) if each.name == name), None)

    def start(self, name: str) -> Process:
        stop = Stop()
        process = Process(name, None, stop, self)
        work = {LAUNCHER: self._launcher, RECORDER: self._recorder}.get(name, self._vehicle)
        role = Role(self.scheduler, name, lambda: self._with_errors(process, work))
        process.role = role
        self.processes.append(process)
        role.start()
        return process

    def _with_errors(self, process: Process, work: Callable[[Process], int]) -> int:
        """Exit code of a command, as `clear_errors` has it."""
        try:
            return work(process)
        except (ScenarioError, BusError, LogError) as error:
            process.lines += [f"error: {line}" for line in str(error).splitlines()]
            return EXIT_FAILED if isinstance(error, UnwritableError) else EXIT_BAD_INPUT
        except OSError as error:
            process.lines.append(f"error: {error.strerror}")
            return EXIT_FAILED

    def _launcher(self, process: Process) -> int:
        time = self._machine(process).time
        plan = LaunchPlan(self.scenario, (), self.folder, (), RUN)
        assert process.role is not None
        process.role.on_end.append(self._orphan_all)
        return launch_and_report(plan, process.stop, SimulatedSupervisor(self, time), DISPLAY, time)

    def _orphan_all(self) -> None:
        for process in self.processes:
            if process.name in {ROUTER, *self.plan.roles}:
                process.orphan()

    def _recorder(self, process: Process) -> int:
        process.stop.launched = self.plan.launched
        return record_run(
            self.scenario,
            ZenohOptions(run=RUN),
            process.stop,
            out=self.folder,
            display=DISPLAY,
            gather_s=60.0 if self.plan.launched else self.plan.gather_s,
            launched=self.plan.launched,
            machine=self._machine(process),
            make_run_id=lambda: f"{self.random.getrandbits(64):016x}",
        )

    def _vehicle(self, process: Process) -> int:
        before, scenario = None, self.scenario
        if process.name == self.plan.foreign:
            variant = (*self.plan.variant, "seed=2")
            scenario = scenario_of(variant, self.plan.vehicles, self.plan.duration_s)
        while True:
            try:
                return run_vehicle(
                    scenario,
                    process.name,
                    ZenohOptions(run=RUN),
                    process.stop,
                    report=process.lines.append,
                    report_error=lambda line: process.lines.append(f"error: {line}"),
                    launched=self.plan.launched,
                    wait_s=600.0 if self.plan.launched else self.plan.wait_s,
                    before=before,
                    machine=self._machine(process),
                )
            except RestartRequestedError as request:
                before = request.handover
                assert process.role is not None
                process.role.wait(300 * MILLISECOND)

    def _machine(self, process: Process) -> Machine:
        role = process.role
        assert role is not None
        clock = self.clock_of(process.name)
        scheduler, random, plan = self.scheduler, self.random, self.plan

        def monotonic() -> int:
            if plan.preempted and role.is_running and random.random() < plan.preempted:
                role.wait(random.randrange(plan.interruption))
            return clock.monotonic()

        def span_of(seconds: float) -> int:
            span = clock.true_span(seconds)
            if scheduler.now > scheduler.busy_until:
                span = max(span, SECOND // 8)
            return span + random.randrange(MILLISECOND)

        def wait(event: Event, seconds: float) -> None:
            role.wait(span_of(seconds), event)

        return Machine(
            SystemTime(monotonic, clock.unix, lambda s: role.wait(span_of(s)), wait),
            partial(self._open, process),
            partial(
                ProcessProbe,
                times=lambda: ThreadTimes(clock.monotonic(), 0, 0),
                resources=lambda: Resources(clock.monotonic() / SECOND, 0.0, 2**24),
            ),
        )

    def _open(self, process: Process, options: ZenohOptions) -> SimulatedBus:
        assert process.role is not None
        bus = self.network.open(process.role, options)
        process.joined_at = self.scheduler.now
        self.scheduler.keep_busy(3 * SECOND)
        return bus

    def clock_of(self, name: str) -> HostClock:
        """Clock of the host of a process."""
        place = self.plan.roles.index(name) if name in self.plan.roles else 0
        return self.clocks[place % len(self.clocks)]

    # ---- Faults

    def _cause(self, fault: Fault) -> None:
        kind, _, *values = fault
        action = getattr(self, "_" + kind.replace(" ", "_"))
        action(*values)

    def _buses(self, name: str) -> list[SimulatedBus]:
        return [bus for bus in self.network.sessions if bus.role.name == name]

    def _cut(self, name: str, span: int) -> None:
        for bus in self._buses(name):
            bus.block(span)

    def _pause(self, name: str, span: int) -> None:
        process = self.process(name)
        if process is not None and process.role is not None:
            process.role.pause(span)
            self._cut(name, span)

    def _freeze_router(self, span: int) -> None:
        self.network.freeze_router(span)

    def _restart_router(self, span: int | None) -> None:
        self.router_code = -9
        self.network.stop_router()
        if span is not None and not self.plan.launched:
            self.scheduler.after(span, self.network.start_router)

    def _kill(self, name: str, back: int | None) -> None:
        process = self.process(name)
        if process is None or process.exitcode is not None:
            return
        process.is_faulty = True
        process.kill()
        if back is not None:
            self.scheduler.after(back, partial(self.start, name))

    def _stop(self, name: str, number: int) -> None:
        process = self.process(name)
        if process is not None and process.exitcode is None:
            process.is_faulty = True
            process.signal(number)

    def _stranger(self, kind: str, name: str) -> None:
        def work(_: Process) -> int:
            bus = self.network.open(role, ZenohOptions())
            fingerprint = Fingerprint.of(self.scenario).chunk
            if kind == "recorder":
                bus.announce(RECORDER_ROLE, "0" * 16, fingerprint)
            elif kind == "namesake":
                bus.announce(VEHICLE, name, fingerprint)
            elif kind == "other seed":
                bus.announce(VEHICLE, name, fingerprint.replace("~1~", "~2~"))
            elif kind == "foreign end":
                end = RunEnd(vehicle=RUN_SENDER, seq=0, end_at_ns=1, reason="", run_id="0" * 16)
                bus.publish(key(RUN_SENDER, TOPICS["end"]), encode(end))
            else:
                for topic in TOPICS.values():
                    bus.publish(key(name, topic), self.random.randbytes(40))
            role.wait(SECOND)
            bus.close()
            return 0

        process = Process("stranger", None, Stop(), self)
        role = Role(self.scheduler, "stranger", lambda: self._with_errors(process, work))
        role.start()

    def _change(self, kind: str, name: str) -> None:
        details: dict[str, dict[str, Any]] = {
            "cut": {"receiver": name, "for_s": 0.3},
            "link": {"receiver": name, "loss_ratio": 0.5},
            "speed": {"speed_mps": 20.0},
            "stall": {"vehicle": name, "for_s": 0.3},
            "gnss": {"vehicle": name, "fix": "none", "for_s": 0.3},
        }
        entry: dict[str, Any] = {"kind": kind, **details.get(kind, {})}
        request = LiveRequest(entry)
        self.requests.append(request)
        process = Process("operator", None, Stop(), self)

        def work(_: Process) -> int:
            with self.network.open(role, ZenohOptions(connect_timeout_s=2.0)) as bus:
                request.answers = request_change(bus, RUN, entry, self._machine(process).time)
            return 0

        role = Role(self.scheduler, "operator", lambda: self._with_errors(process, work))
        process.role = role
        self.processes.append(process)
        role.start()
