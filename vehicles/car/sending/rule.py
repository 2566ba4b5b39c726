"""Interface of sending rules."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Annotated, Protocol

from numpy.random import Generator

from vehicles.car.gnss import Fix
from vehicles.car.sending.congestion import CongestionControl, min_interval_at
from vehicles.schedule import SECOND, Cadence
from vehicles.setting import Problem, Setting, must_exceed


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
        ...


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
    know when a message is late; by default it is the rate of fixes. `describe` is for tables.
    """

    dcc: Annotated[
        CongestionControl | None,
        Setting("reactive congestion control (ETSI TS 102 687 V1.2.1, A.1), for any rule"),
    ] = None
    path_history: Annotated[
        float,
        Setting(
            "length of the driven path that each pose carries (SAE J2735); 0: none", "m", 0, 1000
        ),
    ] = 300.0
    path_history_points: Annotated[
        int, Setting("largest number of its positions; bends need more of them", "", 1, 40)
    ] = 23

    @property
    def is_periodic(self) -> bool:
        """Whether messages are periodic, except for missing fixes."""
        return False

    @property
    def first_send_delay(self) -> int:
        """Time (ns) from the start to the first message, if it is not random."""
        return 0

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
        return fixes

    def controlled_rate(self, fixes: float, speed: float) -> float:
        """Nominal rate (Hz), limited by the rate of fixes and by congestion control."""
        slowest = inf if self.dcc is None else SECOND / min_interval_at(self.dcc.max_busy_ratio)
        return min(self.nominal_rate(fixes, speed), fixes, slowest)

    def problems(self) -> Iterator[Problem]:
        if self.dcc is not None:
            yield from must_increase("dcc.busy", [entry.at for entry in self.dcc.busy])

    def describe(self) -> str:
        return type(self).__name__


def must_increase(key: str, times: Sequence[float]) -> Iterator[Problem]:
    """Report times (s) of a list that do not increase."""
    for index, (before, after) in enumerate(pairwise(times), 1):
        yield from must_exceed(f"{key}[{index}].at_s", after, before, "the previous entry")


@dataclass(frozen=True, slots=True, kw_only=True)
class PhasedRule(SendingRule):
    """A rule with a periodic schedule, which has a phase."""

    phase: Annotated[int, Setting("time of the first message", "s", 0)] = 0
    drawn_phase: Annotated[bool, Setting("true: random phase per vehicle, within one period")] = (
        False
    )

    @property
    def first_send_delay(self) -> int:
        return self.phase

    @property
    @abstractmethod
    def schedule_rate(self) -> float:
        """Rate (Hz) of the schedule."""

    def cadence(self, context: SendingContext) -> Cadence:
        phase = self.phase
        if self.drawn_phase:
            phase = int(context.streams("phase").random() * SECOND / self.schedule_rate)
        return Cadence(context.start_at + phase, self.schedule_rate)

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int] | None:
        return self.cadence(context).until(end_at)

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        phase, period = self.phase / SECOND, 1.0 / self.schedule_rate
        if self.drawn_phase and phase:
            yield "phase_s", f"given {phase:g} together with drawn_phase, allowed one of them"
        elif phase >= period:
            yield "phase_s", f"given {phase:g}, allowed less than {period:g}, the period"

    def describe_phase(self) -> str:
        return "random phase" if self.drawn_phase else f"phase {self.phase / SECOND:g} s"
