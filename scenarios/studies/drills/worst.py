"""The instant at which a burst of losses does most harm: a grid over the run, then ever closer.

A burst loses what is sent during it, so instants matter down to the spacing of messages.
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
from scenarios.studies.many.variant import Variant

PEAKS = 3
"""The worst instants that are searched more closely: the highest peak may be narrow."""
EARLIEST_S = 1.0
"""By default no burst is earlier: a convoy has formed by then."""
MIN_STEP_S = 0.001
"""Instants are whole milliseconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BurstLoss:
    """Loss of all messages on `links`, pairs of sender and receiver, for `for_s`.

    Ends are names, roles or "*", as in `[[change]]`.
    """

    for_s: float
    links: tuple[tuple[str, str], ...] = ((ANY, ANY),)

    def overrides(self, at_s: float, first: int) -> tuple[str, ...]:
        """Overrides that add the burst to a scenario with `first` changes of its own."""
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
    """Instants to search (s), first every `step_s`, at last every `finest_s`."""

    from_s: float
    to_s: float
    step_s: float
    finest_s: float

    def grid(self) -> list[float]:
        """The first instants, with both ends."""
        count = int((self.to_s - self.from_s) / self.step_s + 1e-9)
        inner = [round(self.from_s + place * self.step_s, 3) for place in range(count + 1)]
        return sorted({*inner, self.to_s})

    def neighbours(self, at_s: float, step_s: float) -> list[float]:
        """Instants a step away on both sides of one, inside of the span."""
        sides = (round(at_s - step_s, 3), round(at_s + step_s, 3))
        return [one for one in sides if self.from_s <= one <= self.to_s]


def search_span(
    scenario: Scenario,
    burst: BurstLoss,
    *,
    from_s: float | None,
    to_s: float | None,
    step_s: float,
    finest_s: float,
) -> SearchSpan:
    """Return the span to search; by default all instants at which the burst ends within the run.

    Raises ScenarioError if there are none.
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
                f"--step, --finest: given {step_s:g} and {finest_s:g} s, allowed the first at "
                f"least the second, and that at least {MIN_STEP_S:g}"
            ]
        )
    if not first <= end <= last:
        raise ScenarioError(
            [
                f"--from, --to: given {first:g} to {end:g} s, allowed in order and at most "
                f"{last:g}, where the burst ends with the run"
            ]
        )
    return SearchSpan(from_s=first, to_s=end, step_s=step_s, finest_s=finest_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstInstant:
    """The result of a search: the instant, the worst run there, and all tried instants.

    `figure` is that of `variant`, whose seed has the worst figure at this instant; `figures` are
    the means over all seeds by instant (s), in order of time.
    """

    word: str
    at_s: float
    figure: float
    figures: Mapping[float, float]
    variant: Variant

    @property
    def mean(self) -> float:
        """Mean of the figure over the seeds, by which this instant is the worst."""
        return self.figures[self.at_s]


@dataclass(slots=True)
class WorstSearch:
    """A search for the instant at which `burst` makes a figure of `base` worst.

    `word` names the figure, "error_m" (the largest true error) or "gap_m" (the smallest true gap).
    An instant is rated by its mean over `seeds` runs, from the seed of `base` on: with a single
    seed the noise may decide. All instants share the seeds. `changes` is the number of changes of
    `base` itself.
    """

    base: Variant
    burst: BurstLoss
    word: str
    engine: Engine
    changes: int = 0
    seeds: int = 1
    _runs: dict[float, dict[int, float]] = field(default_factory=dict)

    def run(self, span: SearchSpan) -> WorstInstant:
        """Search a grid, and then closer and closer around its worst instants."""
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
            figures={one: self._figure(mean) for one, mean in sorted(worst)},
            variant=self.variant(at, seed),
        )

    def variant(self, at_s: float, seed: int | None = None) -> Variant:
        """The run with the burst at an instant, with the seed of `base` or another."""
        return replace(
            self.base,
            overrides=(*self.base.overrides, *self.burst.overrides(at_s, self.changes)),
            seed=self.base.seed if seed is None else seed,
        )

    def _peaks(self, apart_s: float) -> list[float]:
        """The worst instants more than `apart_s` apart, as neighbours of a peak are as bad."""
        peaks: list[float] = []
        for at, _ in self._worst():
            if len(peaks) < PEAKS and all(abs(at - one) > apart_s + 1e-6 for one in peaks):
                peaks.append(at)
        return peaks

    def _worst(self) -> list[tuple[float, float]]:
        """Instants with runs of all seeds and their mean severities: worst first, then earliest."""
        means = [
            (at, sum(runs[seed] for seed in sorted(runs)) / self.seeds)
            for at, runs in self._runs.items()
            if len(runs) == self.seeds
        ]
        return sorted(means, key=lambda one: (-one[1], one[0]))

    def _figure(self, severity: float) -> float:
        return -severity if WORDS[self.word].is_least else severity

    def _simulate(self, instants: Sequence[float]) -> None:
        seeds = range(self.base.seed, self.base.seed + self.seeds)
        tried = [(at, seed) for at in instants for seed in seeds]
        jobs = []
        for at, seed in tried:
            variant = self.variant(at, seed)
            key, work = f"{at}/{seed}", partial(_severity, variant, self.word)
            jobs.append(Job(key=key, work=work, command=variant.command))
        for (at, seed), badness in zip(tried, self.engine.results(jobs), strict=True):
            self._runs.setdefault(at, {})[seed] = badness
        there, mean = self._worst()[0]
        what = f"the worst at {there:g} s: {self.word} {self._figure(mean):.3f}"
        self.engine.progress.stage = what


def _severity(variant: Variant, word: str) -> float:
    """Severity of a run (m): its largest true error, or its smallest gap with the sign changed."""
    return severity(Limit(WORDS[word].key, 0.0), variant.run())


def base_variant(name: str, overrides: Sequence[str], seed: int | None) -> Variant:
    """Return the run to search; raises ScenarioError."""
    whole = load_scenario(name, overrides, seed)
    return Variant(
        text=load_scenario(name).text,
        name=name,
        overrides=tuple(overrides),
        seed=whole.seed,
    )
