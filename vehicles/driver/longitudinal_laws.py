"""Shipped longitudinal laws; SI units."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final

from vehicles.driver.controller import (
    RELIED_ON,
    GapLimits,
    LongitudinalSetup,
    SourceState,
    SpacingPolicy,
    VehiclesAhead,
)
from vehicles.setting import Setting

GAP_STIFFNESS: Final = 3.0  # k_p, acceleration per metre of spacing error (1/s²)
DAMPING: Final = 4.0  # k_v + k_l, acceleration per difference of speed (1/s)
LEAD_SHARE: Final = 0.5  # Of k_l in the damping, and of the lead in the CACC feedforward
LEAD_PULL_DISTANCE: Final = 0.5  # Limit (m) of the spacing error due to a faster lead
STABLE_HEADWAY: Final = 0.35  # From this headway (s) on the lead's speed is neither needed nor used
CATCH_UP_DISTANCE: Final = 5.0  # Limit (m) of the spacing error


def gap_acceleration(
    ahead: VehiclesAhead, own_speed: float, policy: SpacingPolicy, limits: GapLimits
) -> float:
    """Acceleration (m/s²) within `limits` that keeps the gap at `own_speed` (m/s).

    a = k_p (spacing - desired) + k_v (v_pred - v) + k_l (v_lead - v) + feedforward, the CACC law of
    PATH (Rajamani, Vehicle Dynamics and Control, eq. 7.39). At constant distance the feedforward is
    the mean of both accelerations, which all vehicles then share; without it, spacings would be
    b / k_p too short while all brake at b: 2 m for 6 m/s².

    At constant distance the transfer of errors from one vehicle to the next,
    (s²/2 + k_v s + k_p) / (s² + (k_v + k_l) s + k_p), never exceeds 1 if
    (k_v + k_l)² - k_v² >= k_p: here 12 >= 3, with a margin for radio delay. Without the lead's
    speed (k_l = 0) there would be none (Swaroop and Hedrick, 1996).

    With a headway h the predecessor alone suffices if k_p h² + 2 k_v h >= 2 (h >= 0.23 s here)
    without feedforward. The lead's speed would even do harm: in steady braking the i-th vehicle is
    i h a faster than the lead, so errors would grow with i. Its share therefore fades out towards
    STABLE_HEADWAY. The feedforward fades out as 1 - (k_v + k_l) h, which leaves no spacing error in
    steady braking; from 0.25 s on the speed difference is enough.

    The wider gap behind a predecessor that brakes as hard as the car can is not closed: the car
    could no longer lose the speed for it. From half of the limit on, it is closed less.

    Motion of the lead that is NaN (nothing received) is replaced by the predecessor's. A lead that
    drives on while the predecessor brakes on its own, for example without data, moves the car at
    most `LEAD_PULL_DISTANCE` closer.
    """
    speed, acceleration = ahead.predecessor_speed, ahead.predecessor_acceleration
    feedforward = max(0.0, 1.0 - DAMPING * policy.headway)
    pull = 0.0
    if not math.isnan(ahead.lead_speed):
        share = LEAD_SHARE * max(0.0, 1.0 - policy.headway / STABLE_HEADWAY)
        pull = DAMPING * share * (ahead.lead_speed - speed)
    if not math.isnan(ahead.lead_acceleration):
        pull += feedforward * LEAD_SHARE * (ahead.lead_acceleration - acceleration)
    error = min(ahead.spacing - policy.desired(own_speed), CATCH_UP_DISTANCE)
    if error > 0.0 and 0.0 < limits.deceleration < -2.0 * acceleration:
        left = max(2.0 * (1.0 + acceleration / limits.deceleration), 0.0)
        error = min(error, CATCH_UP_DISTANCE * left)
    wanted = GAP_STIFFNESS * error + DAMPING * (speed - own_speed) + feedforward * acceleration
    wanted += min(pull, GAP_STIFFNESS * LEAD_PULL_DISTANCE)
    return min(max(wanted, -limits.deceleration), limits.acceleration)


# ---- Controllers
#
# Symbols of the formulas: gap g to the predecessor, from bumper to bumper; own speed v and
# acceleration a; speeds v_p, v_l and announced accelerations a_p, a_l of predecessor and lead,
# predicted to now; standstill gap d and time headway h of [speed.gap]. Default parameters are those
# of Plexe.
#
# Laws that need radio data fall back to ACC while the predecessor is not relied on, at a headway
# that is stable without radio. ACC uses the gap of the on-board sensor, else the received one.


class GapLaw:
    """The CACC law of PATH, which keeps a constant distance or time gap (Rajamani, eq. 7.39)."""

    needs_predecessor: ClassVar[bool] = True

    def __init__(self, setup: LongitudinalSetup) -> None:
        self._setup = setup

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        return gap_acceleration(ahead, speed, self._setup.policy, self._setup.limits)


@dataclass(frozen=True)
class AccSettings:
    """Parameters of ACC."""

    gap_gain: Annotated[float, Setting("λ, gain of the gap error", "per_s", above=0)] = 0.1


class Acc:
    """Adaptive cruise control (Rajamani, eq. 6.18): no radio data of other vehicles but the gap.

    u = -((v - v_p) + λ (d + h v - g)) / h. With a drive of lag τ it is string stable for h > 2 τ.
    """

    needs_predecessor: ClassVar[bool] = True
    needs_poses: ClassVar[bool] = False
    needs_headway: ClassVar[bool] = True

    def __init__(self, setup: LongitudinalSetup, settings: AccSettings) -> None:
        self._setup, self._gain = setup, settings.gap_gain

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        return acc_acceleration(self._setup, speed, ahead, self._setup.policy.headway, self._gain)


@dataclass(frozen=True)
class Fallback:
    """Parameters of the fallback to ACC, which all laws with radio data have."""

    fallback_headway: Annotated[float, Setting("least headway of that ACC", "s", above=0)] = 1.2


class _RadioLaw:
    """A law with radio data of the predecessor, and ACC without them."""

    needs_predecessor: ClassVar[bool] = True
    needs_poses: ClassVar[bool] = False

    def __init__(self, setup: LongitudinalSetup, settings: Fallback) -> None:
        self._setup = setup
        self.fallback_headway = max(setup.policy.headway, settings.fallback_headway)

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        if self._has_data(ahead):
            return self._cooperative(speed, ahead)
        return acc_acceleration(self._setup, speed, ahead, self.fallback_headway)

    def _has_data(self, ahead: VehiclesAhead) -> bool:
        return self._is_recent(ahead.sources.get(self._setup.predecessor))

    def _is_recent(self, source: SourceState | None) -> bool:
        return source is not None and source.status in RELIED_ON

    def _lead_speed(self, ahead: VehiclesAhead) -> float:
        """Speed (m/s) of the lead, NaN without recent data of it."""
        recent = self._is_recent(ahead.sources.get(self._setup.lead))
        return ahead.lead_speed if recent else math.nan

    def _cooperative(self, speed: float, ahead: VehiclesAhead) -> float:
        raise NotImplementedError

    def _gap_error(self, speed: float, ahead: VehiclesAhead) -> float:
        """Gap error (m), positive if the gap is too wide: g - d - h v."""
        return ahead.spacing - self._setup.policy.desired(speed)


@dataclass(frozen=True)
class CaccSettings(Fallback):
    """Parameters of CACC."""

    lead_share: Annotated[float, Setting("c1, weight of the lead", "ratio", 0, maximum=1)] = 0.5
    damping: Annotated[float, Setting("ξ, damping ratio", "ratio", 1, maximum=10)] = 1.0
    bandwidth: Annotated[float, Setting("ω, bandwidth", "radps", above=0)] = 0.2


class Cacc(_RadioLaw):
    """Cooperative adaptive cruise control of PATH at a constant gap (Rajamani, eq. 7.39).

    u = (1 - c1) a_p + c1 a_l + α3 (v - v_p) + α4 (v - v_l) - ω² (d + h v - g),
    α3 = -(2 ξ - c1 (ξ + sqrt(ξ² - 1))) ω, α4 = -(ξ + sqrt(ξ² - 1)) ω c1. Without recent data
    of the lead c1 is 0. Its law has h = 0: set `speed.gap.headway_s` to 0.
    """

    def __init__(self, setup: LongitudinalSetup, settings: CaccSettings) -> None:
        super().__init__(setup, settings)
        self._settings = settings
        self._root = settings.damping + math.sqrt(settings.damping**2 - 1.0)

    def _cooperative(self, speed: float, ahead: VehiclesAhead) -> float:
        settings = self._settings
        share, lead_acceleration = settings.lead_share, ahead.lead_acceleration
        lead_speed = self._lead_speed(ahead)
        if math.isnan(lead_speed) or math.isnan(lead_acceleration):
            share = lead_speed = lead_acceleration = 0.0
        omega = settings.bandwidth
        to_predecessor = (2.0 * settings.damping - share * self._root) * omega
        to_lead = self._root * omega * share
        return (
            (1.0 - share) * ahead.predecessor_acceleration
            + share * lead_acceleration
            - to_predecessor * (speed - ahead.predecessor_speed)
            - to_lead * (speed - lead_speed)
            + omega * omega * self._gap_error(speed, ahead)
        )


@dataclass(frozen=True)
class PloegSettings(Fallback):
    """Parameters of Ploeg's law."""

    gap_gain: Annotated[float, Setting("k_p", "per_s2", above=0)] = 0.2
    rate_gain: Annotated[float, Setting("k_d", "per_s", above=0)] = 0.7


class Ploeg(_RadioLaw):
    """Ploeg's law at a time gap, from the predecessor alone (Ploeg et al., 2011 and 2014).

    du/dt = (-u + k_p (g - d - h v) + k_d (v_p - v - h a) + a_p) / h, integrated over each control
    period from the last command.
    """

    needs_headway: ClassVar[bool] = True

    def __init__(self, setup: LongitudinalSetup, settings: PloegSettings) -> None:
        super().__init__(setup, settings)
        self._settings = settings

    def _cooperative(self, speed: float, ahead: VehiclesAhead) -> float:
        settings, headway, own = self._settings, self._setup.policy.headway, ahead.own
        error = self._gap_error(speed, ahead)
        rate = ahead.predecessor_speed - speed - headway * own.achieved
        target = (
            settings.gap_gain * error + settings.rate_gain * rate + ahead.predecessor_acceleration
        )
        left = math.exp(-own.step / headway)
        return left * own.acceleration + (1.0 - left) * target


@dataclass(frozen=True)
class FlatbedSettings(Fallback):
    """Parameters of the flatbed law."""

    acceleration_gain: Annotated[float, Setting("k_a", "ratio", 0)] = 2.4
    speed_gain: Annotated[float, Setting("k_v", "per_s", above=0)] = 0.6
    gap_gain: Annotated[float, Setting("k_p", "per_s2", above=0)] = 12.0
    lead_headway: Annotated[
        float, Setting("h_l, headway by the speed above the lead's", "s", 0)
    ] = 4.0


class Flatbed(_RadioLaw):
    """Cars as on a flatbed truck: headway by the speed relative to the lead (Ali et al., 2015).

    u = -k_a a + k_v (v_p - v) + k_p (g - d - h v - h_l (v - v_l)). Without data of the lead, v_l is
    the predecessor's speed.
    """

    def __init__(self, setup: LongitudinalSetup, settings: FlatbedSettings) -> None:
        super().__init__(setup, settings)
        self._settings = settings

    def _cooperative(self, speed: float, ahead: VehiclesAhead) -> float:
        settings = self._settings
        lead_speed = self._lead_speed(ahead)
        if math.isnan(lead_speed):
            lead_speed = ahead.predecessor_speed
        error = self._gap_error(speed, ahead)
        wanted = settings.speed_gain * (ahead.predecessor_speed - speed) + settings.gap_gain * (
            error - settings.lead_headway * (speed - lead_speed)
        )
        return self._solved(wanted, ahead)

    def _solved(self, wanted: float, ahead: VehiclesAhead) -> float:
        """Solve u = wanted - k_a a for u, with the a at the end of the control period.

        Without a drive lag, a = u; with one, a approaches u with that time constant. Taken at the
        start of the period, a k_a above 1 would make commands alternate.
        """
        gain, lag = self._settings.acceleration_gain, self._setup.parameters.drive_lag
        left = math.exp(-self._setup.period / lag) if lag > 0.0 else 0.0
        return (wanted - gain * left * ahead.own.achieved) / (1.0 + gain * (1.0 - left))


@dataclass(frozen=True)
class ConsensusSettings(Fallback):
    """Parameters of the consensus law."""

    first_gain: Annotated[
        float, Setting("k of the lead, of its first follower", "per_s2", above=0)
    ] = 0.46
    lead_gain: Annotated[float, Setting("k of the lead, of others", "per_s2", 0)] = 0.08
    predecessor_gain: Annotated[float, Setting("k of the predecessor", "per_s2", 0)] = 0.86
    other_gain: Annotated[float, Setting("k of each other source", "per_s2", 0)] = 0.86
    speed_gain: Annotated[float, Setting("b", "per_s", above=0)] = 1.8


class Consensus(_RadioLaw):
    """Consensus over all longitudinal sources (Santini et al., 2017), along the path.

    u = -b (v - v_0) + 1/n Σ_j k_j (s_j - S_j), with the speed v_0 of the lead, the spacing s_j to
    each of n sources, predicted to now at v_0, and its desired value S_j at v_0. The weights are
    those of Plexe for a mass of 1000 kg, which has lead and predecessor as sources: 80 and 860, and
    460 for the first follower, whose predecessor is the lead. Other sources have the predecessor's.

    Sources may be anywhere: spacings to vehicles behind are negative. Without the lead, v_0 is the
    mean speed of the sources (Ren and Atkins, 2007). The errors of a convoy then obey
    e'' + b e' + L e = 0 with the lead, where L has the sum of k_j/n of each vehicle on its diagonal
    and -k_j/n for its sources; they decay if the lead reaches every vehicle, L has real
    eigenvalues and b is as large as here. A source that is not received counts in n, without a
    share in the sum. It falls back to ACC while the predecessor is not relied on, or no source if
    the predecessor is none of them; without any gap to the predecessor, ACC keeps the speed.
    """

    needs_predecessor: ClassVar[bool] = False

    def __init__(self, setup: LongitudinalSetup, settings: ConsensusSettings) -> None:
        super().__init__(setup, settings)
        self._settings = settings
        self._needs_predecessor = not setup.policies or setup.predecessor in setup.policies
        gains = {setup.lead: settings.lead_gain, setup.predecessor: settings.predecessor_gain}
        if setup.lead == setup.predecessor:
            gains = {setup.lead: settings.first_gain}
        self._gains = {name: gains.get(name, settings.other_gain) for name in setup.policies}

    def _has_data(self, ahead: VehiclesAhead) -> bool:
        if self._needs_predecessor:
            return super()._has_data(ahead)
        return any(self._is_recent(source) for source in ahead.sources.values())

    def _cooperative(self, speed: float, ahead: VehiclesAhead) -> float:
        settings, policies = self._settings, self._setup.policies
        sources = {
            name: source
            for name, source in ahead.sources.items()
            if self._is_recent(source) and name in policies
        }
        common = self._lead_speed(ahead)
        if math.isnan(common):
            speeds = [source.speed for source in sources.values()]
            common = sum(speeds) / len(speeds) if speeds else ahead.predecessor_speed
        total = 0.0
        for name, source in sources.items():
            spacing = source.spacing + source.age * common
            total += self._gains[name] * (spacing - policies[name].desired(common))
        return total / max(len(policies), 1) - settings.speed_gain * (speed - common)


def acc_acceleration(
    setup: LongitudinalSetup,
    speed: float,
    ahead: VehiclesAhead,
    headway: float,
    gain: float = AccSettings.gap_gain,
) -> float:
    """Acceleration (m/s²) of ACC at `headway` (s) with the gain λ (1/s): Rajamani, eq. 6.18.

    The gap is the sensor's, or the received one, which the caller has predicted to now.
    """
    gap, rate = ahead.measured_gap, ahead.measured_gap_rate
    if math.isnan(gap):
        gap, rate = ahead.spacing - setup.least_spacing, ahead.predecessor_speed - speed
    if math.isnan(gap):  # neither a sensor nor poses of the predecessor
        return 0.0
    standstill = setup.policy.standstill - setup.least_spacing
    return (rate + gain * (gap - standstill - headway * speed)) / headway
