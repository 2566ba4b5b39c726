"""Requests to stop, each in a small process of its own."""

import ast
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from scenarios.runs.stop import Stop

ROOT = Path(__file__).parents[3]
PACKAGES = ("vehicles", "transport", "scenarios")

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


def handlers(tree: ast.Module) -> Iterator[ast.expr]:
    """Second arguments of all calls of `signal.signal`."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(ast.Name("signal"), "signal"), args=[_, handler]):
                yield handler


def only_sets_flags(body: list[ast.stmt]) -> bool:
    """Whether statements are assignments of names or one `append` of a name."""
    for statement in body:
        match statement:
            case ast.Assign(value=ast.Name() | ast.Constant()):
                pass
            case ast.Expr(ast.Call(func=ast.Attribute(ast.Name(), "append"), args=[ast.Name()])):
                pass
            case _:
                return False
    return True


def test_signal_handlers_set_flags_and_nothing_else() -> None:
    """A handler that takes a lock deadlocks with the code that it interrupts."""
    checked = 0
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            tree = ast.parse(path.read_text())
            functions = {n.name: n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
            for handler in handlers(tree):
                checked += 1
                match handler:
                    case ast.Attribute(ast.Name("signal"), "SIG_IGN" | "SIG_DFL"):
                        pass
                    case ast.BoolOp(values=[ast.Name("before"), ast.Attribute()]):
                        pass  # restores an earlier handler
                    case ast.Name(name) if name in functions:
                        assert only_sets_flags(functions[name].body), f"{path}: {name}"
                    case _:
                        raise AssertionError(f"{path}: {ast.dump(handler)}")
    assert checked >= 3
