"""Shipped longitudinal controllers against an independent integration of their formulas.

Formulas as in Rajamani, Vehicle Dynamics and Control (eqs. 6.18, 7.39), Ploeg et al. 2014, Ali et
al. 2015 and Santini et al. 2017, behind a lead that varies its speed by 5 km/h at 0.2 Hz, or
brakes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from vehicles.car.dynamics import achieved_acceleration
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.driver.controller import (
    GapLimits,
    LongitudinalController,
    LongitudinalSetup,
    OwnMotion,
    SourceState,
    SpacingPolicy,
    VehiclesAhead,
)
from vehicles.driver.longitudinal_laws import (
    Acc,
    AccSettings,
    Cacc,
    CaccSettings,
    Consensus,
    ConsensusSettings,
    Flatbed,
    FlatbedSettings,
    Ploeg,
    PloegSettings,
)
from vehicles.driver.own_state import Pose
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import Situation
from vehicles.driver.speed import GapKeeping
from vehicles.driver.speed_guard import SpeedGuard
from vehicles.messages import SourceStatus
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]
Lead = Callable[[float], tuple[float, float]]

STATUSES: tuple[SourceStatus, ...] = ("fresh", "lost")
FOLLOWERS, STEP, DURATION = 3, 0.005, 20.0
LENGTH, SPEED, LAG = 5.0, 27.8, 0.5


def sinusoid(t: float) -> tuple[float, float]:
    """Speed (m/s) and acceleration (m/s²) of the lead at `t` (s)."""
    rate, size = 2.0 * math.pi * 0.2, 5.0 / 3.6
    begins = 1.0 - math.exp(-t)
    speed = SPEED + size * begins * math.sin(rate * t)
    change = size * (begins * rate * math.cos(rate * t) + math.exp(-t) * math.sin(rate * t))
    return speed, change


def braking(t: float) -> tuple[float, float]:
    """Braking of 2 m/s² for 5 s from 5 s on, with a ramp of 1 s."""
    ramp = min(max(t - 5.0, 0.0), 1.0) - min(max(t - 10.0, 0.0), 1.0)
    lost = _ramp_area(t - 5.0) - _ramp_area(t - 10.0)
    return SPEED - 2.0 * lost, -2.0 * ramp


def _ramp_area(t: float) -> float:
    """Integral of the ramp min(max(t, 0), 1)."""
    if t <= 0.0:
        return 0.0
    return 0.5 * t * t if t < 1.0 else t - 0.5


LAWS: dict[str, tuple[type[Any], Any, float, float]] = {
    "acc": (Acc, AccSettings(), 2.0, 1.5),
    "cacc": (Cacc, CaccSettings(), 5.0, 0.0),
    "ploeg": (Ploeg, PloegSettings(), 2.0, 0.5),
    "flatbed": (Flatbed, FlatbedSettings(), 5.0, 0.0),
    "consensus": (Consensus, ConsensusSettings(), 5.0, 0.8),
}
"""Class, parameters, standstill gap (m) and headway (s) of each law."""


def formula(law: str, state: Sequence[list[float]], i: int) -> float:
    """Command of follower i (1 is the first), or its derivative for Ploeg's law.

    Rows of the state: positions x (m) of front bumpers, speeds v, accelerations a and commands u,
    from lead to last.
    """
    x, v, a, u = state
    d, h = LAWS[law][2:]
    gap = x[i - 1] - x[i] - LENGTH
    if law == "acc":
        return -((v[i] - v[i - 1]) + 0.1 * (d + h * v[i] - gap)) / h
    if law == "cacc":  # ξ = 1, c1 = 0.5, ω = 0.2: α3 = -0.3, α4 = -0.1, α5 = -0.04
        error = d - gap
        feedforward = 0.5 * u[i - 1] + 0.5 * u[0]
        return feedforward - 0.3 * (v[i] - v[i - 1]) - 0.1 * (v[i] - v[0]) - 0.04 * error
    if law == "ploeg":
        error = gap - d - h * v[i]
        rate = v[i - 1] - v[i] - h * a[i]
        return (-u[i] + 0.2 * error + 0.7 * rate + u[i - 1]) / h
    if law == "flatbed":
        pull = 12.0 * (gap - d - 4.0 * (v[i] - v[0]))
        return -2.4 * a[i] + 0.6 * (v[i - 1] - v[i]) + pull
    sources = {0, i - 1}
    wanted = {j: (i - j) * (d + LENGTH + h * v[0]) for j in sources}
    weights = {0: 0.08, i - 1: 0.86} if i > 1 else {0: 0.46}
    total = sum(weights[j] * (x[j] - x[i] - wanted[j]) for j in sources)
    return total / len(sources) - 1.8 * (v[i] - v[0])


def initial(law: str, headway: float) -> Floats:
    """Positions (m) of all vehicles at the desired gaps."""
    spacing = LAWS[law][2] + LENGTH + headway * SPEED
    return np.linspace(0.0, -spacing * FOLLOWERS, FOLLOWERS + 1)


def integrated(law: str, lead: Lead, times: Floats) -> Floats:
    """Gaps (m) at `times` (s), one row a follower, by scipy."""
    count = FOLLOWERS + 1

    def change(t: float, state: Floats) -> Floats:
        x, v, a, u = (state[k * count : (k + 1) * count].copy() for k in range(4))
        v[0], a[0] = lead(t)
        u[0] = a[0]
        rates = np.zeros(count)
        for i in range(1, count):
            value = formula(law, [x.tolist(), v.tolist(), a.tolist(), u.tolist()], i)
            if law == "ploeg":
                rates[i] = value
            else:
                u[i] = value
        lagged = (u - a) / LAG
        speeds, lagged[0] = a.copy(), 0.0
        speeds[0] = 0.0
        return np.concatenate([v, speeds, lagged, rates])

    start = np.concatenate(
        [initial(law, LAWS[law][3]), np.full(count, SPEED), np.zeros(count), np.zeros(count)]
    )
    solved = solve_ivp(
        change, (0.0, times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-9, max_step=0.1
    )
    return -np.diff(solved.y[:count], axis=0) - LENGTH


def controllers(law: str, headway: float) -> list[LongitudinalController]:
    built, settings, standstill, _ = LAWS[law]
    policy = SpacingPolicy(standstill + LENGTH, headway)
    car = replace(LINCOLN_MKZ, drive_lag=LAG, length=LENGTH)
    return [
        built(
            LongitudinalSetup(
                policy,
                GapLimits(100.0, 100.0),
                LENGTH,
                STEP,
                parameters=car,
                lead="v0",
                predecessor=f"v{i - 1}",
                policies={
                    f"v{j}": SpacingPolicy((i - j) * policy.standstill, (i - j) * headway)
                    for j in {0, i - 1}
                },
            ),
            settings,
        )
        for i in range(1, FOLLOWERS + 1)
    ]


def driven(law: str, lead: Lead, headway: float | None = None) -> tuple[Floats, Floats, Floats]:
    """Instants (s), gaps (m) of followers and speeds (m/s) with the shipped controllers."""
    headway = LAWS[law][3] if headway is None else headway
    laws, count = controllers(law, headway), FOLLOWERS + 1
    x, v = initial(law, headway), np.full(count, SPEED)
    a, u = np.zeros(count), np.zeros(count)
    times, gaps, speeds = [], [], []
    for k in range(round(DURATION / STEP)):
        t = k * STEP
        v[0], a[0] = lead(t)
        u[0] = a[0]
        times.append(t)
        gaps.append(-np.diff(x) - LENGTH)
        speeds.append(v.copy())
        sources = [
            SourceState("fresh", 0.0, acceleration=u[j], speed=v[j], spacing=0.0)
            for j in range(count)
        ]
        commands = u.copy()
        for i in range(1, count):
            named = {f"v{j}": replace(sources[j], spacing=x[j] - x[i]) for j in {0, i - 1}}
            ahead = VehiclesAhead(
                spacing=x[i - 1] - x[i],
                predecessor_speed=v[i - 1],
                lead_speed=v[0],
                predecessor_acceleration=u[i - 1],
                lead_acceleration=u[0],
                own=OwnMotion(STEP, u[i], a[i]),
                sources=named,
            )
            commands[i] = laws[i - 1].acceleration(v[i], ahead)
        u = commands
        for i in range(1, count):
            after = achieved_acceleration(a[i], u[i], STEP, LAG)
            mean = u[i] + (a[i] - after) * LAG / STEP
            x[i] += v[i] * STEP + 0.5 * mean * STEP * STEP
            v[i] += mean * STEP
            a[i] = after
        following = lead(t + STEP)[0]
        x[0] += 0.5 * (v[0] + following) * STEP
    return np.array(times), np.array(gaps).T, np.array(speeds).T


@pytest.mark.parametrize("lead", [sinusoid, braking])
@pytest.mark.parametrize("law", LAWS)
def test_gaps_equal_an_independent_integration(law: str, lead: Lead) -> None:
    times, gaps, _ = driven(law, lead)
    exact = integrated(law, lead, times)
    moved = np.abs(exact - exact[:, :1]).max()
    assert moved > 0.01
    assert np.abs(gaps - exact).max() <= 0.01 * moved


@pytest.mark.parametrize(
    ("law", "headway", "stable"),
    [
        ("cacc", 0.0, True),
        ("ploeg", 0.5, True),
        ("acc", 1.5, True),  # above 2 τ = 1 s
        ("acc", 0.5, False),
    ],
)
def test_speed_variations_grow_along_the_string_only_without_string_stability(
    law: str, headway: float, stable: bool
) -> None:
    """Published for a drive lag of 0.5 s: Rajamani, chapters 6 and 7; Ploeg et al. 2014.

    The lead has no lag, so that the string is homogeneous from the first follower on.
    """
    times, _, speeds = driven(law, sinusoid, headway)
    settled = speeds[:, times > 10.0]
    sizes = settled.max(axis=1) - settled.min(axis=1)
    assert bool(np.all(sizes[2:] <= sizes[1:-1] * 1.001)) == stable


@pytest.mark.parametrize("fallback", [1.2, 2.0])
@pytest.mark.parametrize("law", [law for law in LAWS if law != "acc"])
def test_laws_with_radio_data_fall_back_to_acc(law: str, fallback: float) -> None:
    """With old data of the predecessor the command is that of ACC, also of a car that degrades."""
    built, settings, standstill, headway = LAWS[law]
    settings = replace(settings, fallback_headway=fallback)
    policy = SpacingPolicy(standstill + LENGTH, headway)
    setup = LongitudinalSetup(policy, GapLimits(), LENGTH, lead="v1", predecessor="v2")
    controller = built(setup, settings)
    ahead = VehiclesAhead(
        spacing=40.0,
        predecessor_speed=24.0,
        lead_speed=24.0,
        lead_acceleration=0.0,
        sources={"v2": SourceState("lost", 0.6, speed=24.0, spacing=40.0)},
        measured_gap=30.0,
        measured_gap_rate=-0.2,
    )
    wanted = -(0.2 + 0.1 * (standstill + fallback * 25.0 - 30.0)) / fallback
    assert controller.acceleration(25.0, ahead) == pytest.approx(wanted, abs=1e-12)
    guard = SpeedGuard(GapKeeping(setup, controller), DegradationSettings(), setup)
    own, situation = Pose(0.0, 0.0, 0.0, 25.0, 0.0), Situation(state="alone")
    commands = [guard.command(now, own, replace(ahead), situation) for now in (1, SECOND)]
    assert commands[-1].acceleration == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("law", ["cacc", "flatbed", "consensus"])
def test_old_data_of_the_lead_are_not_used(law: str) -> None:
    """A lead cut off alone drives on in its last pose; cars must not follow that."""
    built, settings, standstill, headway = LAWS[law]
    policy = SpacingPolicy(standstill + LENGTH, headway)
    names = {"v1": SpacingPolicy(2.0 * policy.standstill), "v2": policy}
    setup = LongitudinalSetup(
        policy, GapLimits(), LENGTH, lead="v1", predecessor="v2", policies=names
    )
    controller = built(setup, settings)
    commands = {
        (status, lead): controller.acceleration(
            20.0,
            VehiclesAhead(
                spacing=12.0,
                predecessor_speed=18.0,
                lead_speed=lead,
                predecessor_acceleration=-2.0,
                lead_acceleration=0.0,
                sources={
                    "v1": SourceState(status, 0.1, speed=lead, spacing=30.0),
                    "v2": SourceState("fresh", 0.1, acceleration=-2.0, speed=18.0, spacing=12.0),
                },
            ),
        )
        for status in STATUSES
        for lead in (18.0, 28.0)
    }
    assert commands["fresh", 28.0] > commands["fresh", 18.0] + 0.5
    assert commands["lost", 28.0] == commands["lost", 18.0]


def test_a_change_of_speed_while_the_gap_sensor_sees_nothing_is_no_braking() -> None:
    setup = LongitudinalSetup(SpacingPolicy(10.0 + LENGTH), GapLimits(), LENGTH)
    guard, commands = SpeedGuard(GapKeeping(setup), DegradationSettings(), setup), list[float]()
    for milliseconds, speed, gap in ((20, 25.0, 10.0), (40, 25.0, math.nan), (60, 22.0, 10.0)):
        ahead = VehiclesAhead(
            sources={"v2": SourceState()}, measured_gap=gap, measured_gap_rate=0.0 * gap
        )
        own, situation = Pose(0.0, 0.0, 0.0, speed, 0.0), Situation(state="follow")
        command = guard.command(milliseconds * SECOND // 1000, own, ahead, situation)
        commands.append(command.acceleration)
    assert (commands[0], commands[2]) == (0.0, 0.0)


@pytest.mark.parametrize("status", ["unused", "lost"])
def test_without_the_lead_a_car_follows_a_predecessor_that_accelerates(
    status: SourceStatus,
) -> None:
    setup = LongitudinalSetup(SpacingPolicy(10.0 + LENGTH), GapLimits(), LENGTH)
    guard, own = SpeedGuard(GapKeeping(setup), DegradationSettings(), setup), 10.0
    for tick in range(1000):
        speed = 10.0 + 0.02 * min(tick, 500)
        ahead = VehiclesAhead(20.0 + LENGTH, speed, sources={"v2": SourceState()})
        situation = Situation(SourceState(status), state="follow")
        pose, now = Pose(0.0, 0.0, 0.0, own, 0.0), (tick + 1) * SECOND // 50
        own += 0.02 * guard.command(now, pose, ahead, situation).acceleration
    assert 19.9 < own < 1.1 * 20.0 + 0.1
