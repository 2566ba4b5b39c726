"""States of a follower, and the sources along which it steers.

The state follows from the sources (`TRANSITIONS`) and decides on the speed (`speed_guard`); the
mode names the sources of the trajectory.
"""

from collections.abc import Sequence
from math import isnan
from typing import Final, Literal

from vehicles.driver.controller import SourceState
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import LOST, STOP_MARGIN, Situation, needed_deceleration
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.messages import Mode, State

NOTHING_RECEIVED: Final = "nothing received yet"
NO_TRAJECTORY: Final = "no trajectory through the received samples"
LONGEST_SILENCE: Final = 1.5
"""Silence (s) of all sources after which a car does not drive on to the end of its known path,
although its sources send too rarely to be lost by then."""

Finding = Literal["waiting", "received", "back", "lead only", "silent"]
"""What the sources of a follower amount to at a control instant."""

Trajectory = Literal["none", "kept", "fitted"]
"""Whether the last fit found a trajectory, kept an earlier one, or there has been none yet."""

FINDINGS: dict[Finding, str] = {
    "waiting": "nothing received from the predecessor, and its first message is not overdue",
    "received": "the predecessor is received, and a source gives a path",
    "back": "the predecessor is received again, for less than the probation",
    "lead only": "the predecessor is lost or distrusted, and another source gives a path",
    "silent": "no source gives a path, or all are silent and the known path ends",
}

STATES: dict[State, str] = {
    "start": "before the first message of the predecessor: keeps its speed",
    "follow": "the longitudinal law acts on the predicted motion of the vehicles ahead",
    "alone": "the predecessor is silent: drives as the lead does, or by the gap sensor",
    "return": "the predecessor is received again: as follow, but without accelerating",
    "stop": "stops within the known path",
}

TRANSITIONS: dict[Finding, dict[State, State]] = {
    "waiting": {},
    "received": dict.fromkeys(STATES, "follow"),
    "back": {"start": "follow", "alone": "return", "stop": "return"},
    "lead only": dict.fromkeys(STATES, "alone"),
    "silent": dict.fromkeys(STATES, "stop"),
}
"""Next state by finding and state; a state that is missing is kept."""


class StateMachine:
    """State of a follower, which `TRANSITIONS` derives from what it receives, and its mode."""

    def __init__(self, settings: DegradationSettings) -> None:
        self._comfortable = settings.comfortable.deceleration
        self.state: State = "start"
        self._mode: Mode = "straight"
        self._relied: list[Source] = []

    def decide(
        self,
        now: int,
        sources: Sources,
        situation: Situation,
        speed: float,
        trajectory: Trajectory,
    ) -> tuple[Mode, str]:
        """Update the state at `now` (ns) and `speed` (m/s); returns the mode and its reason."""
        finding = self._finding(now, sources, situation, speed)
        self.state = situation.state = TRANSITIONS[finding].get(self.state, self.state)
        relied = list(sources.relied.values())
        if self.state == "return" and not relied:
            relied = [source for source in sources.used.values() if source.usable]
        has_path = trajectory != "none"
        mode, last = self._mode_along(sources, relied, has_path=has_path), self._mode
        missing = [_missing_reason(one) for one in sources.used.values() if one not in relied]
        why = []
        if mode != last and relied:  # the sources that give a path again
            again = [source for source in relied if source not in self._relied] or relied
            why = [f"{source.name} received, {_newest(source.state)}" for source in again]
        if mode == "straight":
            missing = missing if has_path else [NOTHING_RECEIVED]
        elif mode == "stop":
            missing.append(_stopping_reason(situation, speed))
        self._mode, self._relied = mode, relied
        return mode, "; ".join([*why, *missing])

    def _finding(self, now: int, sources: Sources, situation: Situation, speed: float) -> Finding:
        predecessor, relied = situation.predecessor, sources.relied
        status = predecessor.status
        if status == "unheard" and now <= predecessor.lost_at:
            return "waiting"
        if status == "probation" and sources.predecessor is not None:
            # A predecessor that is back gives a path, unless it may have left it.
            if relied or not sources.predecessor.has_left_path:
                return "back"
            return "silent"
        if not relied or self._runs_out(sources, situation, speed):
            # Samples of a source that is received, but not yet usable, are awaited.
            awaited = status in ("fresh", "late") and self.state in ("start", "follow")
            unusable = not any(source.usable for source in sources.used.values())
            return "received" if awaited and unusable else "silent"
        return "lead only" if status in LOST or status == "unheard" else "received"

    def _runs_out(self, sources: Sources, situation: Situation, speed: float) -> bool:
        """Whether all sources are silent and the known path requires braking."""
        if min([one.state.silence for one in sources.relied.values()]) <= LONGEST_SILENCE:
            return False
        left = situation.known - STOP_MARGIN
        return self.state == "stop" or needed_deceleration(speed, left) > self._comfortable

    def _mode_along(self, sources: Sources, relied: Sequence[Source], *, has_path: bool) -> Mode:
        if self.state == "stop":
            return "stop"
        if not has_path:
            return "straight"
        if not relied:
            return "straight" if self._mode == "stop" else self._mode
        return "composite" if len(relied) > 1 else sources.mode_along(relied[0])


class ModesByReach:
    """Modes of the baselines, which continue at full speed.

    The car steers along sources whose samples reach ahead of it, however old they are. Without any
    it coasts: along its last trajectory, or as its reaction prescribes.
    """

    def decide(
        self,
        now: int,
        sources: Sources,
        situation: Situation,
        speed: float,
        trajectory: Trajectory,
    ) -> tuple[Mode, str]:
        """Mode and its reason, as of `StateMachine`."""
        reaching = [sources.mode_along(one) for one in sources.used.values() if one.reaches]
        silent = [source for source in sources.used.values() if not source.reaches]
        why = "; ".join([_missing_reason(source) for source in silent])
        if trajectory == "none":
            return "straight", NOTHING_RECEIVED
        if trajectory == "kept":
            return "coast", why or NO_TRAJECTORY
        return ("composite" if len(reaching) > 1 else reaching[0]), why


def _missing_reason(source: Source) -> str:
    """Why a source is not relied on."""
    state = source.state
    if state.leaving:
        why = "has left the convoy"
    elif state.status == "unheard":
        why = "not received yet"
    elif state.status == "probation":
        why = "on probation"
    elif state.status == "distrusted":
        why = f"distrusted as {source.refusal} for {state.silence:.1f} s"
    elif state.status == "lost" or state.silence > LONGEST_SILENCE:
        why = f"silent for {state.silence:.1f} s, {_newest(state)}"
    elif source.has_left_path:
        why = f"may be off the path in mode {state.mode}"
    else:
        why = "has too few poses"
    return f"{source.name} {why}"


def _newest(state: SourceState) -> str:
    where = f"{abs(state.known):.1f} m {'ahead' if state.known >= 0.0 else 'behind'}"
    return f"newest pose {state.age:.2f} s old, path ends {where}"


def _stopping_reason(situation: Situation, speed: float) -> str:
    if isnan(situation.known):
        return "no known path"
    if situation.blind > 0.0:
        return f"{situation.blind:.1f} m too short to stop"
    return f"a stop needs {needed_deceleration(speed, situation.known):.1f} m/s²"
