"""Forked children as a supervisor sees them: each a process of its own, whatever becomes of it.

The parent of each test is a process of its own, since one that forks must have no other threads.
"""

import json
import os
import subprocess
import sys
from typing import Any

import psutil
import pytest

from tests.made.ended import has_ended
from tests.made.transport.bus import until

SOON_S = 15.0
PRELUDE = """
import atexit, json, os, signal, sys, threading, time
from functools import partial
import psutil
from scenarios.runs.processes.forking import can_fork
from scenarios.runs.processes.supervisor import Supervisor, describe
from scenarios.runs.stop import end_on_signals, stop_on_request

end_on_signals(report=True)

def wait_for_the_end(arguments):
    stop = stop_on_request(with_launcher=True)
    stop.begun = True
    print("ready", flush=True)
    while not stop.requested:
        time.sleep(0.005)
    sys.exit(f"{arguments[0]}: {stop.reason}" if stop.orphaned else stop.exit_code)

def doing(deed):
    return lambda arguments: partial(deed, arguments)

def ended(child):
    while child.exit_code is None:
        time.sleep(0.005)
    return describe(child)
"""


def parent(script: str, *, code: int = 0) -> subprocess.CompletedProcess[str]:
    """Output of a parent with this script."""
    done = subprocess.run(
        [sys.executable, "-c", PRELUDE + script],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == code, done.stderr
    return done


def results(script: str) -> Any:
    """What a parent with this script prints as JSON in its last line."""
    return json.loads(parent(script).stdout.splitlines()[-1])


def test_a_forked_child_is_a_process_of_its_own() -> None:
    seen = results(
        """
kept = open(sys.executable, "rb")
def become(arguments):
    print(json.dumps({
        "argv": sys.argv, "again": sys.orig_argv, "pid": os.getpid(), "parent": os.getppid(),
        "session": os.getsid(0), "name": psutil.Process().name(),
        "threads": threading.active_count(),
        "files": [file.path for file in psutil.Process().open_files()],
        "blocked": [int(number) for number in signal.pthread_sigmask(signal.SIG_BLOCK, ())],
    }), flush=True)
supervisor = Supervisor(doing(become))
child = supervisor.start("v7", ["vehicle", "--name", "v7"], piped=True)
states = json.loads(child.process.stdout.readline())
assert ended(child) == "v7 ended with exit code 0"
assert states["pid"] == child.process.pid and states["parent"] == os.getpid()
assert threading.active_count() == 2  # the watch for signals goes on here
print(json.dumps(states))
"""
    )
    assert seen["argv"] == ["convoy", "vehicle", "--name", "v7"]
    assert seen["again"] == [sys.executable, "-m", "scenarios.cli", "vehicle", "--name", "v7"]
    assert seen["session"] == seen["pid"] != seen["parent"]
    assert seen["name"] == "convoy-v7"
    assert seen["threads"] == 2  # and on there
    assert seen["files"] == []
    assert seen["blocked"] == []


def test_children_forked_together_are_processes_of_their_own() -> None:
    seen = results(
        """
def become(arguments):
    me = [arguments, os.getpid(), os.getsid(0), psutil.Process().name()]
    os.write(1, (json.dumps(me) + "\\n").encode())
    os.read(0, 1)
supervisor = Supervisor(doing(become))
reading, writing = os.pipe()
kept = os.dup(1)
os.dup2(writing, 1)
supervisor.start_all([(f"v{k}", ["vehicle", str(k)]) for k in range(5)])
os.dup2(kept, 1)
with os.fdopen(reading) as lines:
    states = [json.loads(next(lines)) for _ in supervisor.children]
supervisor.children[2].process.kill()
ends = [ended(supervisor.children[2])]
assert [child.exit_code for child in supervisor.children] == [None, None, -9, None, None]
for child in supervisor.children:
    child.process.stdin.close()
ends += [ended(child) for child in supervisor.children]
print(json.dumps([[c.process.pid for c in supervisor.children], sorted(states), ends]))
"""
    )
    pids, reported, ends = seen
    assert len(set(pids)) == 5
    assert reported == [[["vehicle", str(k)], pids[k], pids[k], f"convoy-v{k}"] for k in range(5)]
    good = [f"v{k} ended with exit code 0" for k in range(5)]
    assert ends == ["v2 was killed by signal 9", *good[:2], "v2 was killed by signal 9", *good[3:]]


def test_if_not_all_can_be_forked_there_are_none() -> None:
    done = parent(
        """
fork, forked = os.fork, []
def fork_two():
    if len(forked) == 2:
        raise BlockingIOError(11, "Resource temporarily unavailable")
    forked.append(fork())
    return forked[-1]
os.fork = fork_two
supervisor = Supervisor(doing(lambda arguments: time.sleep(60)))
files = set(os.listdir("/proc/self/fd"))
try:
    supervisor.start_all([(f"v{k}", ["vehicle"]) for k in range(5)])
except OSError as error:
    print(error.strerror)
print(supervisor.children, [psutil.pid_exists(pid) for pid in forked])
print(sorted(set(os.listdir("/proc/self/fd")) - files), threading.active_count())
"""
    )
    assert done.stdout.splitlines() == [
        "Resource temporarily unavailable",
        "[] [False, False]",
        "[] 2",
    ]


@pytest.mark.parametrize(
    ("deed", "end"),
    [
        ("sys.exit()", "ended with exit code 0"),
        ("sys.exit(7)", "ended with exit code 7"),
        ("sys.exit('what went wrong')", "ended with exit code 1"),
        ("raise ValueError('what went wrong')", "ended with exit code 1"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "was killed by signal 9"),
        ("os.kill(os.getpid(), signal.SIGTERM); time.sleep(9)", "ended with exit code 143"),
    ],
)
def test_its_end_is_that_of_a_program(deed: str, end: str) -> None:
    done = parent(
        f"""
supervisor = Supervisor(doing(lambda arguments: [{deed!r}, exec({deed!r})]))
print(ended(supervisor.start("one", ["one"])))
"""
    )
    assert done.stdout.splitlines() == [f"one {end}"]
    assert ("what went wrong" in done.stderr) == ("what went wrong" in deed)


def test_the_task_of_a_child_is_prepared_before_the_fork() -> None:
    done = parent(
        """
def prepare(arguments):
    prepared = os.getpid()
    return lambda: print(arguments, prepared == os.getppid())
Supervisor(prepare).start("one", ["one", "two"]).process.wait()
"""
    )
    assert done.stdout == "['one', 'two'] True\n"


def test_last_deeds_are_those_of_the_process_that_planned_them() -> None:
    done = parent(
        """
atexit.register(print, "the parent's")
print("before", end=" ")  # what waits to be written is written once
supervisor = Supervisor(doing(lambda arguments: atexit.register(print, "the child's")))
supervisor.start("one", ["one"]).process.wait()
"""
    )
    assert done.stdout == "before the child's\nthe parent's\n"


def test_a_child_receives_its_reason_and_loses_no_signal() -> None:
    done = parent(
        """
supervisor = Supervisor(doing(wait_for_the_end))
informed = supervisor.start("informed", ["informed"], piped=True)
informed.process.stdout.readline()
supervisor.send_reason("informed", "v2 failed")
print(ended(informed))
for _ in range(25):  # it may come at any instant of its life
    child = supervisor.start("one", ["one"])
    child.process.terminate()
    assert ended(child) == "one ended with exit code 143", describe(child)
"""
    )
    assert done.stdout.splitlines()[0] == "informed ended with exit code 1"


def test_with_other_threads_about_nothing_is_forked() -> None:
    done = parent(
        """
assert can_fork()
leave = threading.Event()
threading.Thread(target=leave.wait).start()
assert not can_fork()
child = Supervisor(doing(lambda arguments: print("forked"))).start("one", ["nonsense"])
print(ended(child))
leave.set()
"""
    )
    assert done.stdout == "one ended with exit code 2\n"


def test_when_the_parent_is_killed_every_child_ends() -> None:
    script = """
supervisor = Supervisor(doing(wait_for_the_end))
children = [supervisor.start(name, [name], piped=True) for name in ("one", "two", "three")]
for child in children:
    child.process.stdout.readline()
print(*(child.process.pid for child in children), flush=True)
time.sleep(60)
"""
    with subprocess.Popen(
        [sys.executable, "-c", PRELUDE + script], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        children = [psutil.Process(int(pid)) for pid in process.stdout.readline().split()]
        assert len(children) == 3
        # One of them stands still: its siblings must not wait for it.
        children[2].suspend()
        process.kill()
        process.wait(SOON_S)
        assert until(lambda: all(has_ended(child) for child in children[:2]), SOON_S)
        children[2].resume()
        assert until(lambda: has_ended(children[2]), SOON_S)
