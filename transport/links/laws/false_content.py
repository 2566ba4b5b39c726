"""False content: a link replaces the content of messages, or adds messages.

It tests whether followers detect it. The content of a message is what its sender measured:
position, course, motion and reported accuracy. Name, number and instants are unchanged.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, hypot, inf, sin
from typing import Annotated, Literal

from pydantic import Field

from transport.codec import RefusedMessageError
from transport.links.laws.link_law import LawTable, Problem
from vehicles.geometry.geodesy import REACH, LocalPlane, yaw_from_heading
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND

LATEST_S = 86_400  # Maximum duration of a run

Seconds = Annotated[float, Field(ge=0, le=LATEST_S)]
Metres = Annotated[float, Field(ge=-10_000, le=10_000)]
Velocity = Annotated[float, Field(ge=-100, le=100)]

Recall = Callable[[int], GpsPose | None]
"""Returns the sender's newest pose sent by an instant (ns), unaltered.

It includes poses that arrived from the bus and were lost on the emulated link.
"""


@dataclass(frozen=True, slots=True)
class FalseInterval:
    """Interval (ns, end exclusive) in which sent messages have false content."""

    from_at: int = 0
    to_at: float = inf

    def __contains__(self, at: int) -> bool:
        return self.from_at <= at < self.to_at


@dataclass(frozen=True, slots=True)
class Shift:
    """Shift in the plane (m, or m/s), along the world's axes and along the sender's course."""

    east: float = 0.0
    north: float = 0.0
    ahead: float = 0.0
    left: float = 0.0


class FalseContent(LawTable):
    """Base of false contents; the verdicts name them by `kind`.

    from_s  start of the interval of sending, after the start of the run, inclusive
    to_s    end of the interval, exclusive; default: the end of the run

    By default no earlier messages are needed and none are added.
    """

    from_s: Seconds = 0.0
    to_s: Seconds | None = None
    kind: str

    def problems(self) -> Iterator[Problem]:
        if self.to_s is not None and self.to_s <= self.from_s:
            yield "to_s", f"given {self.to_s:g}, allowed more than from_s, {self.from_s:g}"

    @cached_property
    def span(self) -> FalseInterval:
        start_at = self.setting.start_at
        to_at = inf if self.to_s is None else start_at + round(self.to_s * SECOND)
        return FalseInterval(start_at + round(self.from_s * SECOND), to_at)

    @property
    def moments(self) -> tuple[int, ...]:
        """Instants (ns) whose last message is needed."""
        return ()

    @property
    def age(self) -> int:
        """Age (ns) up to which all messages are needed."""
        return 0

    @property
    def after(self) -> int | None:
        """Delay (ns) of the added message after the true one; None if no message is added."""
        return None

    def extra_message(self, pose: GpsPose, plane: LocalPlane) -> GpsPose:
        """Message added to `pose`; raises RefusedMessageError beyond the plane."""
        raise NotImplementedError

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        """Pose that replaces `pose`, None for no change; raises RefusedMessageError."""
        raise NotImplementedError

    def describe(self) -> str:
        end = "" if self.to_s is None else f" to {self.to_s:g} s"
        return f"false content: {self.kind} from {self.from_s:g} s{end}"


class Displaced(FalseContent):
    """Base of contents with a false position."""

    @property
    def by(self) -> Shift:
        """Displacement (m, or m/s)."""
        raise NotImplementedError

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        if self.by == Shift():
            units = ("_m", "_mps")
            keys = ", ".join(key for key in type(self).model_fields if key.endswith(units))
            yield "", f"displaces nothing, allowed a value other than 0 in {keys}"


class FalseOffset(Displaced):
    """Constant displacement of the position.

    east_m   displacement to the east
    north_m  displacement to the north
    ahead_m  displacement forward, along the sender's course
    left_m   displacement to the left of the sender's course
    """

    kind: Literal["offset"] = "offset"
    east_m: Metres = 0.0
    north_m: Metres = 0.0
    ahead_m: Metres = 0.0
    left_m: Metres = 0.0

    @cached_property
    def by(self) -> Shift:
        return Shift(self.east_m, self.north_m, self.ahead_m, self.left_m)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose:
        return displace(pose, plane, self.by)


class FalseDrift(Displaced):
    """Displacement that grows from `from_s`.

    east_mps   rate to the east
    north_mps  rate to the north
    ahead_mps  rate forward, along the sender's course
    left_mps   rate to the left of the sender's course
    """

    kind: Literal["drift"] = "drift"
    east_mps: Velocity = 0.0
    north_mps: Velocity = 0.0
    ahead_mps: Velocity = 0.0
    left_mps: Velocity = 0.0

    @cached_property
    def by(self) -> Shift:
        return Shift(self.east_mps, self.north_mps, self.ahead_mps, self.left_mps)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose:
        return displace(pose, plane, self.by, (pose.sent_at_ns - self.span.from_at) / SECOND)


class FrozenContent(FalseContent):
    """Repeats the last content before `from_s`, with new numbers and time stamps."""

    kind: Literal["frozen"] = "frozen"
    from_s: Annotated[float, Field(gt=0, le=LATEST_S)]

    @property
    def moments(self) -> tuple[int, ...]:
        return (self.span.from_at - 1,)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        return replace_content(pose, recall(self.span.from_at - 1))


class ReplayedContent(FalseContent):
    """Repeats old content, with new numbers and time stamps.

    age_s  minimum age of the content
    """

    kind: Literal["replayed"] = "replayed"
    age_s: Annotated[float, Field(gt=0, le=60)]

    @cached_property
    def age(self) -> int:
        return round(self.age_s * SECOND)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        return replace_content(pose, recall(pose.sent_at_ns - self.age))


class GhostVehicle(Displaced):
    """After each message, adds a forged message in the sender's name that reports a ghost vehicle.

    ahead_m  position of the ghost ahead of the sender, along its course
    left_m   position of the ghost to the left of the sender's course

    The forged message is stamped and arrives half a period of the sender's maximum rate after the
    true one, so that both alternate. It has the number of the true message and bypasses the
    receiver's check of numbers.
    """

    kind: Literal["ghost"] = "ghost"
    ahead_m: Metres = 0.0
    left_m: Metres = 0.0

    @cached_property
    def by(self) -> Shift:
        return Shift(ahead=self.ahead_m, left=self.left_m)

    @cached_property
    def after(self) -> int:
        return round(SECOND / (2.0 * self.setting.source_rate_hz))

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        return pose

    def extra_message(self, pose: GpsPose, plane: LocalPlane) -> GpsPose:
        travelled = pose.speed_mps * self.after / SECOND
        ghost = displace(pose, plane, replace(self.by, ahead=self.ahead_m + travelled))
        return shift_times(ghost, self.after)


def displace(pose: GpsPose, plane: LocalPlane, by: Shift, times: float = 1.0) -> GpsPose:
    """Move `pose` by `times` the shift; raises RefusedMessageError beyond the plane."""
    east, north = plane.to_plane(pose.latitude_deg, pose.longitude_deg, pose.altitude_m)
    yaw = yaw_from_heading(pose.heading_deg)
    east += times * (by.east + by.ahead * cos(yaw) - by.left * sin(yaw))
    north += times * (by.north + by.ahead * sin(yaw) + by.left * cos(yaw))
    if not hypot(east, north) < REACH:
        raise RefusedMessageError("far", f"{east:.0f} m east, {north:.0f} m north")
    latitude_deg, longitude_deg, altitude_m = plane.to_geodetic(east, north)
    return replace(
        pose, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m
    )


def shift_times(pose: GpsPose, by: int) -> GpsPose:
    measured_at_ns, sent_at_ns = pose.measured_at_ns + by, pose.sent_at_ns + by
    return replace(pose, measured_at_ns=measured_at_ns, sent_at_ns=sent_at_ns)


def replace_content(pose: GpsPose, old: GpsPose | None) -> GpsPose | None:
    """Content of `old` with the number and the instants of `pose`; None without `old`."""
    if old is None:
        return None
    return replace(
        old, seq=pose.seq, measured_at_ns=pose.measured_at_ns, sent_at_ns=pose.sent_at_ns
    )
