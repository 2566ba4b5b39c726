"""Search for the most harmful time of a burst loss: a grid over the run, then finer steps.

A burst drops the messages sent during it, so results depend on time down to the message period.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from scenarios.definition.channel.rules import ANY, ROLES
from scenarios.definition.errors import ScenarioError
from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.limit_rows import WORDS
from scenarios.definition.validation.wording import toml_repr
from scenarios.results.limits.evaluation import severity
from scenarios.studies.engine.engine import Engine
from scenarios.studies.engine.job import Job
from scenarios.studies.many.variant import Variant, variant_of

PEAKS = 3
"""Number of refined times, because the highest peak may be narrow."""
EARLIEST_S = 1.0
"""Default earliest burst, when the convoy has formed."""
MIN_STEP_S = 0.001


@dataclass(frozen=True, slots=True, kw_only=True)
class BurstLoss:
    """Loss of all messages on `links` for `for_s`.

    Links are pairs of sender and receiver: names, roles or "*", as in `[[change]]`.
    """

    for_s: float
    links: tuple[tuple[str, str], ...] = ((ANY, ANY),)

    def overrides(self, at_s: float, first: int) -> tuple[str, ...]:
        """Return overrides that add the burst to a scenario with `first` changes."""
        return tuple(
            f'change.{first + place}={{kind="cut", at_s={at_s!r}, for_s={self.for_s!r}, '
            f'sender="{sender}", receiver="{receiver}"}}'
            for place, (sender, receiver) in enumerate(self.links)
        )


def parsed_burst(texts: Sequence[str], for_s: float, scenario: Scenario) -> BurstLoss:
    """Parse links given as SENDER:RECEIVER; raises ScenarioError."""
    known = (*scenario.vehicle_names, *ROLES, ANY)
    links = []
    for text in texts or (f"{ANY}:{ANY}",):
        sender, colon, receiver = text.partition(":")
        if not colon or sender not in known or receiver not in known:
            ends = ", ".join(known)
            raise ScenarioError(
                [f"--link: given {toml_repr(text)}, allowed SENDER:RECEIVER, each of {ends}"]
            )
        links.append((sender, receiver))
    return BurstLoss(for_s=for_s, links=tuple(links))


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSpan:
    """Times to search (s), first with `step_s`, in the end with `finest_s`."""

    from_s: float
    to_s: float
    step_s: float
    finest_s: float

    def grid(self) -> list[float]:
        """The times of the first pass, with both ends."""
        count = int((self.to_s - self.from_s) / self.step_s + 1e-9)
        inner = [round(self.from_s + place * self.step_s, 3) for place in range(count + 1)]
        return sorted({*inner, self.to_s})

    def neighbours(self, at_s: float, step_s: float) -> list[float]:
        """Times one step before and after `at_s`, within the span."""
        sides = (round(at_s - step_s, 3), round(at_s + step_s, 3))
        return [side for side in sides if self.from_s <= side <= self.to_s]


def search_span(
    scenario: Scenario,
    burst: BurstLoss,
    *,
    from_s: float | None,
    to_s: float | None,
    step_s: float,
    finest_s: float,
) -> SearchSpan:
    """Return the span to search, by default all times at which the burst ends within the run.

    Raises ScenarioError for invalid or empty spans.
    """
    last = round(scenario.duration_s - burst.for_s, 3)
    first = min(EARLIEST_S, max(last, 0.0)) if from_s is None else from_s
    end = last if to_s is None else to_s
    runs_s = f"the run's {scenario.duration_s:g}"
    if not 0.0 < burst.for_s < scenario.duration_s:
        raise ScenarioError(
            [f"--burst: given {burst.for_s:g} s, allowed more than 0, less than {runs_s}"]
        )
    if not MIN_STEP_S <= finest_s <= step_s:
        raise ScenarioError(
            [
                f"--step, --finest: given {step_s:g} and {finest_s:g} s, allowed --finest from "
                f"{MIN_STEP_S:g} s up to --step"
            ]
        )
    if not first <= end <= last:
        raise ScenarioError(
            [
                f"--from, --to: given {first:g} to {end:g} s, allowed --from up to --to, and "
                f"--to up to {last:g} s, when the burst ends with the run"
            ]
        )
    return SearchSpan(from_s=first, to_s=end, step_s=step_s, finest_s=finest_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstInstant:
    """Result of a search: the worst time, the worst run at this time, and all times.

    `figure` is the value of `variant`, the worst seed at this time. `figures` are the means over
    all seeds by time (s), in order of time.
    """

    word: str
    at_s: float
    figure: float
    figures: Mapping[float, float]
    variant: Variant

    @property
    def mean(self) -> float:
        """Mean of the figure over the seeds at the worst time."""
        return self.figures[self.at_s]


@dataclass(slots=True)
class WorstSearch:
    """Search for the time at which `burst` makes a figure of `base` worst.

    `word` is "error_m" (the largest true error) or "gap_m" (the smallest true gap). The search
    maximizes the mean over `seeds` runs, from the seed of `base` on. All times share the seeds.
    `changes` is the number of changes in `base`.
    """

    base: Variant
    burst: BurstLoss
    word: str
    engine: Engine
    changes: int = 0
    seeds: int = 1
    _runs: dict[float, dict[int, float]] = field(default_factory=dict)

    def run(self, span: SearchSpan) -> WorstInstant:
        """Search a grid, then with halved steps around its worst times."""
        self._simulate(span.grid())
        step = span.step_s
        while step > span.finest_s:
            step *= 0.5
            near = {at for peak in self._peaks(2.0 * step) for at in span.neighbours(peak, step)}
            self._simulate(sorted(near - self._runs.keys()))
        worst = self._worst()
        at = worst[0][0]
        runs = self._runs[at]
        seed = max(sorted(runs), key=runs.__getitem__)
        return WorstInstant(
            word=self.word,
            at_s=at,
            figure=self._figure(runs[seed]),
            figures={time: self._figure(mean) for time, mean in sorted(worst)},
            variant=self.variant(at, seed),
        )

    def variant(self, at_s: float, seed: int | None = None) -> Variant:
        """Return the run with the burst at a time, by default with the seed of `base`."""
        return replace(
            self.base,
            overrides=(*self.base.overrides, *self.burst.overrides(at_s, self.changes)),
            seed=self.base.seed if seed is None else seed,
        )

    def _peaks(self, apart_s: float) -> list[float]:
        """The worst times more than `apart_s` apart, so that no peak counts twice."""
        peaks: list[float] = []
        for at, _ in self._worst():
            if len(peaks) < PEAKS and all(abs(at - peak) > apart_s + 1e-6 for peak in peaks):
                peaks.append(at)
        return peaks

    def _worst(self) -> list[tuple[float, float]]:
        """Times with their mean severities, the worst first, of equals the earliest."""
        means = [
            (at, sum(runs[seed] for seed in sorted(runs)) / self.seeds)
            for at, runs in self._runs.items()
            if len(runs) == self.seeds
        ]
        return sorted(means, key=lambda time: (-time[1], time[0]))

    @property
    def field(self) -> str:
        """Summary field of the figure."""
        return WORDS[self.word].figure

    def _figure(self, severity: float) -> float:
        return -severity if WORDS[self.word].is_least else severity

    def _simulate(self, times: Sequence[float]) -> None:
        seeds = range(self.base.seed, self.base.seed + self.seeds)
        samples = [(at, seed) for at in times for seed in seeds]
        jobs = []
        for at, seed in samples:
            variant = self.variant(at, seed)
            key, work = f"{at}/{seed}", partial(_severity, variant, self.word)
            jobs.append(Job(key=key, work=work, command=variant.command))
        for (at, seed), badness in zip(samples, self.engine.results(jobs), strict=True):
            self._runs.setdefault(at, {})[seed] = badness
        at, mean = self._worst()[0]
        self.engine.progress.stage = f"worst at {at:g} s: {self.field} {self._figure(mean):.3f}"


def _severity(variant: Variant, word: str) -> float:
    """Severity of a run (m): its largest true error, or its negative smallest gap."""
    return severity(Limit(WORDS[word].key, 0.0), variant.run())


def base_variant(name: str, overrides: Sequence[str], seed: int | None) -> Variant:
    """Return the run to search; raises ScenarioError if it is invalid."""
    return variant_of(name, overrides, load_scenario(name, overrides, seed).seed)
