"""A small convoy whose run depends on nothing but which messages were lost: no noise, no jitter.

So there are as many runs as ways to lose some of ten messages, and the probability that one breaks
a limit is known for any ratio of independent losses.
"""

from dataclasses import dataclass, field
from itertools import product
from math import inf

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import load_scenario
from scenarios.runs.virtual.virtual_convoy import Branch
from scenarios.studies.many.limit_history import LimitHistory, SeverityRecord, watch_limit
from scenarios.studies.many.splitting import BranchedRun
from scenarios.studies.many.variant import Variant
from transport.links.link import keyed_draw, switch_draw

MESSAGES, PERIOD_NS = 10, 200_000_000
SETTINGS = (
    "convoy.vehicles=2", "duration_s=2.0", "control.rate_hz=10", "gnss.rate_hz=5",
    "gnss.position_noise_m=0", "gnss.heading_noise_deg=0", "gnss.speed_noise_mps=0",
    "gnss.yaw_rate_noise_radps=0", "control.own_state='exact'", "parameters.tyres='linear'",
    "speed.set_mps=20", "speed.lateral_acceleration_mps2_max=20",
    "path.segments=[{length_m=2.0}, {length_m=60.0, radius_m=80.0, turn='right'}]",
    "links.jitter_ms=0", "links.latency_ms=20",
)  # fmt: skip
NEVER = 100.0
"""A true error (m) that nobody reaches."""

Lost = tuple[int, ...]
ALL_LOST = [
    tuple(number for number, gone in enumerate(way) if gone)
    for way in product((False, True), repeat=MESSAGES)
]
"""All ways to lose messages, by their numbers."""


def small_convoy(*settings: str) -> Variant:
    """Two cars in a bend at 20 m/s, for two seconds."""
    text = load_scenario("lossy_lane_change").text
    return Variant(text=text, name="lossy_lane_change", overrides=(*SETTINGS, *settings))


def probability(lost: Lost, ratio: float) -> float:
    """That just these messages are lost."""
    return float(ratio ** len(lost) * (1.0 - ratio) ** (MESSAGES - len(lost)))


@dataclass
class KnownRuns:
    """The small convoy with a ratio of losses and a bound of the true error (m).

    Its runs, and branches of them, lose the messages that those of the emulator lose, by the same
    keys; what then happens was driven once for each way to lose messages, when it was needed first.
    """

    ratio: float
    bound: float
    driven: dict[Lost, tuple[SeverityRecord, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.scenario = small_convoy(f"links.loss_ratio={self.ratio}").scenario
        self.link = self.scenario.vehicle_names

    def lost(self, seed: int, branches: tuple[Branch, ...] = ()) -> Lost:
        """Numbers of the messages that a run loses."""
        draw = keyed_draw(seed, *self.link)
        for branch in branches:
            sent = (branch.at - self.scenario.start_at_ns) // PERIOD_NS + 1
            draw = switch_draw(draw, keyed_draw(branch.seed, *self.link), sent)
        return tuple(number for number in range(MESSAGES) if draw("loss", number) < self.ratio)

    def history_of(self, lost: Lost) -> LimitHistory:
        """What is seen of the run that loses these messages."""
        if lost not in self.driven:
            numbers = ",".join(map(str, lost))
            law = [f"links.loss={{kind='listed', lost_numbers='{numbers}'}}"] if lost else []
            variant = small_convoy("links.loss_ratio=0", *law)
            found = watch_limit(variant.scenario, Limit("cross_track_error_m_max", NEVER))
            self.driven[lost] = found.records
        beyond = [
            SeverityRecord(one.at, one.value + NEVER - self.bound) for one in self.driven[lost]
        ]
        held = [one for one in beyond if one.value <= 0.0]
        return LimitHistory(
            (*held, *(SeverityRecord(one.at, inf) for one in beyond[len(held) :][:1]))
        )

    def run(self, seed: int, branches: tuple[Branch, ...] = ()) -> BranchedRun:
        """A run with a seed and branches."""
        return BranchedRun(seed, branches, self.history_of(self.lost(seed, branches)))

    def truth(self) -> float:
        """The probability that a run breaks the limit."""
        return sum(probability(one, self.ratio) for one in ALL_LOST if self.history_of(one).broken)

    def counted(self, seeds: range) -> int:
        """How many of the seeds break the limit."""
        broken = {lost for lost in ALL_LOST if self.history_of(lost).broken}
        return sum(self.lost(seed) in broken for seed in seeds)


@dataclass
class SilentRuns(KnownRuns):
    """The same runs, near the limit by how many messages were lost in a row: many are equal."""

    def history_of(self, lost: Lost) -> LimitHistory:
        """What is seen of the run that loses these messages."""
        broken = super().history_of(lost).broken
        records, row = list[SeverityRecord](), 0
        for number in range(MESSAGES):
            row = row + 1 if number in lost else 0
            if row > (records[-1].value if records else -1):
                at = self.scenario.start_at_ns + number * PERIOD_NS
                records.append(SeverityRecord(at, float(row)))
        end = self.scenario.start_at_ns + MESSAGES * PERIOD_NS
        return LimitHistory((*records, *([SeverityRecord(end, inf)] if broken else [])))
