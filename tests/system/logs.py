"""What a run left behind, read by the public reader of MCAP and by our own."""

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
"""Of each vehicle its true poses by their instant, in ns after the start."""


@dataclass(frozen=True)
class Run:
    """The folder of a run that is over."""

    folder: Path

    @property
    def log(self) -> Path:
        """Its log."""
        return self.folder / "run.mcap"

    @cached_property
    def messages(self) -> list[Message]:
        """All messages of its log."""
        return [message for _, _, message in LogReader(self.log).messages()]

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What `summary.json` says."""
        found: dict[str, Any] = json.loads((self.folder / "summary.json").read_text())
        return found

    def vehicle(self, name: str) -> dict[str, Any]:
        """Return one vehicle's part of the summary."""
        rows: dict[str, dict[str, Any]] = {row["name"]: row for row in self.summary["vehicles"]}
        return rows[name]

    @cached_property
    def start_at(self) -> int:
        """The instant of the start (ns)."""
        return next(m.start_at_ns for m in self.messages if isinstance(m, RunStart))

    @cached_property
    def truths(self) -> Truths:
        """Return the true poses in the order of the schedule."""
        found: Truths = defaultdict(dict)
        for message in self.messages:
            if isinstance(message, TruePose):
                found[message.vehicle][message.true_at_ns - self.start_at] = message
        return {name: dict(sorted(poses.items())) for name, poses in sorted(found.items())}

    @property
    def last_truth_at(self) -> int:
        """The instant (ns) of the last true pose of any vehicle."""
        return self.start_at + max(at for poses in self.truths.values() for at in poses)

    def texts(self, vehicle: str) -> list[str]:
        """Return the lines of text that one vehicle, or `run`, wrote into the log."""
        return [m.text for m in self.messages if isinstance(m, LogText) and m.vehicle == vehicle]

    @property
    def late_messages_at(self) -> list[int]:
        """When messages that came late should have been heard, in ns after the start."""
        return sorted(
            m.visible_at_ns - self.start_at
            for m in self.messages
            if isinstance(m, LinkVerdict) and m.late
        )

    @property
    def late_ticks(self) -> int:
        """Return how many ticks all vehicles together were late for."""
        last = {m.vehicle: m.late_ticks for m in self.messages if isinstance(m, Health)}
        return sum(last.values())


@dataclass(frozen=True)
class Agreement:
    """How two runs of one scenario agree in their true poses.

    `parted_at` is the first instant, in ns after the start, at which any pose differs in any bit.
    """

    compared: int
    equal: int
    farthest_m: float
    parted_at: int | None


def agreement(one: Run, other: Run) -> Agreement:
    """Compare the true poses that two runs have at the same time after their starts."""
    farthest, equal, parted, compared = 0.0, 0, [], 0
    for name, poses in one.truths.items():
        theirs = other.truths[name]
        for at in poses.keys() & theirs.keys():
            a, b = poses[at], theirs[at]
            compared += 1
            farthest = max(farthest, hypot(a.east_m - b.east_m, a.north_m - b.north_m))
            if _state(a) == _state(b):
                equal += 1
            else:
                parted.append(at)
    return Agreement(compared, equal, farthest, min(parted, default=None))


def _state(pose: TruePose) -> tuple[float, ...]:
    return (
        *(pose.seq, pose.east_m, pose.north_m, pose.yaw_rad, pose.speed_mps),
        *(pose.lateral_speed_mps, pose.yaw_rate_radps, pose.steering_rad, pose.distance_m),
    )


FEW_RATIO = 0.02
"""If no more messages than these come late, cars drive nearly the same."""


def assert_equal_while_nothing_was_late(wall: Run, virtual: Run, within_m: float) -> None:
    """What two runs differ in is explained by a message that was counted as late before.

    A few of them cost no more than so much; how many there are is a matter of the machine.
    """
    found = agreement(wall, virtual)
    assert found.compared >= sum(map(len, wall.truths.values()))
    late = wall.late_messages_at
    judged = sum(isinstance(message, LinkVerdict) for message in wall.messages)
    assert found.farthest_m <= within_m or len(late) > FEW_RATIO * judged
    if found.parted_at is not None:
        assert late, f"parted after {found.parted_at} ns, and nothing was late"
        assert late[0] < found.parted_at


def assert_sound(log: Path) -> None:
    """A log is a whole MCAP file, to readers that know nothing of this project."""
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
    """Every vehicle's poses are there for the whole time, and no message of any kind is missing."""
    numbers: defaultdict[tuple[str, type[Message]], list[int]] = defaultdict(list)
    for message in run.messages:
        numbers[message.vehicle, type(message)].append(message.seq)
    for (name, kind), found in numbers.items():
        if kind is CompositeTrajectory:  # made anew when something was heard, numbered as decided
            assert len(set(found)) == len(found), name
        else:
            assert sorted(found) == list(range(len(found))), f"{name}: {kind.__name__}"
    poses = {name: len(found) for (name, kind), found in numbers.items() if kind is GpsPose}
    assert set(poses) == set(run.truths)
    for name, count in poses.items():
        assert abs(count - duration_s * GNSS_HZ) <= 1, name
        assert abs(len(run.truths[name]) - duration_s * CONTROL_HZ) <= 1, name


def assert_summary_is_in_the_log(run: Run) -> None:
    """`summary.json` is the log's own attachment, and counts what the log holds."""
    attached = LogReader(run.log).attachments()["summary.json"]
    assert attached == (run.folder / "summary.json").read_bytes()
    counted = Counter(m.vehicle for m in run.messages if isinstance(m, GpsPose))
    assert {row["name"]: row["poses"] for row in run.summary["vehicles"]} == counted
    assert not any(row["missing_poses"] for row in run.summary["vehicles"])
