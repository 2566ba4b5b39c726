"""How fresh what a follower knows is, in seconds and in metres; SI units, NaN where unknown."""

from dataclasses import dataclass, field
from math import nan

from vehicles.messages import Mode, SourceStatus

LOST: tuple[SourceStatus, ...] = ("lost", "distrusted")
"""Statuses of a source that is silent for too long, or whose poses are refused."""
SLOWING: tuple[Mode, ...] = ("coast", "stop")
"""Modes without known road ahead, in which a follower that degrades slows down."""


@dataclass(slots=True)
class SourceFreshness:
    """What a follower knows of one source at a control instant.

    `age` (s) is that of the newest sample, counted from when it was measured, `silence` (s) the
    time since it was received, `period` (s) the time between messages as expected, `share` that of
    the messages of the last second which were received. Its path is known up to `known` (m) ahead
    of the car, negative where it ends behind. `lost_at` (ns) is when it is lost unless it is
    received again. `mode`, `hazard`, `acceleration` (m/s²) and `stops_at` (ns) are what it
    announced last.
    """

    status: SourceStatus = "unheard"
    age: float = nan
    silence: float = nan
    period: float = nan
    share: float = nan
    known: float = nan
    mode: Mode = "path"
    hazard: bool = False
    acceleration: float = 0.0
    lost_at: int = 0
    stops_at: int = 0

    def __init__(  # noqa: PLR0917 - its fields
        self,
        status: SourceStatus = "unheard",
        age: float = nan,
        silence: float = nan,
        period: float = nan,
        share: float = nan,
        known: float = nan,
        mode: Mode = "path",
        hazard: bool = False,
        acceleration: float = 0.0,
        lost_at: int = 0,
        stops_at: int = 0,
    ) -> None:
        self.status = status
        self.age = age
        self.silence = silence
        self.period = period
        self.share = share
        self.known = known
        self.mode = mode
        self.hazard = hazard
        self.acceleration = acceleration
        self.lost_at = lost_at
        self.stops_at = stops_at


@dataclass(slots=True)
class Situation:
    """What a follower knows of its sources, its road and its brakes at a control instant.

    The first follower has one source, which is both. `known` (m) is the path
    known ahead of the car by all sources; `comfortable_stop` and `firm_stop` are the braking
    distances (m), `blind` how far the car would drive beyond the known path in the hardest stop (m,
    0 if it stops within).
    `predecessor_weight` is the predecessor's weight in the trajectory, `hazard` whether the car
    warns those behind, `stops_at` (ns) when it begins to stop unless it hears more, as it announces
    to them, 0 if it does not mean to.
    """

    lead: SourceFreshness = field(default_factory=SourceFreshness)
    predecessor: SourceFreshness = field(default_factory=SourceFreshness)
    known: float = nan
    comfortable_stop: float = nan
    firm_stop: float = nan
    blind: float = nan
    predecessor_weight: float = nan
    hazard: bool = False
    stops_at: int = 0

    def __init__(  # noqa: PLR0917 - its fields
        self,
        lead: SourceFreshness | None = None,
        predecessor: SourceFreshness | None = None,
        known: float = nan,
        comfortable_stop: float = nan,
        firm_stop: float = nan,
        blind: float = nan,
        predecessor_weight: float = nan,
        hazard: bool = False,
        stops_at: int = 0,
    ) -> None:
        self.lead = SourceFreshness() if lead is None else lead
        self.predecessor = SourceFreshness() if predecessor is None else predecessor
        self.known = known
        self.comfortable_stop = comfortable_stop
        self.firm_stop = firm_stop
        self.blind = blind
        self.predecessor_weight = predecessor_weight
        self.hazard = hazard
        self.stops_at = stops_at
