"""Plausibility of received poses: decides whether a follower uses them.

`transport.links.gate` has already checked that a message can be a pose at all (stamps, coordinates,
speeds). Fixes of the own receiver are checked by the own filter (`ego.pose_estimator`), announced
offsets are bounded in `intended_path`, and `preview.outliers` removes samples that the rest of a
fit contradicts.
"""

from dataclasses import dataclass, field
from math import isfinite
from typing import Final

from vehicles.driver.degradation.innovation_gate import (
    REFUSED,
    RESTART_POSES,
    Distrust,
    InnovationGate,
)
from vehicles.preview.received.samples import reachable
from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

QUIET: Final = SECOND  # Time (ns) after the last refusal until a source is trusted again


@dataclass(slots=True)
class _RefusalSpell:
    """A period in which poses of a source are refused: their number and the reported reasons."""

    refused_at: int = 0
    refused: int = 0
    reported: set[Distrust] = field(default_factory=set)


class Trust:
    """Decides whether to use the received poses of one source, and reports refusals.

    Poses are checked by their innovations, if there is a gate, and by reachability: a pose that no
    car can have driven to is refused until several agree on the new position. Reachability also
    catches outliers of receivers that state a large deviation. `at_new_place` is True if the last
    pose used is the first one at a new position.
    """

    def __init__(
        self, name: str, gate: InnovationGate | None = None, remarks: list[str] | None = None
    ) -> None:
        """Lines for the log, such as "v1 distrusted: frozen", are appended to `remarks`.

        Without a `gate` only jumps are refused, and nothing is reported.
        """
        self.at_new_place = False
        self._name = name
        self._gate = gate
        self._newest: ReceivedPose | None = None
        self._suspects: list[ReceivedPose] = []
        self._spell = _RefusalSpell()
        self._remarks = [] if remarks is None else remarks

    def judge(self, pose: ReceivedPose) -> Distrust:
        """Verdict on a pose; with a reason in `REFUSED` it must not be used."""
        reason: Distrust = ""
        if self._gate is not None:
            reason = self._gate.judge(pose)
            if reason or self._spell.reported:  # rare
                self._report(pose, reason, self._gate)
            if reason in REFUSED:
                return reason
        elif not isfinite(pose.east + pose.north + pose.yaw + pose.speed):
            return "impossible"
        return self._reach(pose) or reason

    def _reach(self, pose: ReceivedPose) -> Distrust:
        """Check whether a car can have driven from the newest pose to this one; late poses pass."""
        newest, suspects = self._newest, self._suspects
        self.at_new_place = False
        if newest is not None and pose.measured_at <= newest.measured_at:
            return ""
        if newest is not None and not reachable(newest, pose):
            if suspects and not reachable(suspects[-1], pose):
                suspects.clear()
            suspects.append(pose)
            if len(suspects) < RESTART_POSES:
                return "jumping"
            self.at_new_place = True
        suspects.clear()
        self._newest = pose
        return ""

    def _report(self, pose: ReceivedPose, reason: Distrust, gate: InnovationGate) -> None:
        spell, name = self._spell, self._name
        if reason in REFUSED:
            spell.refused_at = pose.received_at
            spell.refused += 1
        elif not reason and pose.received_at - spell.refused_at > QUIET:
            count = f"; {spell.refused} poses refused" if spell.refused else ""
            self._remarks.append(f"{name} trusted again{count}")
            self._spell = _RefusalSpell()
        if reason and reason not in spell.reported:
            spell.reported.add(reason)
            text = f"distrusted: {reason}"
            if reason not in REFUSED:
                text = f"{reason}: assumed accuracy {gate.deviation(pose):.2f} m"
            self._remarks.append(f"{name} {text}")
