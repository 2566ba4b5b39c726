"""Starts, watches and stops the processes of a run."""

import atexit
import errno
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import BinaryIO

import click

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.open_runs import OpenRun, announced
from scenarios.runs.processes.fork_server import fork_server, starting_processes
from scenarios.runs.stop import EXIT_FAILED, Stop, write_error
from transport.bus.bus import BusError
from transport.bus.zenoh_bus import DEFAULT_ENDPOINT, ZenohOptions, open_router
from transport.clock import SYSTEM_TIME, SystemTime, poll

# ---- `convoy router`: the Zenoh router of a convoy as a process of its own


LISTENING = "listening on "
"""Begin of the first line of output; the endpoints follow."""
ROUTER_POLL_S = 0.05
EMPTY_S = 2.0
"""Time without clients after which `--until-empty` ends the router."""
AFTER_THE_LAUNCHER_S = 2.0
"""How long a router outlives its launcher, so that the recorder still gets the last messages."""


def route(options: ZenohOptions, stop: Stop, *, until_empty: bool) -> int:
    """Route until a stop is requested or, with `until_empty`, until all clients have left.

    Returns the exit code.
    """
    listen = options.listen or (DEFAULT_ENDPOINT,)
    if options.mode is not None:
        raise BusError(f"--mode {options.mode}: given for the router, whose mode is router")
    with open_router(
        listen, connect=options.connect, config=options.config, cfg=options.cfg
    ) as router:
        stop.begun = True
        click.echo(f"{LISTENING}{', '.join(router.endpoints)}")
        poll(
            lambda: stop.requested or (until_empty and router.has_clients()), every_s=ROUTER_POLL_S
        )
        while not stop.requested:
            poll(lambda: stop.requested or not router.has_clients(), every_s=ROUTER_POLL_S)
            someone_came_back = poll(
                lambda: stop.requested or router.has_clients(),
                every_s=ROUTER_POLL_S,
                at_most_s=EMPTY_S,
            )
            if not someone_came_back:
                return 0
        if stop.orphaned:
            time.sleep(AFTER_THE_LAUNCHER_S)
    return stop.exit_code


# ---- Supervisor


POLL_S = 0.01
GRACE_S = 3.0
"""Time between SIGTERM and SIGKILL; every run ends within five seconds."""


RunPart = Callable[[Sequence[str]], None]
"""Runs `convoy ARGUMENTS` in a new process; a function of a module."""
PRELOADED = ("scenarios.runs.processes.supervisor", "scenarios.runs.processes.vehicle_process")
"""Modules of the processes of a run other than the recorder."""


@dataclass(slots=True)
class Child:
    """A process; `stdin` is the writing end of its standard input, `stdout` of a piped output."""

    name: str
    process: BaseProcess
    stdin: Connection | None = None
    stdout: BinaryIO | None = None

    @property
    def exit_code(self) -> int | None:
        return self.process.exitcode


def describe(child: Child) -> str:
    code = child.exit_code
    if code is None:
        return f"{child.name} still runs"
    if code < 0:
        return f"{child.name} was killed by signal {-code}"
    return f"{child.name} ended with exit code {code}"


def _run_child(
    run_part: RunPart, arguments: Sequence[str], stdin: Connection, stdout: Connection | None
) -> None:
    """Run a part in the child: with its own session, standard files and command line."""
    os.setsid()
    os.dup2(stdin.fileno(), 0)
    stdin.close()
    if stdout is not None:
        os.dup2(stdout.fileno(), 1)
        stdout.close()
    sys.argv = ["convoy", *arguments]
    try:
        run_part(arguments)
    finally:
        atexit._run_exitfuncs()


class Supervisor:
    """Starts and stops the child processes of a run.

    Each has its own session, so that Ctrl-C in the terminal reaches only the launcher. Its standard
    input is a pipe from the launcher: when that closes, the child stops by itself.
    """

    def __init__(
        self,
        run_part: RunPart,
        preload: Sequence[str] = (),
        system: SystemTime = SYSTEM_TIME,
    ) -> None:
        """The fork server imports the module of `run_part`, and those named in `preload`."""
        self.children: list[Child] = []
        self._router_output: BinaryIO | None = None
        self._system = system
        self._run_part = run_part
        self._context: BaseContext = fork_server((run_part.__module__, *preload, *PRELOADED))

    def start(self, name: str, arguments: Sequence[str], *, piped: bool = False) -> Child:
        """Start `convoy ARGUMENTS` as a child; `piped` sends its output here. Raises OSError."""
        child_stdin, stdin = self._context.Pipe(duplex=False)
        stdout, child_stdout = self._context.Pipe(duplex=False) if piped else (None, None)
        process = self._context.Process(  # type: ignore[attr-defined]
            target=_run_child,
            args=(self._run_part, arguments, child_stdin, child_stdout),
            name=name,
        )
        sys.stdout.flush()
        sys.stderr.flush()
        try:
            with starting_processes():
                process.start()
        except EOFError as error:  # the fork server could not fork
            raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN)) from error
        finally:
            child_stdin.close()
            if child_stdout is not None:
                child_stdout.close()
        output = None if stdout is None else os.fdopen(os.dup(stdout.fileno()), "rb")
        child = Child(name, process, stdin, output)
        self.children.append(child)
        return child

    def start_router(self) -> str:
        """Start a router on a free port of the loopback interface; returns its endpoint.

        Other output of the router goes to the standard error.
        """
        arguments = ["router", "--parent-watch", "-l", "tcp/127.0.0.1:0"]
        child = self.start("router", arguments, piped=True)
        output = child.stdout
        while output is not None and (line := output.readline()):
            if line.startswith(LISTENING.encode()):
                os.set_blocking(output.fileno(), False)
                self._router_output = output
                return line.decode().removeprefix(LISTENING).strip()
            write_error(line)
        raise BusError("the router did not start")

    def _pass_on_output(self) -> None:
        """Drain the router's output: a full pipe would block it."""
        if self._router_output is not None and (logged := self._router_output.read()):
            write_error(logged)

    def send_reason(self, name: str, reason: str) -> None:
        """Send a child the reason to stop; an ended child is skipped."""
        for child in self.children:
            if child.name == name and child.stdin is not None:
                with suppress(OSError):
                    os.write(child.stdin.fileno(), reason.encode())

    def ended(self) -> list[Child]:
        """Remove the ended children from `children` and return them."""
        self._pass_on_output()
        ended = [child for child in self.children if child.exit_code is not None]
        self.children = [child for child in self.children if child not in ended]
        return ended

    def stop(self, names: Sequence[str] | None = None, grace_s: float = GRACE_S) -> list[Child]:
        """Terminate the named children (by default all), and kill them after `grace_s`.

        Returns the killed ones.
        """
        chosen = [c for c in self.children if names is None or c.name in names]
        for child in chosen:
            child.process.terminate()

        def have_ended() -> bool:
            self._pass_on_output()
            return all(child.exit_code is not None for child in chosen)

        poll(have_ended, every_s=POLL_S, at_most_s=grace_s, system=self._system)
        remaining = [child for child in chosen if child.exit_code is None]
        for child in remaining:
            child.process.kill()
            child.process.join()
        self.children = [child for child in self.children if child not in chosen]
        return remaining


# ---- `convoy run` on the wall clock: starts a router, a recorder and a process per vehicle


WATCH_PERIOD_S = 0.05
NOTICED_S = 0.1
"""Time in which each process notices that its router has ended, on a busy machine too."""
ROUTER, RECORDER = "router", "recorder"
RECORDER_FAILED = "the run failed"
"""Reason of a run whose recorder has printed the true one."""


@dataclass(frozen=True, slots=True)
class LaunchPlan:
    """What to launch: scenario, the arguments that select it, folder, name of the run."""

    scenario: Scenario
    scenario_arguments: Sequence[str]
    folder: Path
    recorder_arguments: Sequence[str]
    run: str


@dataclass(slots=True)
class RunOutcome:
    """How a run ended: exit code, and the reason of a failure.

    `repaired`: the launcher completed the log that the recorder could not. `recorder_killed`: by a
    signal, perhaps after its log was complete. `router_ended`: the run
    failed by that, unless its recorder knows better. `is_reported`: the reason is printed already.
    """

    exit_code: int = 0
    reason: str = ""
    repaired: bool = False
    recorder_killed: bool = False
    router_ended: bool = False
    is_reported: bool = False

    def fail(self, reason: str, exit_code: int = EXIT_FAILED, *, is_reported: bool = False) -> None:
        """End the run; the first failure decides."""
        if not self.reason:
            self.reason, self.exit_code, self.is_reported = reason, exit_code, is_reported


def launch(
    plan: LaunchPlan,
    stop: Stop,
    supervisor: Supervisor,
    complete: Callable[[Path], bool],
    *,
    on_router: Callable[[str], None] = lambda _: None,
    system: SystemTime = SYSTEM_TIME,
) -> RunOutcome:
    """Run the convoy to its end and leave no process behind.

    `complete` completes the log where the recorder could not; it returns whether that was needed.
    `on_router` gets the router's endpoint.
    """
    outcome = RunOutcome()
    recorder: Child | None = None
    try:
        endpoint = supervisor.start_router()
        on_router(endpoint)
        common = (*plan.scenario_arguments, "--parent-watch", "--run", plan.run, "-e", endpoint)
        recorder = supervisor.start(
            RECORDER,
            ["record", *common, "--out", str(plan.folder), *plan.recorder_arguments],
        )
        for name in plan.scenario.vehicle_names:
            supervisor.start(name, ["vehicle", *common, "--name", name])
        stop.begun = True
        with announced(OpenRun(plan.run, endpoint, str(plan.folder.resolve()))):
            poll(
                lambda: _is_over(plan, supervisor, recorder, stop, outcome),
                every_s=WATCH_PERIOD_S,
                system=system,
            )
    except BusError as error:  # our own router: no fault of the input
        outcome.fail(str(error))
    except OSError as error:  # the system allows no more processes, memory or open files
        outcome.fail(f"cannot start all processes: {error.strerror}")
    finally:
        if outcome.router_ended:  # let the recorder notice before it is stopped
            system.sleep(NOTICED_S)
        _stop_all(plan, supervisor, outcome)
        outcome.repaired = complete(plan.folder / LOG_NAME)
    if recorder is not None and recorder.exit_code == 0:  # the run was complete before the failure
        outcome.reason, outcome.exit_code = "", 0
    outcome.recorder_killed = recorder is not None and (recorder.exit_code or 0) < 0
    return outcome


def _is_over(
    plan: LaunchPlan,
    supervisor: Supervisor,
    recorder: Child,
    stop: Stop,
    outcome: RunOutcome,
) -> bool:
    vehicles = plan.scenario.vehicle_names
    continues = plan.scenario.continues_without_failed
    if stop.requested:
        outcome.fail(stop.reason, stop.exit_code, is_reported=True)
    for child in supervisor.ended():
        if child is recorder and child.exit_code == 0:
            return True
        if child is recorder and child.exit_code == EXIT_FAILED:
            outcome.fail(RECORDER_FAILED, is_reported=True)
        elif child.name not in vehicles or (child.exit_code != 0 and not continues):
            outcome.router_ended = child.name == ROUTER and not outcome.reason
            outcome.fail(describe(child))
    return bool(outcome.reason)


def _stop_all(plan: LaunchPlan, supervisor: Supervisor, outcome: RunOutcome) -> None:
    """Stop what still runs: the vehicles first, so that the recorder gets their last messages."""
    supervisor.send_reason(RECORDER, outcome.reason)
    names = [child.name for child in supervisor.children]
    supervisor.stop([name for name in names if name in plan.scenario.vehicle_names], grace_s=1.0)
    supervisor.stop([RECORDER], grace_s=2.5)
    supervisor.stop(grace_s=0.2)  # the router, which has nothing to complete
