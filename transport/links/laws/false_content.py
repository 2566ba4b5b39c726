"""Laws of false content: a link replaces the content of messages, or adds messages.

They test whether followers recognise it. The content of a message is all that its sender measured:
place, course, motion and the accuracy that its receiver reports. Name, number and instants stay
those of the message itself.
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

LATEST_S = 86_400
"""No run is longer."""

Seconds = Annotated[float, Field(ge=0, le=LATEST_S)]
Metres = Annotated[float, Field(ge=-10_000, le=10_000)]
Velocity = Annotated[float, Field(ge=-100, le=100)]

Recall = Callable[[int], GpsPose | None]
"""Returns the sender's newest known pose that was sent by an instant (ns), as it was sent.

Known is what physically came, lost on the emulated link or not.
"""


@dataclass(frozen=True, slots=True)
class FalseInterval:
    """From when (ns, inclusive) until when (ns, exclusive) content is false, by when it is sent."""

    from_at: int = 0
    to_at: float = inf

    def __contains__(self, at: int) -> bool:
        return self.from_at <= at < self.to_at


@dataclass(frozen=True, slots=True)
class Shift:
    """A shift in the plane (m, or m/s): along the world's axes, and along the sender's course."""

    east: float = 0.0
    north: float = 0.0
    ahead: float = 0.0
    left: float = 0.0


class FalseContent(LawTable):
    """False content, of what is sent from `from_s` on until `to_s` after the start of the run.

    Without `to_s` it lasts to the end. `kind` is its word in the verdicts. By default it needs no
    earlier messages and adds none.
    """

    from_s: Seconds = 0.0
    to_s: Seconds | None = None
    kind: str

    def problems(self) -> Iterator[Problem]:
        if self.to_s is not None and self.to_s <= self.from_s:
            yield "to_s", f"given {self.to_s}, allowed more than from_s, {self.from_s}"

    @cached_property
    def span(self) -> FalseInterval:
        start_at = self.setting.start_at
        to_at = inf if self.to_s is None else start_at + round(self.to_s * SECOND)
        return FalseInterval(start_at + round(self.from_s * SECOND), to_at)

    @property
    def moments(self) -> tuple[int, ...]:
        """Instants (ns) of which it needs the last message."""
        return ()

    @property
    def age(self) -> int:
        """Age (ns) up to which it needs all messages."""
        return 0

    @property
    def after(self) -> int | None:
        """By how much (ns) the further message that it adds comes later, None if it adds none."""
        return None

    def extra_message(self, pose: GpsPose, plane: LocalPlane) -> GpsPose:
        """Return the further message beside `pose`.

        Raises RefusedMessageError for a place beyond the plane.
        """
        raise NotImplementedError

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        """Return the pose in the place of `pose`, or None if that stays as it is.

        Raises RefusedMessageError for a place beyond the plane.
        """
        raise NotImplementedError

    def describe(self) -> str:
        end = "" if self.to_s is None else f" to {self.to_s:g} s"
        return f"false content: {self.kind} from {self.from_s:g} s on{end}"


class Displaced(FalseContent):
    """Base of content with another place."""

    @property
    def by(self) -> Shift:
        """By how much the place differs (m, or m/s)."""
        raise NotImplementedError

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        if self.by == Shift():
            units = ("_m", "_mps")
            keys = ", ".join(key for key in type(self).model_fields if key.endswith(units))
            yield "", f"moves nothing, allowed other than 0 in {keys}"


class FalseOffset(Displaced):
    """Places are displaced: in the plane, and along the sender's course."""

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
    """The place moves away from the true one, from `from_s` on."""

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
    """Messages repeat the last one before `from_s`, under new numbers and instants."""

    kind: Literal["frozen"] = "frozen"
    from_s: Annotated[float, Field(gt=0, le=LATEST_S)]

    @property
    def moments(self) -> tuple[int, ...]:
        return (self.span.from_at - 1,)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        """Repeat the last message before the span; None if none of then is known."""
        return replace_content(pose, recall(self.span.from_at - 1))


class ReplayedContent(FalseContent):
    """Messages repeat what was sent `age_s` earlier, under new numbers and instants."""

    kind: Literal["replayed"] = "replayed"
    age_s: Annotated[float, Field(gt=0, le=60)]

    @cached_property
    def age(self) -> int:
        return round(self.age_s * SECOND)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        """Repeat the newest message of that age or more; None if none of then is known."""
        return replace_content(pose, recall(pose.sent_at_ns - self.age))


class GhostVehicle(Displaced):
    """Beside each message comes one of a vehicle that is not there, in the sender's name.

    So that both places come in turn, it is stamped half a period of the sender's highest rate later
    than the true message and comes so much later, with the sender's motion. It has the number of
    the true message; the receiver's check of numbers does not see it.
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
        """Return the ghost's own message, beside the true `pose`.

        Raises RefusedMessageError for a place beyond the plane.
        """
        on = pose.speed_mps * self.after / SECOND
        there = displace(pose, plane, replace(self.by, ahead=self.ahead_m + on))
        return shift_times(there, self.after)


def displace(pose: GpsPose, plane: LocalPlane, by: Shift, times: float = 1.0) -> GpsPose:
    """Return `pose` at another place, `times` the shift away.

    Raises RefusedMessageError if that lies beyond the plane.
    """
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
    """Return the content of `old` under the number and the instants of `pose`."""
    if old is None:
        return None
    return replace(
        old, seq=pose.seq, measured_at_ns=pose.measured_at_ns, sent_at_ns=pose.sent_at_ns
    )
