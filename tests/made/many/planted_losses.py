"""Runs with one decisive burst of losses among harmless losses."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import tomli_w

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.studies.many.trials import RerunCriteria, rerun
from vehicles.schedule import SECOND

LANE = Limit("lane_departures_max", 0)
SOON_S = 3.0
"""After a decisive burst, a vehicle leaves the lane within this time of its end."""
Link = tuple[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Convoy:
    """A lane change: number of vehicles, duration (s), rate of the poses (Hz)."""

    vehicles: int
    duration_s: float
    rate_hz: float
    straight_s: float
    burst_s: tuple[float, float]
    harmless_ratio: float


TINY = Convoy(
    vehicles=2, duration_s=5.0, rate_hz=5.0, straight_s=1.0, burst_s=(1.2, 1.6),
    harmless_ratio=0.05,
)  # fmt: skip
SHORT = Convoy(
    vehicles=3, duration_s=6.0, rate_hz=10.0, straight_s=2.0, burst_s=(1.2, 1.6),
    harmless_ratio=0.03,
)  # fmt: skip
FULL = Convoy(
    vehicles=4, duration_s=35.0, rate_hz=20.0, straight_s=5.0, burst_s=(1.2, 1.7),
    harmless_ratio=0.02,
)  # fmt: skip
"""The double lane change of 35 s with four vehicles."""


@dataclass(frozen=True, slots=True)
class Planted:
    scenario: Scenario
    burst: range
    links: tuple[Link, ...]

    @property
    def messages(self) -> frozenset[tuple[Link, int]]:
        return frozenset((link, number) for link in self.links for number in self.burst)


def _scenario(convoy: Convoy, seed: int, burst: range, links: tuple[Link, ...]) -> Scenario:
    right = {"length_m": 30.0, "radius_m": 500.0, "turn": "right"}
    left = right | {"turn": "left"}
    straight, middle = {"length_m": 30.0 * convoy.straight_s}, {"length_m": 30.0}
    once = [straight, right, middle, left, {"length_m": 360.0}]
    text = {
        "extends": "lane_change",
        "name": "planted",
        "seed": seed,
        "duration_s": convoy.duration_s,
        "convoy": {"vehicles": convoy.vehicles},
        "gnss": {"rate_hz": convoy.rate_hz},
        "path": {
            "kind": "segments",
            "segments": [*once, left, middle, right, {"length_m": 430.0}],
        },
        "control": {
            "controller": "slip_compensated",
            "degradation": {"reaction": "extrapolate"},
        },
        "links": {"loss_ratio": convoy.harmless_ratio, "latency_ms": 20.0, "jitter_ms": 20.0},
    }
    if burst:
        numbers = f"{burst.start}-{burst.stop - 1}"
        loss = {"kind": "listed", "lost_numbers": numbers}
        text["link"] = [{"sender": a, "receiver": b, "loss": loss} for a, b in links]
    return scenario_from_text(tomli_w.dumps(text), label="planted")


def _breaks(scenario: Scenario, until_s: float) -> bool:
    end = round(until_s * SECOND)
    criteria = RerunCriteria(figure="error", limit=LANE, until=end)
    return rerun(scenario, criteria).broken_at is not None


@cache
def planted(convoy: Convoy, case: int) -> Planted:
    """Return a case in which a vehicle leaves the lane if and only if the burst occurs.

    The burst is on all links to one follower, at a random time of a lane change.
    """
    chance = np.random.Generator(np.random.PCG64([case, 14]))
    while True:
        place = int(chance.integers(1, convoy.vehicles))
        receiver = f"v{place + 1}"
        links = tuple((sender, receiver) for sender in dict.fromkeys(("v1", f"v{place}")))
        # The lead is in the first arc, of which the follower receives nothing.
        from_s = convoy.straight_s - 0.2 + float(chance.uniform(-0.3, 0.8))
        # Each vehicle further back knows half a second more of the path.
        length_s = float(chance.uniform(*convoy.burst_s)) + 0.5 * (place - 1)
        burst = range(round(from_s * convoy.rate_hz), round((from_s + length_s) * convoy.rate_hz))
        seed = int(chance.integers(1, 10_000))
        scenario = _scenario(convoy, seed, burst, links)
        without = _scenario(convoy, seed, range(0), ())
        alone = _scenario(replace(convoy, harmless_ratio=0.0), seed, burst, links)
        soon_s = from_s + length_s + SOON_S
        if not (_breaks(scenario, soon_s) and _breaks(alone, soon_s)):
            continue
        if not _breaks(without, convoy.duration_s):
            return Planted(scenario, burst, links)
