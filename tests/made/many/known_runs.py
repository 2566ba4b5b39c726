"""A small convoy without noise and jitter, whose runs depend only on the lost messages.

There is one run for each subset of ten messages. The probability that a run breaks a limit is
therefore known for any ratio of independent losses.
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
"""A true error (m) that no vehicle reaches."""

Lost = tuple[int, ...]
ALL_LOST = [
    tuple(number for number, is_lost in enumerate(losses) if is_lost)
    for losses in product((False, True), repeat=MESSAGES)
]
"""All subsets of messages, by their numbers."""


def small_convoy(*settings: str) -> Variant:
    """Two cars in a bend at 20 m/s, for two seconds."""
    text = load_scenario("lossy_lane_change").text
    return Variant(text=text, name="lossy_lane_change", overrides=(*SETTINGS, *settings))


def probability(lost: Lost, ratio: float) -> float:
    """Probability that exactly these messages are lost."""
    return float(ratio ** len(lost) * (1.0 - ratio) ** (MESSAGES - len(lost)))


@dataclass
class KnownRuns:
    """The small convoy with a ratio of losses and a bound of the true error (m).

    Runs and branches lose the same messages as in the emulator, by the same keys. Each subset of
    losses is simulated once, when it is first needed.
    """

    ratio: float
    bound: float
    simulated: dict[Lost, tuple[SeverityRecord, ...]] = field(default_factory=dict)

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
        if lost not in self.simulated:
            numbers = ",".join(map(str, lost))
            law = [f"links.loss={{kind='listed', lost_numbers='{numbers}'}}"] if lost else []
            variant = small_convoy("links.loss_ratio=0", *law)
            found = watch_limit(variant.scenario, Limit("cross_track_error_m_max", NEVER))
            self.simulated[lost] = found.records
        beyond = [
            SeverityRecord(one.at, one.value + NEVER - self.bound) for one in self.simulated[lost]
        ]
        held = [one for one in beyond if one.value <= 0.0]
        return LimitHistory(
            (*held, *(SeverityRecord(one.at, inf) for one in beyond[len(held) :][:1]))
        )

    def run(self, seed: int, branches: tuple[Branch, ...] = ()) -> BranchedRun:
        return BranchedRun(seed, branches, self.history_of(self.lost(seed, branches)))

    def truth(self) -> float:
        """Exact probability that a run breaks the limit."""
        return sum(probability(one, self.ratio) for one in ALL_LOST if self.history_of(one).broken)

    def counted(self, seeds: range) -> int:
        """Number of seeds that break the limit."""
        broken = {lost for lost in ALL_LOST if self.history_of(lost).broken}
        return sum(self.lost(seed) in broken for seed in seeds)


@dataclass
class SilentRuns(KnownRuns):
    """The same runs, with the number of consecutive losses as severity, which has many ties."""

    def history_of(self, lost: Lost) -> LimitHistory:
        broken = super().history_of(lost).broken
        records, row = list[SeverityRecord](), 0
        for number in range(MESSAGES):
            row = row + 1 if number in lost else 0
            if row > (records[-1].value if records else -1):
                at = self.scenario.start_at_ns + number * PERIOD_NS
                records.append(SeverityRecord(at, float(row)))
        end = self.scenario.start_at_ns + MESSAGES * PERIOD_NS
        return LimitHistory((*records, *([SeverityRecord(end, inf)] if broken else [])))
