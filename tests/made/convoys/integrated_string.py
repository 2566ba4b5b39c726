"""A string of cars with the longitudinal laws of Plexe, integrated by scipy.

A second implementation of the sampled laws with their delays, from the published formulas only.
Cars drive on a straight with exact sensors. Each decides at 50 Hz and holds its command; its drive
is of first order (LAG). It sends its state and its command at 10 Hz; they arrive after LATENCY and
are predicted to the present: its drive approaches that command for up to LASTS, or to a standstill
if it brakes harder than HARD. The gap sensor of ACC measures at instants of control, with a rate
and a latency of its own, and is predicted by the measured rate.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

Floats = NDArray[np.float64]
LAG, SPEED = 0.5, 27.778
CONTROL, BEACON, LATENCY = 0.02, 0.1, 0.02
SENSOR, SENSOR_LATENCY = 0.05, 0.05
FALLBACK_AFTER, FALLBACK_HEADWAY = 0.5, 1.2
LASTS, HARD = 0.5, 2.5
FADES_FROM, FADES_TO = 0.3, 0.8
"""Age (s) of a command between which its share as a feedforward falls from 1 to 0."""
HARDEST, STRONGEST = 9.0, 2.5
"""Largest braking and acceleration (m/s²) of followers."""
CORRECTION, CORRECTION_MAX = 0.5, 2.0
"""Speed control of the lead: acceleration per speed error (1/s), and its limit (m/s²)."""
GAPS = {
    "acc": (2.0, 1.2),
    "cacc": (5.0, 0.0),
    "ploeg": (2.0, 0.5),
    "flatbed": (5.0, 0.0),
    "consensus": (15.0, 0.8),
}
"""Standstill gap (m) and headway (s) of each law in Plexe's examples."""


@cache
def _transition(span: float) -> Floats:
    """Transition of position, speed, acceleration and a held command over `span` (s)."""
    drive = [
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, -1.0 / LAG, 1.0 / LAG],
        [0.0] * 4,
    ]
    transition: Floats = expm(span * np.array(drive))
    return transition


@dataclass
class _Received:
    """Position, speed, achieved acceleration and command of one car at an instant (s)."""

    at: float
    place: float
    speed: float
    achieved: float
    command: float

    def predicted(self, now: float) -> tuple[float, float, float]:
        """Position (m), speed (m/s) and feedforward (m/s²) at `now`; a braking car stops."""
        age, command = round(now - self.at, 9), self.command
        span = age if command < -HARD else min(age, LASTS)
        state = np.array([self.place, self.speed, self.achieved, command])
        place, speed, _, _ = _transition(span) @ state
        if speed <= 0.0:
            braking = -min(self.achieved, command)
            return self.place + 0.5 * self.speed**2 / max(braking, 0.05), 0.0, 0.0
        if command >= -HARD:
            command *= np.interp(age, [FADES_FROM, FADES_TO], [1.0, 0.0])
        return float(place + speed * (age - span)), float(speed), float(command)


@dataclass
class String:
    """Cars of length `length` (m) from the lead back, the lead along `speed_at` (m/s over s).

    `gap` replaces standstill gap (m) and headway (s) of the law. Messages sent within `cut` (s) are
    lost; then a follower falls back to ACC.
    """

    law: str
    followers: int
    length: float
    speed_at: Callable[[float], float]
    gap: tuple[float, float] | None = None
    cut: tuple[float, float] = (math.inf, math.inf)
    sent: list[list[_Received]] = field(default_factory=list)
    sensed: list[list[tuple[float, float, float]]] = field(default_factory=list)
    _measured: int = 0

    def gaps(self, until: float) -> tuple[Floats, Floats]:
        """Instants (s) of control, and gaps (m) of each follower at them."""
        count = self.followers + 1
        standstill, headway = self.gap or GAPS[self.law]
        spacing = standstill + headway * SPEED + self.length
        x, v, a, u = (np.zeros(count) for _ in range(4))
        x -= spacing * np.arange(count)
        v += SPEED
        self.sent = [[] for _ in range(count)]
        self.sensed = [[] for _ in range(count)]
        instants, gaps = [], []
        for k in range(round(until / CONTROL)):
            now = k * CONTROL
            instants.append(now)
            gaps.append(-np.diff(x) - self.length)
            u = np.array([self._command(i, now, x, v, a, u) for i in range(count)])
            if now >= SENSOR * self._measured - 1e-9:
                self._measured += 1
                for i in range(1, count):
                    self.sensed[i].append((now, gaps[-1][i - 1], v[i - 1] - v[i]))
            if k % round(BEACON / CONTROL) == 0:
                for i in range(count):
                    self.sent[i].append(_Received(now, x[i], v[i], a[i], u[i]))
            x, v, a = self._moved(now, x, v, a, u)
        return np.array(instants), np.array(gaps).T

    def _moved(
        self, now: float, x: Floats, v: Floats, a: Floats, u: Floats
    ) -> tuple[Floats, Floats, Floats]:
        count = len(x)

        def change(_: float, state: Floats) -> Floats:
            speeds, accelerations = state[count : 2 * count], state[2 * count :]
            moving = (speeds > 0.0) | (accelerations > 0.0)
            return np.concatenate(
                [
                    np.maximum(speeds, 0.0),
                    np.where(moving, accelerations, 0.0),
                    (u - accelerations) / LAG,
                ]
            )

        start = np.concatenate([x, v, np.where(v > 0.0, a, 0.0)])
        done = solve_ivp(change, (now, now + CONTROL), start, rtol=1e-7, atol=1e-8)
        end = done.y[:, -1]
        return end[:count], np.maximum(end[count : 2 * count], 0.0), end[2 * count :]

    def _newest(self, sender: int, now: float) -> _Received | None:
        for one in reversed(self.sent[sender]):
            if one.at + LATENCY <= now + 1e-9 and not self.cut[0] <= one.at < self.cut[1]:
                return one
        return None

    def _command(  # noqa: PLR0917 - the state
        self, i: int, now: float, x: Floats, v: Floats, a: Floats, u: Floats
    ) -> float:
        if i == 0:
            planned, following = self.speed_at(now), self.speed_at(now + CONTROL)
            correction = CORRECTION * (planned - v[0])
            correction = min(max(correction, -CORRECTION_MAX), CORRECTION_MAX)
            return float((following - planned) / CONTROL + correction)
        ahead, lead = self._newest(i - 1, now), self._newest(0, now)
        if ahead is None or lead is None:
            return 0.0
        d, h = self.gap or GAPS[self.law]
        place, speed, command = ahead.predicted(now)
        _, lead_speed, lead_command = lead.predicted(now)
        gap = place - x[i] - self.length
        own = float(v[i])
        is_lost = now - ahead.at > FALLBACK_AFTER + 1e-9
        if self.law == "acc" or is_lost:
            h = max(h, FALLBACK_HEADWAY) if is_lost else h
            rate = speed - own
            usable = [one for one in self.sensed[i] if one[0] + SENSOR_LATENCY <= now + 1e-9]
            if usable:
                at, gap, rate = usable[-1]
                gap += rate * (now - at)
            wanted = (rate + 0.1 * (gap - d - h * own)) / h
        elif self.law == "cacc":
            wanted = (
                0.5 * command
                + 0.5 * lead_command
                - 0.3 * (own - speed)
                - 0.1 * (own - lead_speed)
                - 0.04 * (d - gap)
            )
        elif self.law == "ploeg":
            target = 0.2 * (gap - d - h * own) + 0.7 * (speed - own - h * a[i]) + command
            left = math.exp(-CONTROL / h)
            wanted = left * u[i] + (1.0 - left) * target
        elif self.law == "flatbed":
            aim = 0.6 * (speed - own) + 12.0 * (gap - d - 4.0 * (own - lead_speed))
            left = math.exp(-CONTROL / LAG)  # a at the end of the period, under u
            wanted = (aim - 2.4 * left * a[i]) / (1.0 + 2.4 * (1.0 - left))
        else:
            sources = {0: (0.08, lead), i - 1: (0.86, ahead)} if i > 1 else {0: (0.46, lead)}
            errors = [
                weight
                * (
                    one.place
                    + (now - one.at) * lead_speed
                    - x[i]
                    - (i - j) * (d + self.length + h * lead_speed)
                )
                for j, (weight, one) in sources.items()
            ]
            wanted = sum(errors) / len(errors) - 1.8 * (own - lead_speed)
        return float(min(max(wanted, -HARDEST), STRONGEST))
