"""Stability of the sampled steering loop, with hold and filter.

The theory of the paper is continuous. A vehicle decides at the control rate and holds the command.
Its yaw rate has the rate of the inertial sensor, its position and heading that of the receiver, and
a filter fuses them. On a straight at constant speed this is linear and periodic with a common
period of the three rates. So the loop is stable if and only if the eigenvalues of its map over that
period lie inside the unit circle.

Received messages are not part of the loop: they locate the path, not the car. Late or rare messages
may bend the path, but cannot make the loop unstable.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, gcd, inf, lcm, log, log2

import numpy as np

from vehicles.car.gnss_settings import GnssSettings
from vehicles.car.imu import DriftModel, ImuSettings, SlipModel
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import Array, open_loop, steering_input

FINENESS = 10  # Rates are rounded to 1/10 Hz, so that a common period of at most 10 s exists
SCALED_EVERY = 16  # Steps between scalings of the map, too few to multiply it by 1e200
MIN_NOISE = 1e-6  # Noise (m, rad) assumed for a receiver without noise
DOUBLINGS, TERMS = 24, 14  # 2^24 fixes; 0.5^14 / 14! is below the rounding error

CAR, COMMAND, PLACE, HEADING, SLIP, READING = slice(0, 6), 6, 7, 8, 9, 10
"""The state: z of `linear_model`, the command, and the filter's e_lat, theta~, v_y and last reading
of the yaw rate. The biases are assumed to be known and are not part of the loop.
"""
SIZE = 11


@dataclass(frozen=True, slots=True)
class SampledLoop:
    """Rates (Hz) and noises of a sampled loop (Section V-D); `imu_hz` None for exact own state.

    `parameters` are those of the car, `assumed` those of its estimator.
    """

    parameters: VehicleParameters
    assumed: VehicleParameters
    gains: Gains
    control_hz: float = 50.0
    imu_hz: float | None = 50.0
    gnss_hz: float = 20.0
    gnss: GnssSettings = GnssSettings()  # noqa: RUF009 - frozen
    imu: ImuSettings = ImuSettings()  # noqa: RUF009 - frozen


def sampled_decay(loop: SampledLoop, speed: float) -> float:
    """Decay rate (1/s) of errors at `speed` (m/s), eqs. (3), (4), (7); not positive: unstable.

    From the spectral radius of the map over the common period.
    """
    steps = _Steps(loop, speed)
    total, scale = np.eye(SIZE), 0.0
    for number, step in enumerate(steps.over_a_period()):
        total = step @ total
        if number % SCALED_EVERY == 0:
            size = float(np.max(np.abs(total)))
            total, scale = total / size, scale + log(size)
    if loop.imu_hz is None:
        total = total[:PLACE, :PLACE]  # there is no filter
    radius = float(np.max(np.abs(np.linalg.eigvals(total))))
    return -(log(radius) + scale) / steps.period if radius > 0.0 else inf


def lowest_stable_rate(
    loop_at: Callable[[float], SampledLoop], speed: float, highest: int
) -> int | None:
    """Lowest whole rate (Hz) such that `loop_at(rate)` is stable from there up to `highest`.

    Stability of the sampled loop of Section III-E. The search goes downwards, since below an
    unstable rate there may be stable ones, where all readings happen to precede a decision. None if
    the loop is not stable at `highest`.
    """
    rates = range(highest, 0, -1)
    lowest = next((rate for rate in rates if sampled_decay(loop_at(rate), speed) <= 0.0), 0) + 1
    return lowest if lowest <= highest else None


@lru_cache(maxsize=4096)
def stationary_gains(  # noqa: PLR0917 - all that they depend on
    assumed: VehicleParameters,
    imu_hz: float,
    gnss_hz: float,
    fix_noise: tuple[float, float],
    imu: ImuSettings,
    speed: float,
) -> Array:
    """Stationary gains of the Kalman filter on a straight, with known biases; shape (2, 2).

    Rows are position (m) and heading (rad), columns are the innovations of both, as is
    `fix_noise`, their standard deviations. Between two fixes
    errors are random walks with the densities of `DriftModel`. Riccati's equation
    P = F (P - P (P + R)^-1 P) F' + Q is solved by doubling, equivalent to 2^k fixes.
    """
    drift = DriftModel(SlipModel(assumed), imu, imu_hz)
    span = 1.0 / gnss_hz
    distance = speed * span
    across = drift.across(speed, 0.0) + distance**2 * drift.heading / 3.0
    mixed = 0.5 * distance * drift.heading
    predicted = span * np.array([[across, mixed], [mixed, drift.heading]])
    noise = np.diag([max(deviation, MIN_NOISE) ** 2 for deviation in fix_noise])
    step, known = np.array([[1.0, 0.0], [distance, 1.0]]), np.linalg.inv(noise)
    for _ in range(DOUBLINGS):
        shared = np.linalg.inv(np.eye(2) + known @ predicted)
        known = known + step @ shared @ known @ step.T
        predicted = predicted + step.T @ predicted @ shared @ step
        step = step @ shared @ step
    return np.asarray(predicted @ np.linalg.inv(predicted + noise), dtype=np.float64)


def _exponential(matrix: Array) -> Array:
    """Matrix exponential by scaling and squaring, with Taylor's series."""
    halvings = max(ceil(log2(max(float(np.abs(matrix).sum(axis=1).max()), 1e-9))) + 1, 0)
    part, term = np.eye(len(matrix)), np.eye(len(matrix))
    for k in range(1, TERMS):
        term = term @ matrix / (k * 2.0**halvings)
        part = part + term
    return np.asarray(np.linalg.matrix_power(part, 2**halvings))


class _Steps:
    """The linear maps of one loop at one speed over a common period (s)."""

    def __init__(self, loop: SampledLoop, speed: float) -> None:
        self._loop, self._speed = loop, speed
        rates = [loop.control_hz]
        if loop.imu_hz is not None:
            rates += [loop.imu_hz, loop.gnss_hz]
        whole = [max(round(rate * FINENESS), 1) for rate in rates]
        common = gcd(*whole)
        self.period = FINENESS / common
        # Instants are integers, in a share of the period that all rates have in common.
        self._end = lcm(*(rate // common for rate in whole))
        self._every = [self._end * common // rate for rate in whole]
        self._tick = self.period / self._end
        self._slip = SlipModel(loop.assumed)
        constant, inverse_speed = open_loop(loop.parameters)
        self._motion = np.zeros((7, 7))
        self._motion[CAR, CAR] = constant + inverse_speed / speed
        self._motion[CAR, COMMAND] = steering_input(loop.parameters)

    def over_a_period(self) -> Iterator[Array]:
        """Yield the maps of the events and of the time between them, in order."""
        end, has_filter = self._end, len(self._every) > 1
        instants = sorted({at for every in self._every for at in range(0, end, every)})
        # The period is preceded by the last reading or fix of the previous one.
        estimated_at = -min(self._every[1:], default=end)
        # Few different spans occur in a period.
        flow, decision = cache(self._flow), cache(self._decision)
        dead_reckoning = cache(self._dead_reckoning)
        correction = self._correction() if has_filter else np.eye(SIZE)
        for now, after in zip(instants, [*instants[1:], end], strict=True):
            decides, *measures = (now % every == 0 for every in self._every)
            if any(measures):
                yield dead_reckoning(now - estimated_at, measures[0])
                estimated_at = now
                if measures[1]:
                    yield correction
            if decides:
                yield decision(now - estimated_at)
            yield flow(after - now)

    def _flow(self, ticks: int) -> Array:
        flow = np.eye(SIZE)
        flow[:7, :7] = _exponential(self._motion * (ticks * self._tick))
        return flow

    def _dead_reckoning(self, ticks: int, read: bool) -> Array:
        """Dead reckoning over a span, up to a new reading or with the last one."""
        span, now = ticks * self._tick, 3 if read else READING
        step = np.eye(SIZE)
        if read:
            step[READING] = 0.0
            step[READING, 3] = 1.0
        if ticks <= 0:
            return step
        slip, speed = self._slip, self._speed
        turn, after = np.zeros((2, SIZE))
        turn[READING] += 0.5
        turn[now] += 0.5
        after[SLIP] = slip.after(span, speed, 0.0, 0.0, 1.0)
        after[READING] += slip.after(span, speed, 1.0, 0.0, 0.0)
        after[now] += slip.after(span, speed, 0.0, 1.0, 0.0)
        step[SLIP] = after
        step[HEADING] += span * turn
        step[PLACE] += 0.5 * speed * span * span * turn + 0.5 * span * after
        step[PLACE, HEADING] += speed * span
        step[PLACE, SLIP] += 0.5 * span
        return step

    def _correction(self) -> Array:
        loop, step = self._loop, np.eye(SIZE)
        noise = loop.gnss.position_noise, loop.gnss.heading_noise
        gains = stationary_gains(
            loop.assumed, loop.imu_hz or inf, loop.gnss_hz, noise, loop.imu, self._speed
        )
        for row, gain in zip((PLACE, HEADING), gains, strict=True):
            step[row, [PLACE, HEADING]] -= gain
            step[row, :2] += gain
        return step

    def _decision(self, ticks: int) -> Array:
        step, row, gains = np.eye(SIZE), np.zeros(SIZE), self._loop.gains
        if self._loop.imu_hz is None:
            row[[0, 1, 3]] = gains
        else:
            row[[PLACE, HEADING, READING]] = gains
            row = row @ self._dead_reckoning(ticks, read=False)
        step[COMMAND] = -row
        return step
