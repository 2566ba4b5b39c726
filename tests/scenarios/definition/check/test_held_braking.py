"""Braking of the lead that the gaps hold: the small simulation against whole runs, closed form."""

from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner

from scenarios.cli.scenario_commands import check as check_command
from scenarios.definition.check.findings import whole_report
from scenarios.definition.check.held_braking import TYRES, braking_held, held_braking
from scenarios.definition.scenario import load_scenario
from scenarios.runs.virtual import run_unlogged
from tests.made.scenarios.messages import STRAIGHT

CLOSE = ["convoy.vehicles=3", 'speed.followers="gap"', "speed.gap.standstill_m=3.0",
         "speed.gap.headway_s=0.0", "speed.set_mps=30.0"]  # fmt: skip
UNGUARDED = [*CLOSE, 'control.degradation.reaction="extrapolate"']


def braking_at(rate: float) -> list[str]:
    """Overrides of a lead that brakes at `rate` (m/s²) from 30 m/s, just after a message."""
    stands = 3.0 + 30.0 / rate
    points = [(0.0, 30.0), (3.001, 30.0), (stands, 0.0)]
    profile = ", ".join(f"{{at_s={at:.4f}, speed_mps={speed}}}" for at, speed in points)
    return ['speed.lead="profile"', f"speed.profile=[{profile}]", f"duration_s={stands + 3.0:.1f}"]


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("held") / "straight.toml"
    path.write_text(STRAIGHT)
    return str(path)


@pytest.mark.parametrize("overrides", [UNGUARDED, [*UNGUARDED, "gnss.rate_hz=10.0"]])
def test_whole_runs_collide_above_the_held_braking_only(
    straight: str, overrides: list[str]
) -> None:
    held = held_braking(load_scenario(straight, overrides))
    assert held is not None
    assert 2.0 < held.simulated_mps2 < TYRES
    for factor, collides in ((0.85, False), (1.2, True)):
        runs = [*overrides, *braking_at(factor * held.simulated_mps2)]
        summary = run_unlogged(load_scenario(straight, runs))
        assert any(event.kind == "collision" for event in summary.events) == collides


def test_a_guard_holds_more_and_a_longer_delay_less(straight: str) -> None:
    def simulated(*overrides: str) -> float:
        held = held_braking(load_scenario(straight, [*CLOSE, *overrides]))
        assert held is not None
        return held.simulated_mps2

    unguarded = 'control.degradation.reaction="extrapolate"'
    assert simulated() > simulated(unguarded)
    latencies = [simulated(f"links.latency_ms={latency}") for latency in (20.0, 300.0, 600.0)]
    assert all(longer < shorter for shorter, longer in pairwise(latencies))


@pytest.mark.parametrize("gap", [3.0, 10.0, 40.0])
@pytest.mark.parametrize("unknown", [0.1, 0.5, 1.5])
def test_the_closed_form_is_the_limit_of_two_braking_cars(gap: float, unknown: float) -> None:
    """Both brake on a line, the second later and harder; the least gap is 0 at the limit."""
    braking, step = braking_held(gap, unknown), 1e-3
    t = np.arange(0.0, 400.0, step)
    speeds = 200.0 - braking * t, 200.0 - TYRES * np.maximum(t - unknown, 0.0)
    left = gap + np.cumsum(speeds[0] - speeds[1]) * step
    assert left.min() == pytest.approx(0.0, abs=0.05 * gap)


def test_figures_of_the_reference() -> None:
    """Time without data that a gap holds: 0.87 s for 3 m at 4 m/s², 0.9 s for 10 m at 6 m/s²."""
    assert braking_held(3.0, 0.87) == pytest.approx(4.0, abs=0.05)
    assert braking_held(10.0, 0.91) == pytest.approx(6.0, abs=0.05)
    assert braking_held(0.0, 0.0) == 0.0


def test_check_states_the_held_braking_and_warns_of_harder_braking(straight: str) -> None:
    report = whole_report(load_scenario(straight, [*UNGUARDED, *braking_at(7.5)]))
    (line,) = [line for line in report.warnings if "the gaps hold" in line]
    assert line.startswith("the lead brakes at up to 7.5 m/s², the gaps hold ")
    assert "a collision is possible" in line
    printed = CliRunner().invoke(check_command, [straight, *[f"--set={one}" for one in CLOSE]])
    text = " ".join(printed.output.split())
    assert "braking of the lead held" in text
    assert "from 30.0 m/s, simulated with 3 cars without losses" in text
    single = whole_report(load_scenario(straight, ["convoy.vehicles=1"]))
    assert single.held_braking is None


def test_the_summary_has_the_least_held_braking_at_the_age_of_data(straight: str) -> None:
    clean, cut = (
        run_unlogged(load_scenario(straight, ["duration_s=5.0", "convoy.vehicles=2", *more]))
        for more in ([], ['change=[{kind="cut", at_s=2.0, for_s=0.5}]'])
    )
    gap = 10.0
    assert clean.vehicles[0].held_braking_mps2_min is None
    least = clean.vehicles[1].held_braking_mps2_min
    assert least == pytest.approx(braking_held(gap, 0.06), abs=0.05)
    assert cut.vehicles[1].held_braking_mps2_min == pytest.approx(braking_held(gap, 0.56), abs=0.1)


def test_a_profile_begins_at_a_phase_that_the_seed_draws() -> None:
    begins = [
        load_scenario("plexe_braking", seed=seed).route.profile.times[1] for seed in range(40)
    ]
    assert all(5.0 <= begin <= 5.1 for begin in begins)
    assert max(begins) - min(begins) > 0.07
    assert load_scenario("plexe_braking", seed=3).route.profile.times[1] == begins[3]
    exact = load_scenario("plexe_braking", ["speed.profile_delay_s_max=0.0"], seed=3)
    assert exact.route.profile.times[1] == 5.0
