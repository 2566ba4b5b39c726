"""Kills at random instants of a run, its start-up and last second included.

By default three of a hundred: what is killed in mid-run is in `test_supervision.py`.
"""

import re
import signal
import time
from contextlib import suppress
from pathlib import Path
from random import Random

import psutil
import pytest

from tests.system.processes import Process, start
from transport.log.reader import LogReader
from transport.log.records import LogError
from vehicles.messages import TruePose

DURATION_S = 1.5
"""Of each run; with start-up and end it takes some four seconds."""
LATEST_S = 4.0
KINDS = ("recorder", "launcher", "router", "v1", "v2")
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
NS_PER_FLUSH = 400_000_000
"""The recorder flushes this often; a loaded machine adds to it."""
BUSY_NS = 900_000_000


def target(convoy: Process, kind: str) -> psutil.Process | None:
    """The process of that kind, None while or when there is none."""
    if kind == "launcher":
        return psutil.Process(convoy.popen.pid) if convoy.exit_code is None else None
    return convoy.parts().get(kind)


def hit(convoy: Process, kind: str, number: signal.Signals, after_s: float) -> int:
    """Send a signal `after_s` after the launch, once the process is there; returns when (ns)."""
    time.sleep(after_s)
    until_s = time.monotonic() + 10.0
    while convoy.exit_code is None and time.monotonic() < until_s:
        victim = target(convoy, kind)
        if victim is not None:
            with suppress(psutil.NoSuchProcess):
                victim.send_signal(number)
                return time.time_ns()
        time.sleep(0.01)
    return time.time_ns()


@pytest.mark.campaign(3, 100)
def test_whatever_is_killed_whenever_nothing_is_left_and_the_log_can_be_read(
    case: int, tmp_path: Path
) -> None:
    random = Random(case)
    kind = KINDS[case % len(KINDS)]
    number, after_s = random.choice(SIGNALS), random.uniform(0.0, LATEST_S)
    how = random.choice(("fork", "fork", "spawn"))
    convoy_of_three = ("lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={DURATION_S}")
    arguments = ("run", *convoy_of_three, f"--start={how}")
    what = f"{kind} {number.name} after {after_s:.2f} s, started by {how}"
    with start(*arguments, "--out", tmp_path / "run", folder=tmp_path) as convoy:
        hit_at = hit(convoy, kind, number, after_s)
        code = convoy.wait()
        assert convoy.is_gone_in_time(), f"{what}: left {convoy.everyone()}"
        assert "Traceback" not in convoy.err, f"{what}: {convoy.err}"
        assert code in {0, 1, 130, 143, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT}, what
        if kind != "launcher":
            assert code in {0, 1}, f"{what}: {code} {convoy.err}"
        if code == 1:
            assert convoy.err.strip(), f"{what}: failed without a word"
    log = tmp_path / "run" / "run.mcap"
    if log.exists():
        assert_readable(log, hit_at, what)


def truths_of(log: Path) -> list[TruePose]:
    """True poses in a log; none where it was killed before its first message."""
    try:
        return [m for _, _, m in LogReader(log).messages(("truth",)) if isinstance(m, TruePose)]
    except LogError as error:
        # Killed, it breaks off; its launcher may have completed it since.
        if re.search("before the first message|contains no messages|is empty", str(error)):
            return []
        raise


def assert_readable(log: Path, hit_at: int, what: str) -> None:
    """All that was driven until shortly before the hit is there, without gaps."""
    truths = truths_of(log)
    by_vehicle: dict[str, list[int]] = {}
    for truth in truths:
        by_vehicle.setdefault(truth.vehicle, []).append(truth.seq)
    for vehicle, numbers in by_vehicle.items():
        assert numbers == list(range(len(numbers))), f"{what}: gaps of {vehicle}"
    if truths:
        last, began = max(t.true_at_ns for t in truths), min(t.true_at_ns for t in truths)
        end = began + round(DURATION_S * 1e9)
        driven_until = min(hit_at, end - 20_000_000)
        assert last > driven_until - NS_PER_FLUSH - BUSY_NS, f"{what}: log ends too early"
