"""One vehicle or link is cut off: nobody is hit, and a short silence costs little."""

from random import Random

import pytest

from tests.made.convoys.driven import collisions, driven, summary_of


@pytest.mark.campaign(1, 200)
def test_random_cuts_of_one_vehicle_or_link_end_without_a_collision(case: int) -> None:
    chance = Random(case)
    place = chance.randint(2, 4)
    kinds = [f"receiver='v{place}'", f"sender='v{place - 1}', receiver='v{place}'"]
    if place < 4:
        kinds += [f"sender='v{place}'", f"sender='v{place}'}}, {{CUT, receiver='v{place}'"]
    speed, gap_m = chance.uniform(10.0, 33.0), chance.choice([3.0, 8.0, 20.0])
    headway_s = chance.choice([0.0, 0.3, 0.5])
    at_s, for_s = chance.uniform(1.0, 12.0), chance.uniform(0.2, 8.0)
    cut = f"kind='cut', at_s={at_s:.3f}, for_s={for_s:.3f}"
    change = f"{{CUT, {chance.choice(kinds)}}}".replace("CUT", cut)
    overrides = [
        f"duration_s={min(at_s + for_s + 12.0, 1050.0 / speed):.1f}",
        f"speed.set_mps={speed:.2f}",
        f"convoy.gap_m={gap_m + headway_s * speed:.3f}",
        f"speed.followers={chance.choice(['same', 'gap'])}",
        f"speed.gap.standstill_m={gap_m}",
        f"speed.gap.headway_s={headway_s}",
        f"links.latency_ms={chance.choice([20, 100])}",
        f"links.loss_ratio={chance.choice([0.0, 0.0, 0.2])}",
        f"change=[{change}]",
    ]
    assert collisions(summary_of("lane_change", *overrides, seed=case + 1)) == 0


def test_a_short_silence_costs_little_speed() -> None:
    """Half a second of messages from v3 to v4 is lost, of which v4 brakes for a tenth."""
    cut = "change=[{kind='cut', at_s=3.8, for_s=0.5, sender='v3', receiver='v4'}]"
    assert min(driven("lane_change", "duration_s=6", cut).speeds("v4")) > 27.5
