"""Logs and summaries of finished runs, read by the public MCAP reader and by ours."""

import json
import subprocess
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import cached_property
from math import hypot
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from transport.log.reader import LogReader
from transport.picture.viewer_process import quiet_environment, viewer_binary
from vehicles.messages import (
    CompositeTrajectory,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunStart,
    TruePose,
)

SECOND = 1_000_000_000
GNSS_HZ = 20
CONTROL_HZ = 50
Truths = dict[str, dict[int, TruePose]]
"""True poses of each vehicle by instant, in ns after the start."""


@dataclass(frozen=True)
class Run:
    """The folder of a finished run."""

    folder: Path

    @property
    def log(self) -> Path:
        return self.folder / "run.mcap"

    @cached_property
    def messages(self) -> list[Message]:
        return [message for _, _, message in LogReader(self.log).messages()]

    @cached_property
    def summary(self) -> dict[str, Any]:
        summary: dict[str, Any] = json.loads((self.folder / "summary.json").read_text())
        return summary

    def vehicle(self, name: str) -> dict[str, Any]:
        """The row of one vehicle in the summary."""
        rows: dict[str, dict[str, Any]] = {row["name"]: row for row in self.summary["vehicles"]}
        return rows[name]

    @cached_property
    def start_at(self) -> int:
        return next(m.start_at_ns for m in self.messages if isinstance(m, RunStart))

    @cached_property
    def truths(self) -> Truths:
        """True poses in the order of the schedule."""
        truths: Truths = defaultdict(dict)
        for message in self.messages:
            if isinstance(message, TruePose):
                truths[message.vehicle][message.true_at_ns - self.start_at] = message
        return {name: dict(sorted(poses.items())) for name, poses in sorted(truths.items())}

    @property
    def last_truth_at(self) -> int:
        """The instant (ns) of the last true pose of any vehicle."""
        return self.start_at + max(at for poses in self.truths.values() for at in poses)

    def texts(self, vehicle: str) -> list[str]:
        """Log lines of one vehicle, or of `run`."""
        return [m.text for m in self.messages if isinstance(m, LogText) and m.vehicle == vehicle]

    @property
    def late_messages_at(self) -> list[int]:
        """Instants at which late messages were due, in ns after the start."""
        return sorted(
            m.visible_at_ns - self.start_at
            for m in self.messages
            if isinstance(m, LinkVerdict) and m.late
        )

    @property
    def late_ticks(self) -> int:
        """Late ticks of all vehicles."""
        last = {m.vehicle: m.late_ticks for m in self.messages if isinstance(m, Health)}
        return sum(last.values())


@dataclass(frozen=True)
class Agreement:
    """Agreement of the true poses of two runs of one scenario.

    `differ_at` is the first instant, in ns after the start, at which a pose differs in any bit.
    """

    compared: int
    equal: int
    distance_m_max: float
    differ_at: int | None


def agreement(run: Run, other: Run) -> Agreement:
    """Compare the true poses of two runs at equal times after their starts."""
    distance_max, equal, differing, compared = 0.0, 0, [], 0
    for name, poses in run.truths.items():
        theirs = other.truths[name]
        for at in poses.keys() & theirs.keys():
            a, b = poses[at], theirs[at]
            compared += 1
            distance_max = max(distance_max, hypot(a.east_m - b.east_m, a.north_m - b.north_m))
            if _state(a) == _state(b):
                equal += 1
            else:
                differing.append(at)
    return Agreement(compared, equal, distance_max, min(differing, default=None))


def _state(pose: TruePose) -> tuple[float, ...]:
    return (
        *(pose.seq, pose.east_m, pose.north_m, pose.yaw_rad, pose.speed_mps),
        *(pose.lateral_speed_mps, pose.yaw_rate_radps, pose.steering_rad, pose.distance_m),
    )


LATE_RATIO_MAX = 0.02
"""Up to this share of late messages, cars drive nearly the same."""


def assert_equal_while_nothing_was_late(wall: Run, virtual: Run, within_m: float) -> None:
    """Check that runs differ only after a late message, and by at most `within_m` if few were late.

    The number of late messages depends on the load of the machine.
    """
    found = agreement(wall, virtual)
    assert found.compared >= sum(map(len, wall.truths.values()))
    late = wall.late_messages_at
    judged = sum(isinstance(message, LinkVerdict) for message in wall.messages)
    assert found.distance_m_max <= within_m or len(late) > LATE_RATIO_MAX * judged
    if found.differ_at is not None:
        assert late, f"runs differ after {found.differ_at} ns without a late message"
        assert late[0] < found.differ_at


def assert_sound(log: Path) -> None:
    """Check that independent readers accept a log as a complete MCAP file."""
    with log.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        count = sum(1 for _ in reader.iter_messages())
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert count == summary.statistics.message_count > 0
    checked = subprocess.run(
        [str(viewer_binary()), "mcap", "check", "--full", str(log)],
        env=quiet_environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr


def assert_nothing_missing(run: Run, duration_s: float) -> None:
    """Check that poses of all vehicles span the run, and that no message is missing."""
    numbers: defaultdict[tuple[str, type[Message]], list[int]] = defaultdict(list)
    for message in run.messages:
        numbers[message.vehicle, type(message)].append(message.seq)
    for (name, kind), sent in numbers.items():
        if kind is CompositeTrajectory:  # fitted at ticks with new messages, numbered by the tick
            assert len(set(sent)) == len(sent), name
        else:
            assert sorted(sent) == list(range(len(sent))), f"{name}: {kind.__name__}"
    poses = {name: len(sent) for (name, kind), sent in numbers.items() if kind is GpsPose}
    assert set(poses) == set(run.truths)
    for name, count in poses.items():
        assert abs(count - duration_s * GNSS_HZ) <= 1, name
        assert abs(len(run.truths[name]) - duration_s * CONTROL_HZ) <= 1, name


def assert_summary_is_in_the_log(run: Run) -> None:
    """Check that `summary.json` equals the attachment of the log, and its counts the messages."""
    attached = LogReader(run.log).attachments()["summary.json"]
    assert attached == (run.folder / "summary.json").read_bytes()
    counted = Counter(m.vehicle for m in run.messages if isinstance(m, GpsPose))
    assert {row["name"]: row["poses"] for row in run.summary["vehicles"]} == counted
    assert not any(row["missing_poses"] for row in run.summary["vehicles"])
