"""Runs on one router are separate, and each process reports the outcome of its run."""

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from socket import socket

import pytest

from tests.system.logs import Run, assert_equal_while_nothing_was_late, assert_nothing_missing
from tests.system.processes import Process, invoke, run_to_the_end, start, until
from transport.topics import RUN_SENDER
from vehicles.messages import LinkVerdict

DURATION_S = 3.0
NAMES = ("v1", "v2")
TWO = ("lane_change", "--set=convoy.vehicles=2")
SHORT = (*TWO, f"--set=duration_s={DURATION_S}")
Start = Callable[..., Process]


class SharedRouter:
    """A router on a free port, and processes connected to it."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        with socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
        self.folder = folder
        self._stack = stack
        self.router = self.start_router()

    def start_router(self) -> Process:
        router = self._stack.enter_context(start("router", "-l", self.endpoint, folder=self.folder))
        assert until(lambda: self.endpoint in router.out), router.err
        return router

    def lose_router(self) -> None:
        self.router.popen.send_signal(signal.SIGKILL)
        self.router.wait()

    def start(self, *arguments: object, fresh: bool = False) -> Process:
        started = start(*arguments, "-e", self.endpoint, folder=self.folder, fresh=fresh)
        return self._stack.enter_context(started)

    def try_out(self, *arguments: object) -> Process:
        return run_to_the_end(*arguments, "-e", self.endpoint, folder=self.folder)

    def convoy(self, scenario: tuple[str, ...], out: str, *flags: object) -> list[Process]:
        """Start a recorder into folder `out`, and its two vehicles."""
        recorder = self.start("record", *scenario, "--out", out, *flags)
        return [recorder, *self.vehicles(scenario, *flags)]

    def vehicles(self, scenario: tuple[str, ...], *flags: object) -> list[Process]:
        return [self.start("vehicle", *scenario, "--name", name, *flags) for name in NAMES]


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[SharedRouter]:
    with ExitStack() as stack:
        yield SharedRouter(tmp_path, stack)


def await_driving(recorder: Process, seconds: float) -> float:
    """Wait until a convoy has driven for `seconds`; return its start by `time.monotonic`."""
    recorder.await_start()
    started = time.monotonic() + 0.5
    time.sleep(0.5 + seconds)
    return started


def without_sessions(text: str) -> str:
    return re.sub(r" \(session [0-9a-f]+\)", "", text)


def assert_refused(process: Process, line: str) -> None:
    assert process.exit_code == 2
    assert [without_sessions(one) for one in process.lines()] == [line]


def test_convoys_on_one_router_do_not_affect_each_other(hub: SharedRouter, tmp_path: Path) -> None:
    shifted = (*SHORT, "--set=vehicle.v1.lateral_offset_m=5")
    first = hub.start("record", *SHORT, "--out", "one")
    assert until(lambda: "waiting for v1, v2" in first.err), first.err
    assert_refused(  # before the start: a busy machine could miss the run
        hub.try_out("record", *SHORT, "--out", "second"),
        "run lane_change: there is a recorder already; give another --run",
    )
    assert not (tmp_path / "second").exists()
    other = hub.convoy(shifted, "other", "--run", "other")
    for part in (first, *hub.vehicles(SHORT), *other):
        assert part.wait() == 0, part.err
    for name, scenario in (("one", SHORT), ("other", shifted)):
        out = f"{name}-virtual"
        invoke("run", *scenario, "--clock=virtual", "--quiet", "--out", out, folder=tmp_path)
        run = Run(tmp_path / name)
        assert run.summary["recorder_rejected_messages"] == {}
        assert_nothing_missing(run, DURATION_S)
        assert_equal_while_nothing_was_late(run, Run(tmp_path / out), within_m=0.05)


def test_processes_that_do_not_match_the_run_are_refused(hub: SharedRouter, tmp_path: Path) -> None:
    vehicle = hub.start("vehicle", *SHORT, "--name=v1")
    stranger = hub.start("vehicle", *SHORT, "--name=v2", "--seed=7")
    for part in (vehicle, stranger):
        assert until(lambda: "waiting for the recorder of run lane_change" in part.err), part.err  # noqa: B023
    assert_refused(
        hub.try_out("vehicle", *SHORT, "--name=v1"),
        "run lane_change: there is a vehicle v1 already; give another --run",
    )
    recorder = hub.start("record", *SHORT, "--out=run")
    assert until(lambda: "v2 has seed 7, here it is 1" in without_sessions(recorder.err)), (
        recorder.err
    )
    for difference, line in {
        "--set=convoy.gap_m=4": "the recorder has another content of scenario lane_change "
        "(file or --set)",
    }.items():
        assert_refused(
            hub.try_out("vehicle", *SHORT, "--name=v2", difference), f"run lane_change: {line}"
        )
    assert_refused(
        hub.try_out("vehicle", *SHORT, "--name=v2", "--run=a/b"),
        "--run 'a/b': allowed are up to 100 letters, digits, underscores and hyphens",
    )
    second = hub.start("vehicle", *SHORT, "--name=v2")
    recorder.await_start()
    late = hub.try_out("vehicle", *SHORT, "--name=v2", "--run=lane_change")
    assert late.exit_code == 2  # while its namesake drives
    assert stranger.wait() == 2
    assert (
        without_sessions(stranger.lines()[-1])
        == "run lane_change: the recorder has seed 1, here it is 7"
    )
    for part in (vehicle, second, recorder):
        assert part.wait() == 0, part.err
    assert Run(tmp_path / "run").summary["outcome"] == "completed"


def test_a_router_absent_at_the_end_leaves_an_incomplete_record(
    hub: SharedRouter, tmp_path: Path
) -> None:
    recorder, *vehicles = hub.convoy(SHORT, "run")
    started = await_driving(recorder, 1.0)
    hub.lose_router()
    time.sleep(max(started + DURATION_S + 0.5 - time.monotonic(), 0.0))
    hub.start_router()
    for part in (recorder, *vehicles):
        assert part.wait() == 1, part.err
    summary = Run(tmp_path / "run").summary
    assert summary["outcome"] == "incomplete"
    assert all(row["finished"] for row in summary["vehicles"])
    assert all(row["poses"] < DURATION_S * 20 for row in summary["vehicles"])  # sent meanwhile
    assert summary["recorder_rejected_messages"] == {}


def test_a_permanently_lost_router_ends_all_processes(tmp_path: Path) -> None:
    """Lose the router in mid-run and in the last second, in parallel: each waits 5 s."""
    mid, end = tmp_path / "mid", tmp_path / "end"
    with ExitStack() as stack:
        hubs, parts = {}, {}
        for folder, duration_s in ((mid, 30.0), (end, 3.0)):
            folder.mkdir()
            hubs[folder] = SharedRouter(folder, stack)
            parts[folder] = hubs[folder].convoy((*TWO, f"--set=duration_s={duration_s}"), "run")
        for folder, seconds in ((end, 2.6), (mid, 0.0)):
            await_driving(parts[folder][0], seconds)
            hubs[folder].lose_router()
        for folder in (mid, end):
            for part in parts[folder]:
                assert part.wait() == 1, part.err
            for name, vehicle in zip(NAMES, parts[folder][1:], strict=True):
                outcomes = ["failed"] + ["has an unknown end"] * (folder == end)
                messages = [f"{name}: run lane_change {one}: the router" for one in outcomes]
                assert vehicle.lines()[-1].startswith(tuple(messages))
            assert Run(folder / "run").summary["outcome"] == "failed"


WRONG_CLOCK = """import time
unix, monotonic = time.time_ns, time.monotonic_ns
begun = monotonic()
time.time_ns = lambda: unix() + {offset_ns}
time.monotonic_ns = lambda: monotonic() + int((monotonic() - begun) * {drift})
"""


@pytest.mark.parametrize(("offset_ms", "drift"), [(5000, 0.0), (-40, 500e-6)])
def test_a_wrong_clock_is_corrected(
    hub: SharedRouter,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    offset_ms: int,
    drift: float,
) -> None:
    recorder = hub.start("record", *SHORT, "--out=run", "--quiet")
    vehicles = [hub.start("vehicle", *SHORT, "--name=v1")]
    source = WRONG_CLOCK.format(offset_ns=offset_ms * 1_000_000, drift=drift)
    (tmp_path / "sitecustomize.py").write_text(source)
    with monkeypatch.context() as patch:
        patch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
        vehicles.append(hub.start("vehicle", *SHORT, "--name=v2", fresh=True))
    for part in (recorder, *vehicles):
        assert part.wait() == 0, part.err
    invoke("run", *SHORT, "--clock=virtual", "--quiet", "--out=virtual", folder=tmp_path)
    run = Run(tmp_path / "run")
    assert_equal_while_nothing_was_late(run, Run(tmp_path / "virtual"), within_m=0.05)
    judged = sum(isinstance(message, LinkVerdict) for message in run.messages)
    assert len(run.late_messages_at) < judged / 2
    lines = [text for text in run.texts(RUN_SENDER) if "clock of v2" in text]
    assert lines
    reported_ms = abs(float(re.findall(r"-?\d+\.\d+", lines[0])[0]))
    assert abs(reported_ms - abs(offset_ms)) < 1.0 + drift * 20_000.0  # first 20 s of the clock


def test_a_suspended_recorder_loses_nothing(hub: SharedRouter, tmp_path: Path) -> None:
    duration_s = 5.0
    recorder, *vehicles = hub.convoy((*TWO, f"--set=duration_s={duration_s}"), "run")
    await_driving(recorder, 0.5)
    recorder.part("recorder").suspend()
    time.sleep(3.0)
    recorder.part("recorder").resume()
    for part in (recorder, *vehicles):
        assert part.wait() == 0, part.err
    assert_nothing_missing(Run(tmp_path / "run"), duration_s)


def test_a_disconnected_recorder_lists_missing_messages(hub: SharedRouter, tmp_path: Path) -> None:
    """The convoy does not depend on the recorder, and ends as planned: the record is incomplete."""
    duration_s = 5.0
    scenario = (*TWO, f"--set=duration_s={duration_s}")
    lease = ("--cfg", "transport/link/tx/lease:1000")  # then the router drops the recorder
    recorder = hub.start("record", *scenario, "--out", "run", *lease)
    vehicles = [hub.start("vehicle", *scenario, "--name", name) for name in NAMES]
    await_driving(recorder, 0.5)
    recorder.part("recorder").suspend()
    time.sleep(2.5)
    recorder.part("recorder").resume()
    for part in (recorder, *vehicles):
        assert part.wait() == 1, part.err
    summary = Run(tmp_path / "run").summary
    assert summary["outcome"] == "incomplete"
    missing = {row["name"]: row["missing_poses"] for row in summary["vehicles"]}
    assert all(missing.values())
    holes = dict.fromkeys(missing, 0)
    for hole in summary["holes"]:
        holes[hole["vehicle"]] += hole["poses"] if hole["kind"] == "pose" else 0
        assert 0.0 <= hole["from_s"] <= hole["to_s"] < duration_s
    assert holes == missing
    for row in summary["vehicles"]:
        assert row["poses"] + row["missing_poses"] == 20 * duration_s
    assert summary["vehicles"][1]["cross_track_error_m_max"] < 0.2
    assert "not recorded: " in recorder.out
    assert "the figures cover only what was recorded" in recorder.out


def test_vehicles_report_a_cancelled_or_already_started_run(hub: SharedRouter) -> None:
    vehicle = hub.start("vehicle", *SHORT, "--name=v1")
    assert until(lambda: "joined" in vehicle.err), vehicle.err
    recorder = hub.start("record", *SHORT, "--out=off", "--wait=4")
    assert recorder.wait() == 1
    assert "run: waiting for v2" in recorder.lines()
    assert vehicle.wait() == 1
    assert vehicle.lines()[1:] == ["v1: run lane_change was cancelled: not present in time: v2"]

    continuing = (*TWO, "--set=duration_s=12", '--set=convoy.on_vehicle_failure="continue"')
    recorder, first, second = hub.convoy(continuing, "on")
    await_driving(recorder, 0.2)
    second.popen.send_signal(signal.SIGKILL)
    late = hub.try_out("vehicle", *continuing, "--name=v2")
    assert late.exit_code == 1
    assert late.lines()[1:] == ["v2: run lane_change had started before this vehicle joined"]
    recorder.popen.send_signal(signal.SIGKILL)
    assert first.wait() == 1
    assert first.lines()[2:] == ["v1: run lane_change failed: its recorder has left"]
