"""One run again with other losses: how bad it gets, and whether it breaks a limit."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from math import inf
from typing import Literal

from scenarios.definition.scenario import Scenario
from scenarios.results.drives import KINDS
from scenarios.results.events.detector import detector_of
from scenarios.runs.node.fault import VehicleFaultError
from scenarios.runs.observer import OnMessage, listeners_by_kind
from scenarios.runs.virtual.convoy import VirtualConvoy
from scenarios.runs.virtual.drive import ObservedSink
from scenarios.studies.many.limit import EVENTS, Limit
from vehicles.geometry.driven_path import CrossTrackError
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import SECOND

FigureName = Literal["error", "gap"]
"""The largest true cross-track error of a follower, or the smallest true gap to who is ahead."""
Truth = dict[tuple[str, int], tuple[float, float]]
"""True poses (east, north, m) by vehicle and instant (ns after the start)."""
EVER = 2**63


@dataclass(frozen=True, slots=True, kw_only=True)
class BlameQuestion:
    """What is to be known of runs: by which figure and limit, and until when (ns)."""

    figure: FigureName
    limit: Limit
    until: int = EVER


@dataclass(frozen=True, slots=True, kw_only=True)
class BlameAnswer:
    """What a run came to: its worst figure (m), of whom and when, and if the limit was broken.

    A gap is the worse the smaller it is, so as `badness_m` it is negative. Instants are in ns after
    the start; `broken_at` is when the breach was known, None without one. `series` and `truth` are
    there where they were asked for: instants (s) and figures (m) of each vehicle, true poses.
    """

    badness_m: float
    vehicle: str
    worst_at: int
    broken_at: int | None
    series: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    truth: Truth = field(default_factory=dict)

    @property
    def figure_m(self) -> float:
        """The figure itself: the largest error, or the smallest gap."""
        return abs(self.badness_m)


class RerunWatch:
    """Takes the true poses and what is steered along of a run, live or from a log."""

    def __init__(self, scenario: Scenario, question: BlameQuestion, start_at: int) -> None:
        self.question = question
        self._start_at = start_at
        self._detector = detector_of(scenario)
        self._detector.begin(start_at)
        names = scenario.vehicle_names
        self._path = CrossTrackError(names[0], scenario.route.start_yaw, names[1:])
        self._series: dict[str, list[tuple[float, float]]] = {name: [] for name in names[1:]}
        self._behind = dict(pairwise(names))
        self._truth: Truth = {}
        self._worst = (-inf, "", 0)
        self.broken_at: int | None = None
        self.now = 0

    def listen(self, message: Message) -> None:
        """Take one message; what is no figure is passed over."""
        if isinstance(message, TruePose):
            self.now = message.true_at_ns - self._start_at
            if self.now > self.question.until:
                return
            self._truth[message.vehicle, self.now] = message.east_m, message.north_m
            self._detector.add_truth(message)
            for foot in self._path.add(message):
                error = abs(foot.lateral)
                self._note("error", foot.vehicle, foot.at_ns, error)
                self._judge("error_m", beyond=error > self.question.limit.bound)
            for name, at, gap in self._gaps(message):
                self._note("gap", name, at, -gap)
                self._judge("gap_m", beyond=gap < self.question.limit.bound)
        elif isinstance(message, Tracking) and self.now <= self.question.until:
            self._detector.add_tracking(message)
        self._hear_of_events()

    def _gaps(self, pose: TruePose) -> Iterator[tuple[str, int, float]]:
        """Gaps that are known now: instant (ns) and metres, by who keeps them."""
        gaps = self._detector.encounters.gaps
        for name in (pose.vehicle, self._behind.get(pose.vehicle, "")):
            gap = gaps.get(name)
            if gap is not None and gap.now_at_ns == pose.true_at_ns:
                yield name, gap.now_at_ns, gap.now_m

    def _note(self, figure: FigureName, vehicle: str, at: int, badness: float) -> None:
        if figure != self.question.figure:
            return
        after = at - self._start_at
        self._series[vehicle].append((after / SECOND, abs(badness)))
        if badness > self._worst[0]:
            self._worst = badness, vehicle, after

    def _judge(self, word: str, *, beyond: bool) -> None:
        if beyond and self.question.limit.word == word and self.broken_at is None:
            self.broken_at = self.now

    def _hear_of_events(self) -> None:
        kind = EVENTS.get(self.question.limit.word)
        for event in self._detector.news():
            if event.kind == kind and self.broken_at is None:
                self.broken_at = self.now

    def answer(self, *, whole: bool = False) -> BlameAnswer:
        """What it came to; `whole` with the series and the true poses."""
        self._detector.finish()
        self._hear_of_events()
        badness, vehicle, at = self._worst
        return BlameAnswer(
            badness_m=badness if vehicle else 0.0,
            vehicle=vehicle,
            worst_at=at,
            broken_at=self.broken_at,
            series=self._series if whole else {},
            truth=self._truth if whole else {},
        )


def answer_of(
    scenario: Scenario, question: BlameQuestion, start_at: int, told: Iterable[Message]
) -> BlameAnswer:
    """What a run that is over came to, by its messages."""
    watch = RerunWatch(scenario, question, start_at)
    for message in told:
        watch.listen(message)
    return watch.answer(whole=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is asked of a run, and if it may end once the limit is broken; `whole`: with series."""

    question: BlameQuestion
    whole: bool = False
    ends_when_broken: bool = False


class Rerun:
    """A run in virtual time without a log, until what is asked of it is answered."""

    def __init__(self, scenario: Scenario, asked: Asked) -> None:
        self.convoy = VirtualConvoy(scenario)
        self.watch = RerunWatch(scenario, asked.question, scenario.start_at_ns)
        self._asked = asked
        self._answered = False

    def turn(self, scenario: Scenario, asked: Asked) -> None:
        """Go on with other losses, the same so far, and another question about the same figures."""
        self.convoy.judge_by(scenario)
        self._asked = asked
        self.watch.question = asked.question

    def run(self) -> BlameAnswer:
        """Drive; what it came to."""
        bus, now = self.convoy.bus, self.convoy.clock.now
        listeners = listeners_by_kind([OnMessage(self._listen, KINDS)])
        self.convoy.build(lambda vehicle: ObservedSink(vehicle, bus, now, listeners))
        with suppress(VehicleFaultError):  # what it came to until a vehicle cannot drive on counts
            self.convoy.run(lambda: self._answered)
        return self.watch.answer(whole=self._asked.whole)

    def _listen(self, _at: int, message: Message) -> None:
        watch, asked = self.watch, self._asked
        watch.listen(message)
        broken = asked.ends_when_broken and watch.broken_at is not None
        if broken or watch.now > asked.question.until:
            self._answered = True


def drive(
    scenario: Scenario,
    question: BlameQuestion,
    *,
    whole: bool = False,
    ends_when_broken: bool = False,
) -> BlameAnswer:
    """Run in virtual time without a log until the question is answered."""
    asked = Asked(question=question, whole=whole, ends_when_broken=ends_when_broken)
    return run_anew(scenario, asked)


def run_anew(scenario: Scenario, asked: Asked) -> BlameAnswer:
    """The same, from the start, for what is asked."""
    return Rerun(scenario, asked).run()
