"""Hardest braking of the lead that a convoy holds without contact: closed form, and true runs."""

from functools import partial
from itertools import pairwise
from math import ceil, hypot, inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.check.findings import check
from scenarios.definition.check.hard_braking import HeldBraking, braking_warnings, held_braking
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual.unlogged_run import run_unlogged
from tests.made.examples import examples
from vehicles.car.tyres import GRAVITY
from vehicles.geometry.sampled_path import FloatArray
from vehicles.messages import LinkVerdict, Message, TruePose
from vehicles.schedule import SECOND

GRIP = 0.9 * GRAVITY
POSES_S, TICK_S = 0.05, 0.02
BRAKES_AT_S = 3.0
BEGINS_S = BRAKES_AT_S + TICK_S
TIMES_S = np.arange(BEGINS_S, 15.0, TICK_S)
NOISE_M = 0.2
"""Errors of received positions and speeds, in a gap."""
CONVOY = """
name = "hard_braking"
duration_s = {duration_s}
[convoy]
vehicles = {vehicles}
[path]
kind = "segments"
segments = [{{ length_m = 1500.0 }}]
[speed]
lead = "profile"
followers = "gap"
braking_mps2_max = 12.0
profile = [
    {{ at_s = 0.0, speed_mps = {speed} }}, {{ at_s = {at_s}, speed_mps = {speed} }},
    {{ at_s = {stands_s}, speed_mps = 0.0 }},
]
[speed.gap]
standstill_m = {gap_m}
headway_s = {headway_s}
braking_mps2_max = {limit}
[links]
latency_ms = {latency_ms}
loss_ratio = {loss}
"""


def convoy(
    *,
    speed: float = 30.0,
    braking: float = 6.0,
    vehicles: int = 3,
    gap_m: float = 8.0,
    headway_s: float = 0.0,
    limit: float = 6.0,
    latency_ms: float = 20.0,
    loss: float = 0.0,
    seed: int = 1,
) -> Scenario:
    """A convoy whose lead brakes to a stop, just after it has sent a pose."""
    at_s = BEGINS_S
    stands_s = at_s + speed / braking
    text = CONVOY.format(
        **{key: value for key, value in locals().items() if key != "seed"},
        duration_s=stands_s + 2.0,
    )
    return scenario_from_text(text, seed=seed)


def held(scenario: Scenario, speed: float = 30.0) -> HeldBraking:
    result = held_braking(scenario, speed)
    assert result is not None
    return result


def collisions(summary: RunSummary) -> int:
    return sum(event.kind == "collision" for event in summary.events)


def least_gap_m(summary: RunSummary) -> float:
    return min(row.true_gap_m_min for row in summary.vehicles if row.true_gap_m_min is not None)


@given(
    speed=st.floats(15.0, 40.0), gap_m=st.floats(4.0, 12.0), latency_ms=st.floats(5.0, 100.0),
    limit=st.floats(3.0, 6.0),
)  # fmt: skip
@examples(10, 200)
def test_at_a_constant_gap_it_is_what_the_limit_and_the_delay_allow(
    speed: float, gap_m: float, latency_ms: float, limit: float
) -> None:
    """v² / 2 b_lead + gap = v² / 2 b + v · delay, as the first follower brakes at its limit."""
    found = held(convoy(speed=speed, gap_m=gap_m, latency_ms=latency_ms, limit=limit), speed)
    delay = latency_ms / 1000.0 + POSES_S
    for late in (delay, delay + TICK_S):
        stops_within = speed * speed / (2.0 * limit) + speed * late - gap_m
        allowed = speed * speed / (2.0 * stops_within) if stops_within > 0.0 else inf
        assert found.braking == pytest.approx(min(allowed, GRIP), rel=0.05)
    assert found.follower == ("v2" if found.braking < GRIP else "")


@pytest.mark.parametrize(("lag_s", "lead_lag_s"), [(0.3, 0.0), (0.1, 0.2), (0.3, 0.3)])
def test_a_drive_lag_acts_as_a_delay_of_the_brakes(lag_s: float, lead_lag_s: float) -> None:
    """With brakes of lag τ a car drives v τ further until it stands."""
    speed, gap_m, limit = 30.0, 12.0, 5.0
    lags = [
        f"parameters.drive_lag_s={lag_s}",
        f"vehicle.v1.parameters.drive_lag_s={lead_lag_s}",
    ]
    quick = convoy(speed=speed, gap_m=gap_m, limit=limit, vehicles=2)
    found = held(scenario_from_text(quick.text, overrides=lags), speed)
    late = 0.02 + POSES_S + 0.5 * TICK_S + lag_s - lead_lag_s
    allowed = speed * speed / (2.0 * (speed * speed / (2.0 * limit) + speed * late - gap_m))
    assert found.braking == pytest.approx(allowed, rel=0.02)


def test_a_wider_gap_and_a_faster_link_never_hold_less() -> None:
    by_gap = [held(convoy(gap_m=gap_m)).braking for gap_m in (2.0, 4.0, 8.0, 16.0)]
    by_latency = [held(convoy(latency_ms=latency)).braking for latency in (200.0, 100.0, 20.0)]
    by_loss = [held(convoy(loss=loss)).braking for loss in (0.6, 0.2, 0.0)]
    for values in (by_gap, by_latency, by_loss):
        assert values == sorted(values)
        assert values[0] < values[-1]


def test_followers_without_a_gap_to_keep_have_no_such_figure() -> None:
    assert check("lane_change").held_braking_mps2 is None
    assert check("highway", ["convoy.vehicles=1"]).held_braking_mps2 is None


@pytest.mark.parametrize("name", ["highway", "church_lot"])
def test_shipped_gaps_hold_all_that_the_lead_s_tyres_allow(name: str) -> None:
    assert check(name).held_braking_mps2 == pytest.approx(GRIP, abs=0.01)


def test_less_than_hard_braking_is_warned_of_with_figures_and_a_remedy() -> None:
    overrides = ("speed.gap.standstill_m=3.0", "speed.gap.headway_s=0.0", "links.latency_ms=200.0")
    (line,) = [line for line in check("highway", overrides).warnings if "braking" in line]
    assert line.startswith("v2: from 20.0 m/s a gap of 3.0 m holds braking of the lead up to 5.")
    assert "poses up to 0.25 s old" in line
    assert "Raise speed.gap.standstill_m" in line
    wide = ("speed.gap.standstill_m=8.0", *overrides[1:])
    assert not [line for line in check("highway", wide).warnings if "braking" in line]


@pytest.mark.campaign(1, 60)
def test_runs_have_contacts_exactly_above_the_held_braking(case: int) -> None:
    """Without loss, to 3 %: noise of positions and speeds costs up to 0.2 m."""
    speed, gap_m = [(30.0, 8.0), (25.0, 5.0), (20.0, 3.0), (35.0, 6.0)][case % 4]
    limit, headway_s = [(6.0, 0.0), (4.0, 0.0), (5.0, 0.1)][case % 3]
    latency_ms = [20.0, 100.0, 60.0, 5.0, 150.0][case % 5]
    lead_brakes_at = partial(
        convoy, speed=speed, gap_m=gap_m, limit=limit, headway_s=headway_s, latency_ms=latency_ms,
        seed=case + 1,
    )  # fmt: skip
    most = held(lead_brakes_at(braking=6.0), speed).braking
    assert collisions(run_unlogged(lead_brakes_at(braking=0.97 * most))) == 0
    if 1.03 * most < GRIP:
        assert collisions(run_unlogged(lead_brakes_at(braking=1.03 * most))) > 0


def test_a_constant_gap_of_8_m_holds_6_mps2() -> None:
    summary = run_unlogged(convoy(vehicles=4))
    assert collisions(summary) == 0
    assert least_gap_m(summary) > 6.0  # 1.6 m before the first pose with the braking arrives


class FeasibleGaps:
    """Least gaps (m) that kinematics allow in a run, by its messages and its gaps at the braking.

    Cars can brake at `limit` (m/s²) from the first received pose of a car ahead that brakes.
    """

    kinds = frozenset({LinkVerdict, TruePose})

    def __init__(self, scenario: Scenario, limit: float) -> None:
        self._scenario, self._limit = scenario, limit
        self._delivered: list[LinkVerdict] = []
        self._before: dict[str, TruePose] = {}

    def listen(self, _at: int, message: Message) -> None:
        match message:
            case LinkVerdict(outcome="delivered"):
                self._delivered.append(message)
            case TruePose() if self._seconds(message.true_at_ns) <= BEGINS_S + 1e-6:
                self._before[message.vehicle] = message

    def _seconds(self, at_ns: int) -> float:
        return (at_ns - self._scenario.start_at_ns) / SECOND

    def _begins(self) -> list[float]:
        names, begins = self._scenario.vehicle_names, [BEGINS_S]
        for ahead, name in pairwise(names):
            since = {ahead: begins[-1], names[0]: BEGINS_S}
            visible = [
                self._seconds(one.visible_at_ns)
                for one in self._delivered
                if one.vehicle == name
                and self._seconds(one.measured_at_ns) > since.get(one.sender, inf) - 1e-6
            ]
            begins.append(ceil(min(visible) / TICK_S - 1e-6) * TICK_S)
        return begins

    def _fronts(self, lead_braking: float) -> list[FloatArray]:
        """Positions (m) over time from the lead's start, as if cars had no length."""
        lead, result, lengths = self._before["v1"], [], 0.0
        for place, begin in enumerate(self._begins()):
            name = self._scenario.vehicle_names[place]
            pose, most = self._before[name], self._limit if place else lead_braking
            lengths += self._scenario.least_spacings[place]
            behind = hypot(pose.east_m - lead.east_m, pose.north_m - lead.north_m)
            brakes = np.clip(TIMES_S - begin, 0.0, pose.speed_mps / most)
            rolls = np.minimum(TIMES_S, begin) - BEGINS_S
            driven = pose.speed_mps * (rolls + brakes) - 0.5 * most * np.square(brakes)
            result.append(np.asarray(driven + lengths - behind))
        return result

    def if_all_brake(self, lead_braking: float) -> float:
        """Every car brakes at its limit as soon as it can."""
        fronts = self._fronts(lead_braking)
        return min(float(np.min(ahead - own)) for ahead, own in pairwise(fronts))

    def at_most(self, lead_braking: float) -> float:
        """A car brakes as soon as it can, and those ahead of it use up their gaps for it."""
        lead, *others = self._fronts(lead_braking)
        return min(float(np.min(lead - own)) for own in others)


@pytest.mark.campaign(1, 10)
@pytest.mark.spread(2)
@pytest.mark.parametrize("limit", [6.0, 8.0, 8.8])
@pytest.mark.parametrize("gap_m", [3.0, 8.0])
@pytest.mark.parametrize("latency_ms", [20.0, 100.0])
@pytest.mark.parametrize("loss", [0.0, 0.2, 0.6])
def test_many_cars_behind_a_lead_that_brakes_at_8_mps2(
    limit: float, gap_m: float, latency_ms: float, loss: float, case: int
) -> None:
    """No contact where the check expects none or kinematics allow none; else the check warns."""
    scenario = convoy(
        braking=8.0, vehicles=6, gap_m=gap_m, limit=limit, latency_ms=latency_ms, loss=loss,
        seed=case + 1,
    )  # fmt: skip
    gaps = FeasibleGaps(scenario, limit)
    summary = run_unlogged(scenario, [gaps])
    found = held(scenario)
    if found.braking >= 8.0 or gaps.if_all_brake(8.0) > NOISE_M:
        assert collisions(summary) == 0
    if gaps.at_most(8.0) < -NOISE_M:
        assert list(braking_warnings(found, 8.0))
        assert loss > 0.0 or collisions(summary) > 0  # silence can make followers brake before


def test_losses_do_not_matter_to_acc_with_a_gap_sensor() -> None:
    acc = ["control.longitudinal=acc", "speed.gap.headway_s=1.2", "convoy.vehicles=3"]

    def held(*settings: str) -> float:
        found = held_braking(load_scenario("plexe_base", [*acc, *settings]), 27.8)
        assert found is not None
        return found.braking

    lossy = "links.loss_ratio=0.9"
    assert held(lossy) == held() > 6.0
    assert held(lossy, "gap_sensor.range_m=0") < held(lossy, "gap_sensor.range_m=20") < 2.0
