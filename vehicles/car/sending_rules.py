"""Sending rules by the `kind` of the table `[sending]`. Register new rules in RULES."""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate, pairwise
from math import ceil, degrees, floor, hypot, inf, remainder, tau
from typing import Annotated, Final, Literal, Protocol

from numpy.random import Generator

from vehicles.car.gnss import Fix
from vehicles.car.gnss_error_terms import NO_END
from vehicles.car.path_history import PathHistory
from vehicles.schedule import MILLISECOND, SECOND, Cadence, nanoseconds
from vehicles.setting import Problem, Setting, must_exceed

# ---- Reactive congestion control of ETSI TS 102 687 V1.2.1, Annex A.1


BUSY_RATIOS = (0.0, 0.30, 0.40, 0.50, 0.60)  # Lower bound of each state (TS 102 687)
MIN_INTERVALS = tuple(span * MILLISECOND for span in (100, 200, 400, 500, 1000))
"""Minimum time (ns) between two messages in each state (TS 102 687)."""


@dataclass(frozen=True, slots=True)
class BusyRatioEntry:
    """The channel busy ratio from `at_s` on."""

    at: Annotated[float, Setting("time after the start of the run", "s", 0, example=10.0)]
    busy: Annotated[float, Setting("channel busy ratio", "ratio", 0, 1, example=0.45)]


@dataclass(frozen=True, slots=True)
class CongestionControl:
    """Reactive congestion control: a minimum interval that grows with the channel busy ratio.

    Minimum interval 100, 200, 400, 500, 1000 ms from busy ratios of 0, 0.3, 0.4, 0.5, 0.6. A
    message that is due earlier is skipped; with "every_fix" and "intervals" it waits.
    """

    busy: Annotated[
        tuple[BusyRatioEntry, ...], Setting("in order of time; 0 before the first", nonempty=True)
    ]
    period: Annotated[
        int, Setting("period of evaluations, each by up to one state", "ms", 10, 10_000)
    ] = 100 * MILLISECOND

    @property
    def longest_interval(self) -> int:
        """Minimum time (ns) between messages at the highest busy ratio."""
        return MIN_INTERVALS[_state_of(max(entry.busy for entry in self.busy))]


class ReactiveControl:
    """Congestion control over a run that starts at `start_at` (ns), in the lowest state."""

    def __init__(self, settings: CongestionControl, start_at: int) -> None:
        self._since = [start_at + nanoseconds(entry.at) for entry in settings.busy]
        self._targets = [0, *(_state_of(entry.busy) for entry in settings.busy)]
        self._period = settings.period
        self._next = start_at
        self._state = 0

    def min_interval(self, now: int) -> int:
        """Minimum time (ns) between messages at `now` (ns): T_off of Table A.1, TS 102 687."""
        while self._next <= now:
            target = self._targets[bisect_right(self._since, self._next)]
            self._state += (target > self._state) - (target < self._state)
            self._next += self._period
        return MIN_INTERVALS[self._state]


def _state_of(busy_ratio: float) -> int:
    return bisect_right(BUSY_RATIOS, busy_ratio) - 1


# ---- Interface of sending rules


BEFORE_EVERY_RUN: Final = -(2**62)  # An instant (ns) before every run
ROUNDING: Final = 1000  # Tolerance (ns) of intervals between instants, which are rounded to 1 ns


class SendingTrigger(Protocol):
    """The instants of sending over one run.

    `due` is called at each instant of the vehicle, `sent` after a message.
    """

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        """Whether to send at `now` (ns).

        `unsent` is the newest fix, if it has not been sent: `east`, `north` (m), `yaw` (rad),
        `speed` (m/s), `yaw_rate` (rad/s), `measured_at` (ns). Congestion control allows a message
        from `allowed_from` (ns) on.
        """
        ...

    def sent(self, now: int, fix: Fix) -> None:
        """Record that `fix` was sent at `now` (ns)."""
        return


class InstantTrigger(SendingTrigger):
    """Triggers at given instants (ns); those barred by congestion control are skipped."""

    def __init__(self, instants: Iterator[int]) -> None:
        self._instants = instants
        self._next = next(instants, NO_END)

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        is_instant = False
        while self._next <= now:
            is_instant = self._next == now
            self._next = next(self._instants, NO_END)
        return is_instant and now >= allowed_from


@dataclass(frozen=True, slots=True)
class SendingContext:
    """Start of a run for a sending rule.

    start_at  start (ns)
    streams   returns the NumPy generator of this vehicle for a purpose
    """

    start_at: int
    streams: Callable[[str], Generator]


@dataclass(frozen=True, slots=True, kw_only=True)
class SendingRule(ABC):
    """Settings of a sending rule: a frozen, keyword-only dataclass whose fields are its parameters.

    `begin(context)` returns the `SendingTrigger` of a run. Random numbers come only from the
    streams of the context, so that the same seed gives the same run. By `nominal_rate` followers
    know when a message is late; by default it is the rate of fixes.
    """

    dcc: Annotated[
        CongestionControl | None, Setting("congestion control (ETSI TS 102 687 V1.2.1, A.1)")
    ] = None
    path_history: Annotated[
        float, Setting("length of the path in each pose (SAE J2735); 0: none", "m", 0, 1000)
    ] = 300.0
    path_history_points: Annotated[
        int, Setting("largest number of its positions; bends need more of them", "", 1, 40)
    ] = 23

    @abstractmethod
    def begin(self, context: SendingContext) -> SendingTrigger:
        """Return the trigger of a run."""

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int] | None:
        """Additional instants (ns) before `end_at` at which the vehicle must take a step."""
        return None

    def max_rate(self, fixes: float) -> float:
        """Upper bound (Hz) of the rate, counted from the start; `fixes` is the rate of GNSS."""
        return fixes

    def nominal_rate(self, fixes: float, speed: float) -> float:
        """Rate (Hz) at a constant `speed` (m/s) on a straight, without congestion control."""
        return self.max_rate(fixes)

    def controlled_rate(self, fixes: float, speed: float) -> float:
        """Nominal rate (Hz), limited by the rate of fixes and by congestion control."""
        slowest = inf if self.dcc is None else SECOND / self.dcc.longest_interval
        return min(self.nominal_rate(fixes, speed), fixes, slowest)

    def problems(self) -> Iterator[Problem]:
        if self.dcc is not None:
            yield from must_increase("dcc.busy", [entry.at for entry in self.dcc.busy])


def must_increase(key: str, times: Sequence[float]) -> Iterator[Problem]:
    """Report times (s) of a list that do not increase."""
    for index, (before, after) in enumerate(pairwise(times), 1):
        yield from must_exceed(f"{key}[{index}].at_s", after, before, "the previous entry")


@dataclass(frozen=True, slots=True, kw_only=True)
class PhasedRule(SendingRule):
    """A rule with a periodic schedule, which has a phase."""

    phase: Annotated[int, Setting("time of the first message", "s", 0)] = 0
    drawn_phase: Annotated[bool, Setting("random phase per vehicle, within one period")] = False

    @property
    @abstractmethod
    def schedule_rate(self) -> float:
        """Rate (Hz) of the schedule."""

    def cadence(self, context: SendingContext) -> Cadence:
        phase = self.phase
        if self.drawn_phase:
            phase = int(context.streams("phase").random() * SECOND / self.schedule_rate)
        return Cadence(context.start_at + phase, self.schedule_rate)

    def begin(self, context: SendingContext) -> SendingTrigger:
        return InstantTrigger(self.instants(context, NO_END))

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int]:
        return self.cadence(context).until(end_at)

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        phase, period = self.phase / SECOND, 1.0 / self.schedule_rate
        if self.drawn_phase and phase:
            yield "phase_s", f"given {phase:g} together with drawn_phase, allowed one of them"
        elif phase >= period:
            yield "phase_s", f"given {phase:g}, allowed less than {period:g}, the period"


# ---- Shipped rules


@dataclass(frozen=True, slots=True, kw_only=True)
class EveryFix(SendingRule, SendingTrigger):
    """Each fix, as soon as it is available (Section III-A)."""

    def begin(self, context: SendingContext) -> SendingTrigger:
        return self

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        return unsent is not None and now >= allowed_from


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedRate(PhasedRule):
    """At a constant rate and phase, independent of control and GNSS."""

    rate: Annotated[float, Setting("rate of sending", "hz", 0.01, 100, example=10.0)]

    @property
    def schedule_rate(self) -> float:
        return self.rate

    def max_rate(self, fixes: float) -> float:
        return min(self.rate, fixes)


CAM_INTERVALS = tuple(100 * MILLISECOND * k for k in range(1, 11))
CAM_SHARES = {
    "cam_vw_highway": (0.035, 0.333, 0.141, 0.389, 0.018, 0.060, 0.004, 0.004, 0.001, 0.016),
    "cam_renault_highway": (0.056, 0.184, 0.145, 0.194, 0.174, 0.098, 0.038, 0.020, 0.007, 0.083),
}
"""Shares of the intervals between cooperative awareness messages of two makers' cars on highways
(R. Molina-Masegosa, M. Sepulcre, J. Gozalvez, F. Berens, V. Martinez, "Empirical models for the
realistic generation of cooperative awareness messages in vehicular networks", IEEE TVT 69(5), 2020,
arXiv 2004.06919). Due to rounding they add up to 1 within 0.001."""
JITTER_CUTOFF = 3.0  # Cutoff of the normal jitter, in standard deviations


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredIntervals(SendingRule):
    """At random intervals: measured (Molina-Masegosa et al., IEEE TVT 2020) or configured.

    A due message is sent at the next tick of the vehicle's schedule.
    """

    table: Annotated[
        Literal["cam_vw_highway", "cam_renault_highway"] | None,
        Setting("measured; or intervals_ms and shares_ratio", example="cam_vw_highway"),
    ] = None
    intervals: Annotated[tuple[int, ...], Setting("configured intervals", "ms", 10, 60_000)] = ()
    shares: Annotated[tuple[float, ...], Setting("share of each interval", "ratio", 0, 1)] = ()
    jitter: Annotated[
        int, Setting("deviation of the normal jitter, cut off at 3 deviations", "ms", 0, 1000)
    ] = 3 * MILLISECOND

    @property
    def distribution(self) -> tuple[Sequence[int], Sequence[float]]:
        """Intervals (ns) and their shares, in any unit."""
        if self.table is not None:
            return CAM_INTERVALS, CAM_SHARES[self.table]
        return self.intervals, self.shares

    @property
    def shortest(self) -> float:
        return min(self.distribution[0]) - JITTER_CUTOFF * self.jitter  # ns

    def draw(self, random: Generator) -> int:
        """Draw an interval (ns) by inversion of its distribution."""
        intervals, shares = self.distribution
        sums = list(accumulate(shares))
        index = bisect_right(sums, random.random() * sums[-1])
        jitter = min(max(float(random.standard_normal()), -JITTER_CUTOFF), JITTER_CUTOFF)
        return round(intervals[index] + jitter * self.jitter)

    def begin(self, context: SendingContext) -> SendingTrigger:
        return DrawnIntervalTrigger(self, context.start_at, context.streams("intervals"))

    def max_rate(self, fixes: float) -> float:
        return min(SECOND / self.shortest, fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:
        intervals, shares = self.distribution
        weighted = sum([i * s for i, s in zip(intervals, shares, strict=True)])
        return SECOND * sum(shares) / weighted

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        intervals, shares = len(self.intervals), len(self.shares)
        if self.table is None and not intervals:
            allowed = ", ".join(f'"{name}"' for name in CAM_SHARES)
            yield "table", f"missing, allowed {allowed}, or intervals_ms with shares_ratio"
        elif self.table is not None and (intervals or shares):
            yield "table", "given together with intervals_ms or shares_ratio, allowed one of them"
        elif intervals and intervals != shares:
            yield "shares_ratio", f"given {shares} numbers, allowed {intervals} as intervals_ms"
        elif intervals and sum(self.shares) <= 0.0:
            yield "shares_ratio", "given only 0, allowed at least one share above 0"
        elif (least := min(self.distribution[0])) <= 4 * self.jitter:
            allowed = f"less than a quarter of the shortest interval, {least / MILLISECOND:g} ms"
            yield "jitter_ms", f"given {self.jitter / MILLISECOND:g}, allowed {allowed}"


class DrawnIntervalTrigger(SendingTrigger):
    """Random intervals from an instant that is uniform within the first one.

    Due instants are not rounded to ticks, so the mean interval is that of the distribution. An
    interval is extended to the minimum of congestion control.
    """

    def __init__(self, rule: MeasuredIntervals, start_at: int, random: Generator) -> None:
        self._rule, self._random = rule, random
        self._next = start_at + round(random.random() * rule.draw(random))

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        at = max(self._next, allowed_from)
        if now < at:
            return False
        while at <= now:
            at += self._rule.draw(self._random)
        self._next = at
        return True


@dataclass(frozen=True, slots=True)
class RateEntry:
    """The rate of sending from `at_s` on; 0: nothing is sent."""

    at: Annotated[float, Setting("time after the start of the run", "s", 0, example=0.0)]
    rate: Annotated[float, Setting("rate from then on", "hz", 0, 100, example=10.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class RateProfile(SendingRule):
    """At a changing rate, which rescales the current period; nothing before the first entry."""

    profile: Annotated[tuple[RateEntry, ...], Setting("rates in order of time", nonempty=True)]

    def begin(self, context: SendingContext) -> SendingTrigger:
        return InstantTrigger(self.instants(context, NO_END))

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int]:
        """Yield instants (ns) at which the integral of the rate is a whole number."""
        integral, target, last = Fraction(0), 0, end_at - context.start_at
        starts = [nanoseconds(entry.at) for entry in self.profile]
        for entry, start, end in zip(self.profile, starts, [*starts[1:], last], strict=True):
            if entry.rate <= 0.0:
                continue
            rate = Fraction(entry.rate) / SECOND
            while (instant := start + (target - integral) / rate) < end:
                if round(instant) >= last:
                    return
                yield context.start_at + round(instant)
                target += 1
            integral += (end - start) * rate

    def max_rate(self, fixes: float) -> float:
        return min(max(entry.rate for entry in self.profile), fixes)

    def nominal_rate(self, fixes: float, speed: float) -> float:
        return min((entry.rate for entry in self.profile if entry.rate > 0.0), default=0.0)

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        yield from must_increase("profile", [entry.at for entry in self.profile])


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


class CamTrigger:
    """The rule of EN 302 637-2, Section 6.1.3, applied to the newest fix at each check.

    A message is due if heading, position or speed have changed enough since the last one, or else
    after the interval of the last such change. After three messages without one it is 1 s.
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
        last = self._last
        self._changed = last is not None and (
            abs(degrees(remainder(unsent.yaw - last.yaw, tau))) > HEADING
            or hypot(unsent.east - last.east, unsent.north - last.north) > POSITION
            or abs(unsent.speed - last.speed) > SPEED
        )
        elapsed = now - self._sent_at + ROUNDING
        return elapsed >= (MIN_INTERVAL if self._changed else self._interval)

    def sent(self, now: int, fix: Fix) -> None:
        if self._changed:
            self._interval, self._repeats = min(now - self._sent_at, MAX_INTERVAL), 0
        else:
            self._repeats += 1
            if self._repeats >= REPEATS:
                self._interval = MAX_INTERVAL
        self._last, self._sent_at = fix, now


def cam_interval(speed: float, check: float) -> float:
    """Interval (s) of messages by EN 302 637-2 at a constant speed (m/s), checked each `check` (s).

    On a straight, a message is due at the first check after more than 4 m and 0.1 to 1 s.
    """
    least, most = MIN_INTERVAL / SECOND, MAX_INTERVAL / SECOND
    after_distance = floor((POSITION + 1e-9) / (check * max(speed, POSITION / most))) + 1
    return min(max(after_distance, ceil((least - 1e-9) / check)) * check, most)


RULES: Mapping[str, type[SendingRule]] = {
    "every_fix": EveryFix,
    "fixed": FixedRate,
    "profile": RateProfile,
    "cam": AwarenessMessages,
    "intervals": MeasuredIntervals,
}


# ---- A vehicle's sender


class Sender:
    """Sends the newest fix when `rule` triggers, each fix at most once.

    `control` limits the rate (TS 102 687). `path` records each fix for the path history.
    """

    def __init__(
        self,
        rule: SendingTrigger | None = None,
        control: ReactiveControl | None = None,
        path: PathHistory | None = None,
    ) -> None:
        self.path = path
        self._rule: SendingTrigger = rule or EveryFix()
        self._control = control
        self._unsent: Fix | None = None
        self._sent_at = BEFORE_EVERY_RUN

    def send(
        self,
        now: int,
        fix: Fix | None,
        estimate: Callable[[int], Fix | None] | None = None,
        *,
        on_path: bool = True,
    ) -> Fix | None:
        """Take the new fix at `now` (ns), if any; return the fix to send, if any.

        A car is `on_path` unless it announces a hazard or slows down without a source. `estimate`
        gives its position by dead reckoning, which the path history has where fixes are missing.
        """
        if fix is not None:
            self._unsent = fix
            if self.path is not None:
                self.path.record(fix, on_path=on_path)
        elif self.path is not None and self._unsent is None and estimate is not None:
            self.path.record_missing(now, estimate, on_path=on_path)
        allowed_from = BEFORE_EVERY_RUN
        if self._control is not None:
            allowed_from = self._sent_at + self._control.min_interval(now) - ROUNDING
        if not self._rule.due(now, self._unsent, allowed_from) or self._unsent is None:
            return None
        sent, self._unsent = self._unsent, None
        self._sent_at = now
        self._rule.sent(now, sent)
        return sent
