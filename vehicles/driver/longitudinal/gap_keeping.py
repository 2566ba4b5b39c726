"""The law that keeps a constant distance or time gap; SI units."""

import math
from typing import Final

from vehicles.driver.longitudinal.controller import VehiclesAhead
from vehicles.driver.longitudinal.spacing import GapLimits, SpacingPolicy

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
