"""CACC falls back to ACC in random total losses, and no cars collide where theory promises it.

Without a drive lag the gap error e = g - d - h v of ACC obeys de/dt = -λ e, whatever the
predecessor does (Rajamani, section 6.6): a fallback that begins with e >= 0 does not end in a
collision. The time until the fallback, the latency of the gap sensor and the drive lag take away
from that. The independent integration of `integrated_string` finds the headway from which the rest
suffices, for the lead of Plexe's braking scenario (8 m/s², lag 0.5 s) at the worst instant.

The followers only extrapolate, so that the laws act alone. A cut does not end while the cars brake:
PATH's CACC closes errors slowly (ω 0.2 rad/s), and its theory does not cover a return at a large
difference in speed. With the reaction "degrade" its guard does.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.virtual import run_unlogged
from tests.made.convoys.integrated_string import GAPS, String
from vehicles.car.parameters import LINCOLN_MKZ

PROMISED, TOO_SMALL = 1.2, 0.6
"""Headways (s) at which theory does and does not exclude a collision."""
BRAKES_AT = 5.0
"""Beginning (s) of the braking in the shipped scenario."""
DURATION_S = 14.0
CUTS = ("", "receiver='v2',", "receiver='v3',", "sender='v1',", "sender='v1',receiver='v2',",
        "sender='v2',receiver='v3',")  # fmt: skip
"""Cut links: all, those of a receiver or a sender, or one."""


@dataclass(frozen=True)
class RandomCut:
    """A random law, motion of the lead, and cut (s); `headway` in s."""

    seed: int
    headway: float

    def scenario(self) -> Scenario:
        chance = np.random.default_rng([self.seed, 7])
        law = ("ploeg", "cacc")[chance.integers(2)]
        at_s = round(float(chance.uniform(1.0, 8.0)), 2)
        for_s = round(float(chance.uniform(0.3, 8.0)), 2)
        links = CUTS[chance.integers(len(CUTS))]
        lead: Sequence[str] = ()
        is_open = chance.random() < 0.3
        if brakes := chance.random() < 0.8:
            begins = float(np.clip(at_s + chance.uniform(-1.5, 2.0), 0.5, 8.0))
            lead = [profile_from(round(begins, 2))]
            is_open |= begins < at_s + for_s < DURATION_S
        ends = "" if is_open else f"for_s={for_s},"
        return load_scenario(
            "plexe_braking" if brakes else "plexe_sinusoidal",
            [
                "convoy.vehicles=3",
                f"duration_s={DURATION_S}",
                f"control.longitudinal.use={law}",
                f"speed.gap.standstill_m={GAPS[law][0]}",
                f"speed.gap.headway_s={self.headway}",
                "control.degradation.reaction=extrapolate",
                f"change=[{{kind='cut',{links}{ends}at_s={at_s}}}]",
                "gap_sensor.gap_noise_m=0.1",
                "gap_sensor.gap_rate_noise_mps=0.1",
                *lead,
            ],
            self.seed,
        )

    def least_gap_m(self) -> float:
        """Least gap (m) of the run, 0 after a collision."""
        summary = run_unlogged(self.scenario())
        if any(event.kind == "collision" for event in summary.events):
            return 0.0
        return min(row.true_gap_m_min for row in summary.vehicles if row.true_gap_m_min is not None)


def profile_from(begins: float) -> str:
    """Profile of the shipped braking scenario that begins to brake at `begins` (s)."""
    points = load_scenario("plexe_braking").tables.speed.profile
    moved = [(max(p.at_s + begins - BRAKES_AT, 0.0), p.speed_mps) for p in points]
    return f"speed.profile=[{','.join(f'{{at_s={t:.3f},speed_mps={v}}}' for t, v in moved)}]"


def worst_case(law: str, headway: float) -> float:
    """Least gap (m) by the integration, over instants of braking around the cut."""
    profile = load_scenario("plexe_braking").route.profile
    cut, least = 1.0, math.inf
    for late in (-0.1, -0.02, 0.1):
        shift = BRAKES_AT - cut - late
        string = String(
            law,
            2,
            LINCOLN_MKZ.length,
            lambda t, shift=shift: profile.at(t + shift)[0],  # type: ignore[misc]
            (GAPS[law][0], headway),
            (cut, math.inf),
        )
        least = min(least, float(string.gaps(9.0)[1].min()))
    return least


@pytest.mark.parametrize("law", ["ploeg", "cacc"])
def test_theory_excludes_a_collision_from_a_headway_of_1_2_s(law: str) -> None:
    assert worst_case(law, PROMISED) > 0.0
    assert worst_case(law, TOO_SMALL) < 0.0


@pytest.mark.campaign(3, 1000)
def test_no_collision_where_theory_promises_it(case: int) -> None:
    assert RandomCut(case, PROMISED).least_gap_m() > 0.0


@pytest.mark.campaign(1, 40)
def test_a_smaller_headway_ends_in_collisions(campaign: int) -> None:
    collided = (RandomCut(seed, TOO_SMALL).least_gap_m() == 0.0 for seed in range(4, 400))
    assert sum(next(collided) for _ in range(campaign))
