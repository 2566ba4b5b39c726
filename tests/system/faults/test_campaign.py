"""Signals at random instants of a run, including its start-up and last second.

Three of a hundred by default; `test_supervision.py` kills processes in mid-run.
"""

import json
import re
import signal
import time
from contextlib import suppress
from pathlib import Path
from random import Random

import psutil
import pytest

from scenarios.results.files import SUMMARY_NAME
from tests.system.processes import Process, start
from transport.log.errors import LogError
from transport.log.reader import LogReader
from vehicles.messages import TruePose

DURATION_S = 1.5
"""Duration of each run; it takes about 4 s with start-up and end."""
LATEST_S = 4.0
KINDS = ("recorder", "launcher", "router", "v1", "v2")
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
NS_PER_FLUSH = 400_000_000
"""Flush interval of the recorder."""
BUSY_NS = 900_000_000
"""Allowance for a busy machine."""


def target(convoy: Process, kind: str) -> psutil.Process | None:
    """The process of that kind, if it is alive."""
    if kind == "launcher":
        return psutil.Process(convoy.popen.pid) if convoy.exit_code is None else None
    return convoy.parts().get(kind)


def send_signal_after(convoy: Process, kind: str, number: signal.Signals, after_s: float) -> int:
    """Send a signal `after_s` after launch, when the process exists; return its instant (ns)."""
    time.sleep(after_s)
    deadline = time.monotonic() + 10.0
    while convoy.exit_code is None and time.monotonic() < deadline:
        victim = target(convoy, kind)
        if victim is not None:
            with suppress(psutil.NoSuchProcess):
                victim.send_signal(number)
                return time.time_ns()
        time.sleep(0.01)
    return time.time_ns()


@pytest.mark.campaign(3, 100)
def test_a_signal_at_any_instant_leaves_no_process_and_a_readable_log(
    case: int, tmp_path: Path
) -> None:
    random = Random(case)
    kind = KINDS[case % len(KINDS)]
    number, after_s = random.choice(SIGNALS), random.uniform(0.0, LATEST_S)
    convoy_of_three = ("lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={DURATION_S}")
    arguments = ("run", *convoy_of_three)
    label = f"{kind} {number.name} after {after_s:.2f} s"
    with start(*arguments, "--out", tmp_path / "run", folder=tmp_path) as convoy:
        signal_at = send_signal_after(convoy, kind, number, after_s)
        code = convoy.wait()
        assert convoy.ends_in_time(), f"{label}: left {convoy.remaining()}"
        assert "Traceback" not in convoy.err, f"{label}: {convoy.err}"
        assert code in {0, 1, 130, 143, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT}, label
        if kind != "launcher":
            assert code in {0, 1}, f"{label}: {code} {convoy.err}"
        if code == 1:
            assert convoy.err.strip(), f"{label}: failed without a message"
    summary = tmp_path / "run" / SUMMARY_NAME
    if summary.exists() and code != -signal.SIGKILL:
        outcome = json.loads(summary.read_text(encoding="utf-8"))["outcome"]
        assert (outcome == "completed") == (code == 0), f"{label}: {outcome}, exit code {code}"
    log = tmp_path / "run" / "run.mcap"
    if log.exists():
        assert_readable(log, signal_at, label)


def truths_of(log: Path) -> list[TruePose]:
    """True poses in a log; empty if the run was killed before its first message."""
    try:
        return [m for _, _, m in LogReader(log).messages(("truth",)) if isinstance(m, TruePose)]
    except LogError as error:
        # A killed log is truncated, unless its launcher has completed it.
        if re.search("before the first message|contains no messages|is empty", str(error)):
            return []
        raise


def assert_readable(log: Path, signal_at: int, label: str) -> None:
    """Check that the log has all true poses until shortly before the signal."""
    truths = truths_of(log)
    by_vehicle: dict[str, list[int]] = {}
    for truth in truths:
        by_vehicle.setdefault(truth.vehicle, []).append(truth.seq)
    for vehicle, numbers in by_vehicle.items():
        assert numbers == list(range(len(numbers))), f"{label}: gaps of {vehicle}"
    if truths:
        last, first = max(t.true_at_ns for t in truths), min(t.true_at_ns for t in truths)
        end = first + round(DURATION_S * 1e9)
        driven_until = min(signal_at, end - 20_000_000)
        assert last > driven_until - NS_PER_FLUSH - BUSY_NS, f"{label}: log ends too early"
