"""A convoy on four hosts; one is cut off for a while, behind a slow cable that loses frames.

`pytest --campaign -s` prints a line per case.
"""

import os
import time
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED
from tests.system.hosts.hosts import BASE, available, connected_hosts
from tests.system.logs import Run
from tests.system.processes import DRIVING, Process, start, until
from vehicles.messages import Health

CASES = list(product((0.0, 0.3), (5.0, 100.0, 200.0), (1.0, 3.0, 10.0)))
"""Loss ratio and delay (ms) of the cable, and the length of the cut (s)."""
NAMES = ("v1", "v2", "v3")
FAR = "v2"
PORT = 7447
BEFORE_S, AFTER_S = 2.0, 5.0
"""Time of the run before and after the cut."""
JOINING_S, ENDING_S = 150.0, 60.0
OFFSET_MS = 5000.0
"""Error of the clock of the far host."""
WRONG_CLOCK = """import time
unix = time.time_ns
time.time_ns = lambda: unix() + 5_000_000_000
"""
LEASE_S = 10.0


@dataclass(frozen=True)
class CutOffRun:
    """A finished run, with the exit codes of recorder and vehicles."""

    run: Run
    has_started: bool
    recorder: int
    vehicles: dict[str, int]

    @property
    def summary(self) -> dict[str, Any]:
        return self.run.summary

    @property
    def named(self) -> str:
        """What the run reports of absent vehicles."""
        lines = [str(self.summary["reason"]), *self.summary["warnings"]]
        return "\n".join(line for line in lines if "cut off" in line or "out of reach" in line)


def drive(
    folder: Path, monkeypatch: pytest.MonkeyPatch, loss: float, delay_ms: float, cut_s: float
) -> CutOffRun:
    duration_s = BEFORE_S + cut_s + AFTER_S
    settings = (
        *("lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={duration_s}"),
        f"--set=links.latency_ms={2 * delay_ms + 100}",
        f"--set=convoy.clock_uncertainty_ms_max={3 * delay_ms + 10}",
    )
    (folder / "clock").mkdir()
    (folder / "clock" / "sitecustomize.py").write_text(WRONG_CLOCK)
    with connected_hosts() as hosts, ExitStack() as stack:
        addresses = {name: hosts.connect(name, 0.0, 0.0)[0] for name in NAMES if name != FAR}
        addresses[FAR], cable = hosts.connect(FAR, delay_ms, loss)

        def begin(host: str, *arguments: object) -> Process:
            return stack.enter_context(start(*arguments, folder=folder, inside=hosts.inside(host)))

        router = begin(BASE, "router", "-l", f"tcp/0.0.0.0:{PORT}")
        assert until(lambda: str(PORT) in router.out), router.err
        wait = f"--wait={JOINING_S:g}s"
        recorder = begin(
            BASE, "record", *settings, "--out=run", wait, "-e", f"tcp/127.0.0.1:{PORT}"
        )
        vehicles = {}
        for name in NAMES:
            with monkeypatch.context() as patch:
                if name == FAR:
                    patch.setenv("PYTHONPATH", str(folder / "clock"), prepend=os.pathsep)
                vehicles[name] = begin(
                    name,
                    *("vehicle", *settings, "--name", name),
                    *("-e", f"tcp/{addresses[name]}:{PORT}"),
                )
        until(lambda: DRIVING in recorder.err or recorder.exit_code is not None, JOINING_S + 30.0)
        has_started = recorder.exit_code is None
        if has_started:
            time.sleep(0.5 + BEFORE_S)
            cable.cut()
            time.sleep(cut_s)
            cable.mend()
        code = recorder.wait(duration_s + ENDING_S)
        codes = {name: vehicle.wait(ENDING_S) for name, vehicle in vehicles.items()}
    return CutOffRun(Run(folder / "run"), has_started, code, codes)


@pytest.mark.long
@pytest.mark.campaign(1, len(CASES))
@pytest.mark.skipif(not available(), reason="needs root, `ip netns` and /dev/net/tun")
def test_the_account_balances_and_names_the_host_that_was_cut_off(
    case: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loss, delay_ms, cut_s = CASES[case]
    done = drive(tmp_path, monkeypatch, loss, delay_ms, cut_s)
    print(f"\nloss {loss}, {delay_ms:g} ms, cut {cut_s:g} s: {described(done)}")
    assert_outcome(done)
    if not done.has_started:
        assert loss > 0.0, done.summary["reason"]
        assert FAR in done.summary["reason"]
        return
    for row in done.summary["links"]:
        parts = *row["dropped"].values(), *row["not_arrived"].values()
        assert row["sent"] == sum(parts) + row["delivered"] + row["in_flight"] + row["unrecorded"]
        if FAR not in {row["sender"], row["receiver"]} or (loss == 0.0 and cut_s < LEASE_S / 2):
            assert row["not_arrived"] == {}
    assert FAR in done.named
    assert not any(name in done.named for name in NAMES if name != FAR and "→" not in done.named)
    assert_clock_corrected(done)


def assert_outcome(done: CutOffRun) -> None:
    """Check that outcome and exit codes agree."""
    assert done.recorder == (EXIT_DONE if done.summary["outcome"] == "completed" else EXIT_FAILED)
    for name, code in done.vehicles.items():
        if name == FAR and not done.has_started:
            assert code in {EXIT_FAILED, EXIT_BAD_INPUT}
        else:
            assert code == done.recorder, name


def assert_clock_corrected(done: CutOffRun) -> None:
    reports = [m for m in done.run.messages if isinstance(m, Health) and m.vehicle == FAR]
    for report in reports:
        error_ms = abs(report.clock_offset_ms - OFFSET_MS)
        assert error_ms <= report.clock_uncertainty_ms + 1.0
    assert reports


def described(done: CutOffRun) -> str:
    """One line for a table of cases."""
    rows = [
        f"{row['sender']}→{row['receiver']} {row['sent']} sent, {row['delivered']} delivered, "
        f"{row['late']} late, {row['not_arrived']}, {row['in_flight']} in flight, "
        f"transport {row['transport_ms_mean'] or 0:.0f}/{row['transport_ms_max'] or 0:.0f} ms"
        for row in done.summary["links"]
    ]
    outcome = f"{done.summary['outcome']} {done.summary['reason']}".strip()
    return "; ".join([outcome, f"exit codes {done.recorder} {done.vehicles}", *rows, done.named])
