"""Which sources a follower believes, and what it says of those that it does not."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from vehicles.car.gnss import Fix
from vehicles.driver.degradation.trust.gate import Belief, Distrust, InnovationGate
from vehicles.schedule import SECOND

QUIET: Final = SECOND
"""So long (ns) after the last refused pose a source is said to be believed again."""


@dataclass(slots=True)
class _Doubt:
    """A spell in which poses of a source are refused: the reasons that were said, how many."""

    refused_at: int = 0
    refused: int = 0
    said: set[Distrust] = field(default_factory=set)


class Beliefs:
    """The gates of all sources; without gates everything is believed."""

    def __init__(self, gates: Mapping[str, InnovationGate] | None = None) -> None:
        """`gates` are by the names of the sources."""
        self._gates = dict(gates or {})
        self._doubts = {name: _Doubt() for name in self._gates}
        self._remarks: list[str] = []

    def judge(self, now: int, name: str, fix: Fix) -> Belief:
        """What to make of a pose of `name`, heard at `now` (ns)."""
        gate = self._gates.get(name)
        if gate is None:
            return Belief(believed=True, reason="", deviation=fix.accuracy)
        verdict, doubt = gate.judge(now, fix), self._doubts[name]
        if not verdict.believed:
            doubt.refused_at = now
            doubt.refused += 1
        elif doubt.said and now - doubt.refused_at > QUIET and not verdict.reason:
            many = f"; {doubt.refused} poses refused" if doubt.refused else ""
            self._remarks.append(f"{name} believed again{many}")
            doubt = self._doubts[name] = _Doubt()
        if verdict.reason and verdict.reason not in doubt.said:
            doubt.said.add(verdict.reason)
            what = f"not believed: {verdict.reason}"
            if verdict.believed:
                what = f"{verdict.reason}: accuracy taken for {verdict.deviation:.2f} m"
            self._remarks.append(f"{name} {what}")
        return verdict

    def remarks(self) -> tuple[str, ...]:
        """Lines for the log since the last call: "v1 not believed: frozen"."""
        if not self._remarks:
            return ()
        said, self._remarks = tuple(self._remarks), []
        return said
