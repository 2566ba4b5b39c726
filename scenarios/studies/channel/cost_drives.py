"""Runs of `convoy channel figure`, and the largest error of each.

Three cars drive the first lane change of `lossy_lane_change` at 30 m/s in virtual time and send ten
messages per second. The error is the largest true distance of the last car from the lead's path.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from statistics import median

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.virtual.unlogged_run import drive_trial
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job

SCENARIO = "lossy_lane_change"
SETTINGS = (
    *("convoy.vehicles=3", "gnss.rate_hz=10.0", "duration_s=11.0"),
    *("links.jitter_ms=0.0", "links.loss_ratio=0.0"),
)
"""Overrides of the scenario. The last car completes its lane change after 9 s."""
FLOOR_MS = 20.0
"""Latency (ms) while another quantity varies."""
BURST_LOSS_RATIO = 0.2
"""Loss ratio while the mean burst varies."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Values of each axis, and the number of seeds for each channel.

    The shortest mean burst is 1 / (1 - loss), that of independent losses.
    """

    gaps_m: tuple[float, ...] = (3.0, 10.0)
    loss_ratios: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    latencies_ms: tuple[float, ...] = (20.0, 60.0, 100.0, 150.0, 200.0, 300.0, 400.0)
    bursts_messages: tuple[float, ...] = (1.25, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
    map_seeds: int = 9
    burst_seeds: int = 20

    @property
    def channels(self) -> Iterator["Channel"]:
        for gap in self.gaps_m:
            for burst in self.bursts_messages:
                yield Channel(gap, BURST_LOSS_RATIO, FLOOR_MS, burst)
            for loss in self.loss_ratios:
                for latency in self.latencies_ms:
                    yield Channel(gap, loss, latency)

    def seeds(self, channel: "Channel") -> range:
        count = self.map_seeds if channel.burst_messages is None else self.burst_seeds
        return range(1, count + 1)


QUICK = Plan(
    loss_ratios=(0.0, 0.6),
    latencies_ms=(20.0, 400.0),
    bursts_messages=(1.25, 12.0),
    map_seeds=1,
    burst_seeds=1,
)
"""A small plan for a preview."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel at one gap; losses are independent if there is no mean burst."""

    gap_m: float
    loss_ratio: float
    latency_ms: float
    burst_messages: float | None = None

    def scenario(self, seed: int) -> Scenario:
        loss = f"links.loss_ratio={self.loss_ratio}"
        if self.burst_messages is not None:
            law = f"loss_ratio={self.loss_ratio}, burst_messages_mean={self.burst_messages}"
            loss = f"links.loss={{kind='gilbert_elliott', {law}}}"
        own = (f"convoy.gap_m={self.gap_m}", f"links.latency_ms={self.latency_ms}", loss)
        return load_scenario(SCENARIO, (*SETTINGS, *own), seed)


@dataclass(frozen=True, slots=True)
class Cost:
    """Largest true error (m) of the last vehicle over a channel, per seed."""

    channel: Channel
    errors_m: tuple[float, ...]

    @property
    def median_m(self) -> float:
        return median(self.errors_m)

    @property
    def largest_m(self) -> float:
        return max(self.errors_m)

    def runs_beyond(self, limit_m: float) -> int:
        return sum(error > limit_m for error in self.errors_m)


def lane_margin_m() -> float:
    """Distance from the lead's path (m) at which a car of the convoy leaves its lane."""
    scenario = load_scenario(SCENARIO)
    width = scenario.vehicle(scenario.lead).parameters.width
    return 0.5 * (scenario.tables.events.lane_width_m - width)


def simulate_costs(plan: Plan, engine: Engine) -> list[Cost]:
    """Simulate every channel of `plan` with every seed; returns costs in that order."""
    runs = [(channel, seed) for channel in plan.channels for seed in plan.seeds(channel)]
    jobs = [
        Job(key=f"{channel}, seed {seed}", work=partial(error_m, channel, seed))
        for channel, seed in runs
    ]
    engine.progress.total = len(jobs)
    errors = dict(zip(runs, engine.results(jobs), strict=True))
    return [
        Cost(channel, tuple(errors[channel, seed] for seed in plan.seeds(channel)))
        for channel in plan.channels
    ]


def error_m(channel: Channel, seed: int) -> float:
    """Simulate one run; returns the largest true error (m) of the last vehicle."""
    return drive_trial(channel.scenario(seed)).cross_track[-1]
