"""Rules by which a vehicle sends."""

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
    """The instants of sending over one run."""

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        """Whether `now` (ns) is an instant of sending.

        `waiting` is the newest fix that was not sent; from `opens` (ns) congestion control allows a
        message.
        """
        ...

    def sent(self, now: int, fix: Fix) -> None:
        """Note a fix sent at `now` (ns)."""
        ...


@dataclass(frozen=True, slots=True)
class SendingContext:
    """Start of a run (ns), and its random stream for each purpose."""

    start_at: int
    streams: Callable[[str], Generator]


@dataclass(frozen=True, slots=True, kw_only=True)
class SendingRule(ABC):
    """Settings of a rule: each subclass is a kind of `[sending]`.

    A line of the registry makes it available.
    """

    dcc: Annotated[
        CongestionControl | None,
        Setting("reactive congestion control (ETSI TS 102 687 V1.2.1, A.1) under any rule"),
    ] = None

    @property
    def is_periodic(self) -> bool:
        """Whether messages come evenly, apart from fixes that fail."""
        return False

    @property
    def first_send_delay(self) -> int:
        """Time (ns) from the start to the first message, where that is not drawn."""
        return 0

    @abstractmethod
    def begin(self, context: SendingContext) -> SendingTrigger:
        """Course of a run."""

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int] | None:  # noqa: ARG002
        """Instants (ns) before `end_at` for which the vehicle must be awake, apart from its own."""
        return None

    @abstractmethod
    def max_rate(self, fixes: float) -> float:
        """Rate (Hz) that is never exceeded, counted from the start; `fixes` is that of GNSS."""

    @abstractmethod
    def nominal_rate(self, fixes: float, speed: float) -> float:
        """Messages a second at a constant `speed` (m/s), straight on, uncontrolled."""

    def controlled_rate(self, fixes: float, speed: float) -> float:
        """Usual rate (Hz), at most that of fixes and the slowest of congestion control."""
        slowest = inf if self.dcc is None else SECOND / min_interval_at(self.dcc.max_busy_ratio)
        return min(self.nominal_rate(fixes, speed), fixes, slowest)

    def problems(self) -> Iterator[Problem]:
        """Yield keys that contradict others."""
        if self.dcc is not None:
            yield from must_increase("dcc.busy", [one.at for one in self.dcc.busy])

    @abstractmethod
    def describe(self) -> str:
        """Short description for tables."""


def must_increase(key: str, times: Sequence[float]) -> Iterator[Problem]:
    """Report times (s) of a list that do not increase."""
    for index, (before, after) in enumerate(pairwise(times), 1):
        yield from must_exceed(f"{key}[{index}].at_s", after, before, "the entry before")


@dataclass(frozen=True, slots=True, kw_only=True)
class PhasedRule(SendingRule):
    """A rule with a schedule of its own, which has a phase."""

    phase: Annotated[int, Setting("first after this time", "s", 0)] = 0
    drawn_phase: Annotated[
        bool, Setting("true: first after a part of a period drawn for each vehicle")
    ] = False

    @property
    def first_send_delay(self) -> int:
        return self.phase

    @property
    @abstractmethod
    def schedule_rate(self) -> float:
        """Rate (Hz) of the schedule."""

    def cadence(self, context: SendingContext) -> Cadence:
        """Schedule of a run."""
        phase = self.phase
        if self.drawn_phase:
            phase = int(context.streams("phase").random() * SECOND / self.schedule_rate)
        return Cadence(context.start_at + phase, self.schedule_rate)

    def instants(self, context: SendingContext, end_at: int) -> Iterator[int] | None:
        cadence = self.cadence(context)
        return cadence.until(end_at)

    def problems(self) -> Iterator[Problem]:
        yield from SendingRule.problems(self)
        phase, period = self.phase / SECOND, 1.0 / self.schedule_rate
        if self.drawn_phase and phase:
            yield "phase_s", f"given {phase:g} together with drawn_phase, allowed one of them"
        elif phase >= period:
            yield "phase_s", f"given {phase:g}, allowed less than {period:g}, the period"

    def describe_phase(self) -> str:
        """Short description of the phase, for tables."""
        return "phase drawn" if self.drawn_phase else f"phase {self.phase / SECOND:g} s"
