"""What a link makes a message say that is not true, for tests of what followers believe.

The content of a message is all that its sender measured: place, course, motion and what the
receiver says of its own accuracy. Name, number and instants stay those of the message itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, hypot, inf, sin
from typing import Protocol

from transport.codec import RefusedMessageError
from vehicles.geometry.geodesy import REACH, LocalPlane, yaw_from_heading
from vehicles.messages import GpsPose
from vehicles.schedule import SECOND

Recall = Callable[[int], GpsPose | None]
"""Gives the sender's newest pose that was sent by an instant (ns), as it was sent, if any is known.

Known is what physically came, lost on the emulated link or not.
"""


@dataclass(frozen=True, slots=True)
class FalseSpell:
    """From when (ns, inclusive) until when (ns, exclusive) content is false, by when it is sent."""

    from_at: int = 0
    to_at: float = inf

    def __contains__(self, at: int) -> bool:
        """Whether what is sent at `at` (ns) is concerned."""
        return self.from_at <= at < self.to_at


@dataclass(frozen=True, slots=True)
class Shift:
    """A way in the plane (m, or m/s): along the world's axes, and along the sender's own course."""

    east: float = 0.0
    north: float = 0.0
    ahead: float = 0.0
    left: float = 0.0


class FalseContent(Protocol):
    """One kind of false content; `kind` is its word in the verdicts."""

    @property
    def kind(self) -> str:
        """Word of the verdicts."""

    @property
    def span(self) -> FalseSpell:
        """When it acts."""

    def tell(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        """Return what is told in the place of `pose`, or None if that stays as it is.

        Raises RefusedMessageError for a place beyond the plane.
        """


@dataclass(frozen=True, slots=True)
class FalseOffset:
    """Every place is told `by` so much beside the true one."""

    span: FalseSpell
    by: Shift
    kind: str = "offset"

    def tell(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose:  # noqa: ARG002 - as all
        """Move the place."""
        return displaced(pose, plane, self.by)


@dataclass(frozen=True, slots=True)
class FalseDrift:
    """The place told moves away from the true one by `rate` (m/s) from the start of the span."""

    span: FalseSpell
    rate: Shift
    kind: str = "drift"

    def tell(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose:  # noqa: ARG002 - as all
        """Move the place by the rate times the time since the start."""
        return displaced(pose, plane, self.rate, (pose.sent_at_ns - self.span.from_at) / SECOND)


@dataclass(frozen=True, slots=True)
class FrozenContent:
    """Every message tells what the last one before the span did."""

    span: FalseSpell
    kind: str = "frozen"

    def tell(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:  # noqa: ARG002 - as all
        """Repeat the last message before the span; None if none of then is known."""
        return retold(pose, recall(self.span.from_at - 1))


@dataclass(frozen=True, slots=True)
class ReplayedContent:
    """Every message tells what the newest one that was sent `age` ns earlier did."""

    span: FalseSpell
    age: int
    kind: str = "replayed"

    def tell(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:  # noqa: ARG002 - as all
        """Repeat what was sent so long ago; None if nothing of then is known."""
        return retold(pose, recall(pose.sent_at_ns - self.age))


@dataclass(frozen=True, slots=True)
class GhostVehicle:
    """Beside each true message comes one of a vehicle `at` some way from the sender, in its name.

    So that two places are heard in turn, it is stamped `after` ns later than the true message and
    comes so much later, with the sender's motion. It has the number of the true message; the
    receiver's check of numbers does not see it.
    """

    span: FalseSpell
    at: Shift
    after: int
    kind: str = "ghost"

    def tell(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:  # noqa: ARG002 - as all
        """Leave the true message as it is."""
        return pose

    def beside(self, pose: GpsPose, plane: LocalPlane) -> GpsPose:
        """Return the ghost's own message, beside the true `pose`.

        Raises RefusedMessageError for a place beyond the plane.
        """
        on = pose.speed_mps * self.after / SECOND
        there = displaced(pose, plane, replace(self.at, ahead=self.at.ahead + on))
        return put_off(there, self.after)


def displaced(pose: GpsPose, plane: LocalPlane, by: Shift, times: float = 1.0) -> GpsPose:
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


def put_off(pose: GpsPose, by: int) -> GpsPose:
    """Return `pose` with instants that are `by` ns later."""
    measured_at_ns, sent_at_ns = pose.measured_at_ns + by, pose.sent_at_ns + by
    return replace(pose, measured_at_ns=measured_at_ns, sent_at_ns=sent_at_ns)


def retold(pose: GpsPose, old: GpsPose | None) -> GpsPose | None:
    """Return the content of `old` under the number and the instants of `pose`."""
    if old is None:
        return None
    return replace(
        old, seq=pose.seq, measured_at_ns=pose.measured_at_ns, sent_at_ns=pose.sent_at_ns
    )
