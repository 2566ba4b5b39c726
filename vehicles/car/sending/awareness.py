"""Sending as cooperative awareness messages, CAM (ETSI EN 302 637-2, Section 6.1.3)."""

from dataclasses import dataclass
from math import degrees, hypot
from typing import Annotated

from vehicles.car.gnss import Fix
from vehicles.car.sending.rule import PhasedRule, SendingContext, SendingTrigger
from vehicles.car.sending.sender import BEFORE_EVERY_RUN, ROUNDING
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import MILLISECOND, SECOND, Cadence
from vehicles.setting import Setting

HEADING, POSITION, SPEED = 4.0, 4.0, 0.5  # Changes (deg, m, m/s) that trigger (EN 302 637-2)
MIN_INTERVAL, MAX_INTERVAL = 100 * MILLISECOND, 1000 * MILLISECOND  # ns (EN 302 637-2)
REPEATS = 3  # Number of messages with the interval of the last change (EN 302 637-2)


@dataclass(frozen=True, slots=True, kw_only=True)
class AwarenessMessages(PhasedRule):
    """As cooperative awareness messages (ETSI EN 302 637-2, 6.1.3): after 4 m, 4 deg or 0.5 m/s.

    The interval is 0.1 to 1 s. Each check uses the newest fix.
    """

    check_period: Annotated[int, Setting("period of the checks", "ms", 1, 100)] = 100 * MILLISECOND

    @property
    def schedule_rate(self) -> float:
        return SECOND / self.check_period

    def begin(self, context: SendingContext) -> SendingTrigger:
        return CamTrigger(self.cadence(context))

    def max_rate(self, fixes: float) -> float:
        return min(SECOND / MIN_INTERVAL, fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:
        return 1.0 / cam_interval(speed, self.check_period / SECOND)

    def describe(self) -> str:
        period = f"{self.check_period / MILLISECOND:g} ms"
        return f"CAM, checked every {period}, {self.describe_phase()}"


class CamTrigger:
    """The rule of EN 302 637-2, Section 6.1.3, applied to the newest fix at each check.

    A message is due if heading, position or speed have changed enough since the last one, or else
    after the interval of the last such change. After three messages without a change the interval
    is 1 s. `checks` are at most 100 ms apart.
    """

    def __init__(self, checks: Cadence) -> None:
        self._checks = checks
        self._last: Fix | None = None
        self._sent_at = BEFORE_EVERY_RUN
        self._interval = MAX_INTERVAL
        self._repeats = 0
        self._changed = False

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        if unsent is None or now < allowed_from or not self._checks.due(now):
            return False
        elapsed = now - self._sent_at + ROUNDING
        self._changed = self._last is not None and _has_changed(self._last, unsent)
        return elapsed >= (MIN_INTERVAL if self._changed else self._interval)

    def sent(self, now: int, fix: Fix) -> None:
        if self._changed:
            self._interval, self._repeats = min(now - self._sent_at, MAX_INTERVAL), 0
        elif self._last is not None:
            self._repeats += 1
            if self._repeats >= REPEATS:
                self._interval = MAX_INTERVAL
        self._last, self._sent_at = fix, now


def _has_changed(last: Fix, now: Fix) -> bool:
    return (
        abs(degrees(wrap_angle(now.yaw - last.yaw))) > HEADING
        or hypot(now.east - last.east, now.north - last.north) > POSITION
        or abs(now.speed - last.speed) > SPEED
    )


def cam_interval(speed: float, check: float) -> float:
    """Interval (s) of messages by EN 302 637-2 at a constant speed (m/s) on a straight.

    That is the first check, of a period of `check` (s), after more than 4 m; 0.1 to 1 s.
    """
    if speed * MAX_INTERVAL / SECOND <= POSITION:
        return MAX_INTERVAL / SECOND
    checks = least = 1
    while checks * check * speed <= POSITION + 1e-9:
        checks += 1
    while least * check < MIN_INTERVAL / SECOND - 1e-9:
        least += 1
    return min(max(checks, least) * check, MAX_INTERVAL / SECOND)
