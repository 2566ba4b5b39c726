"""Requests to stop, each in a small process of its own."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from scenarios.runs.stop import Stop

SOON_S = 10.0
WAITER = """
import sys, time
from scenarios.runs.stop import stop_on_request
stop = stop_on_request(with_launcher="launched" in sys.argv)
stop.begun = "importing" not in sys.argv
print("ready", flush=True)
deadline = time.monotonic() + 20.0
while not stop.requested and time.monotonic() < deadline:
    time.sleep(0.005)
print(stop.reason, "orphaned" if stop.orphaned else "held", flush=True)
sys.exit(stop.exit_code)
"""


@contextmanager
def waiter(*arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """A process that waits for a request to stop, and then prints the reason."""
    process = subprocess.Popen(
        [sys.executable, "-c", WAITER, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        try:
            yield process
        finally:
            process.kill()


def last_words(process: "subprocess.Popen[str]") -> tuple[str, int]:
    assert process.stdout is not None
    reported = process.stdout.readline()
    return reported.strip(), process.wait(SOON_S)


def test_the_first_request_decides() -> None:
    stop = Stop()
    assert not stop.requested
    stop.request("stopped by SIGTERM", 143)
    stop.request("the launcher has ended", 1)
    assert stop.requested
    assert (stop.reason, stop.exit_code) == ("stopped by SIGTERM", 143)


@pytest.mark.parametrize(
    ("number", "name", "code"), [(signal.SIGINT, "SIGINT", 130), (signal.SIGTERM, "SIGTERM", 143)]
)
def test_signals_ask_to_stop_with_the_exit_code_of_the_shell(
    number: signal.Signals, name: str, code: int
) -> None:
    with waiter() as process:
        process.send_signal(number)
        assert last_words(process) == (f"stopped by {name} held", code)


def test_a_second_signal_changes_nothing() -> None:
    with waiter() as process:
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGINT)
        assert last_words(process)[1] in {130, 143}  # the kernel may deliver either first


def test_a_process_that_has_not_begun_ends_with_its_launcher_at_once() -> None:
    with waiter("launched", "importing") as process:
        assert process.stdin is not None
        process.stdin.close()
        assert last_words(process) == ("", 1)


def test_a_launcher_may_say_why() -> None:
    with waiter("launched") as process:
        assert process.stdin is not None
        process.stdin.write("v2 was killed by signal 9")
        process.stdin.flush()
        assert last_words(process) == ("v2 was killed by signal 9 held", 1)


def test_a_signal_after_all_is_done_changes_nothing() -> None:
    """A handler in Python is removed before the process ends, as stopped containers show."""
    program = """
from scenarios.runs.stop import ignore_signals, stop_on_signals

ignore_signals(stop_on_signals())
print("done", flush=True)
"""
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"done\n"
        while process.poll() is None:
            process.send_signal(signal.SIGTERM)
        assert process.returncode == 0
