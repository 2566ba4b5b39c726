"""Carries out and reports changes of one vehicle while it runs."""

from scenarios.definition.changing.link_changes import LINK_CHANGES
from scenarios.definition.schema.change_tables import (
    AnyChange,
    CrashTable,
    FixChangeTable,
    JoinTable,
    LeaveTable,
    SpeedChangeTable,
    StallTable,
)
from scenarios.runs.node.changed_links import ChangedLinks
from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.pending_changes import DueChange, PendingChanges
from scenarios.runs.node.phases import VehiclePhase
from vehicles.car.gnss import GnssReceiver
from vehicles.car.positioning.fix_states import NO_END
from vehicles.schedule import SECOND, nanoseconds

WORDS = {
    "stall": "its control stalls",
    "crash": "its process crashes",
    "leave": "it leaves the convoy, a human takes over",
    "join": "it joins the convoy",
    "gnss": "its receiver has another fix",
    "speed": "the set speed changes",
}
"""Log text by kind of change."""


class CrashedError(Exception):
    """The process of a vehicle has crashed for good, as requested."""


class ChangeExecutor:
    """Carries out the changes of a vehicle with its own car and software."""

    def __init__(self, pending_changes: PendingChanges, links: ChangedLinks) -> None:
        self.pending_changes = pending_changes
        self.links = links

    def apply(self, now: int, phase: VehiclePhase) -> VehiclePhase:
        """Carry out what is due at the tick at `now` (ns); returns the phase of this tick.

        Raises CrashedError if the vehicle does not return.
        """
        for due in self.pending_changes.take(now):
            phase = self._apply(due, now, phase)
        return phase.at(now)

    def _apply(self, due: DueChange, now: int, phase: VehiclePhase) -> VehiclePhase:
        context = phase.context
        if isinstance(due.change, LINK_CHANGES):
            context.outbox.publish_change(now, due, self.links.carry_out(due))
            return phase
        following = _phase_after(due, now, phase)
        if following is None:
            context.outbox.log(now, f"{describe_change(due.change)}: has no effect now", "warning")
            return phase
        context.outbox.publish_change(now, due, describe_change(due.change))
        match due.change:
            case CrashTable(for_s=None):
                raise CrashedError("its process has crashed, as requested")
            case FixChangeTable():
                change_fix(context.car.gnss, due.at, due.change)
            case SpeedChangeTable():
                after_s = (due.at - context.start_at) / SECOND
                context.plan = context.plan.changed(after_s, due.change)
                following.replan(now)
        return following


def _phase_after(due: DueChange, now: int, phase: VehiclePhase) -> VehiclePhase | None:
    """Phase after a change; None if the change has no effect."""
    match due.change:
        case StallTable(for_s=for_s):
            return phase.stalled(due.at + nanoseconds(for_s))
        case CrashTable(for_s=float(for_s)):
            return phase.crashed(due.at + nanoseconds(for_s))
        case LeaveTable():
            return phase.left(now)
        case JoinTable():
            return phase.joined(now)
        case _:
            return phase


def change_fix(gnss: GnssReceiver, at: int, change: FixChangeTable) -> None:
    """Force a fix from the instant `at` (ns) on, or restore the receiver's own law."""
    state = None if change.fix == "auto" else change.fix
    until = NO_END if change.for_s is None else at + nanoseconds(change.for_s)
    gnss.force(state, at, until)


def change_receiver(
    pending_changes: PendingChanges, gnss: GnssReceiver, outbox: Outbox, now: int
) -> None:
    """Carry out what is due at `now` (ns) for a vehicle that can only change its receiver."""
    for due in pending_changes.take(now):
        match due.change:
            case FixChangeTable():
                outbox.publish_change(now, due, describe_change(due.change))
                change_fix(gnss, due.at, due.change)
            case _:
                text = f"{describe_change(due.change)}: has no effect on a recorded drive"
                outbox.log(now, text, "warning")


def describe_change(change: AnyChange) -> str:
    named = {"kind", "at_s", "vehicle"}
    figures = change.model_dump(exclude=named, exclude_none=True)
    rest = ", ".join(f"{key} = {value}" for key, value in figures.items())
    words = WORDS.get(change.kind, change.kind)
    return f"{words} ({rest})" if rest else words
