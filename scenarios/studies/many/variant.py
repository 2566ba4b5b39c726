"""One run of a study: a scenario with overrides and a seed."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, sqrt
from statistics import fmean, stdev

from scenarios.definition.run_limits import Limit, parsed_limit
from scenarios.definition.scenario import Scenario, scenario_from_text, scenario_text
from scenarios.results.limits import SIGNALS, broken_by, first_breach
from scenarios.results.links import CONFIDENCE, quantile_of_normal
from scenarios.results.summary import RunSummary
from scenarios.results.tables import RunTables
from scenarios.runs.run_log import may_end_early
from scenarios.runs.virtual import run_tables, run_unlogged

# ---- Confidence intervals of shares and means


def agresti_coull(
    successes: int, count: int, confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Agresti-Coull interval of the share `successes` of `count`; needs no SciPy.

    It has the centre of Wilson's interval and contains it: Wilson's covers a share near 0 in 84 %
    of the cases, this one any share in at least 92 % from 10 runs on. (0, 1) without any run.
    Raises ValueError for impossible counts. Agresti and Coull, The American Statistician 52, 1998.
    """
    if not count and not successes:
        return 0.0, 1.0
    _check(successes, count)
    z = quantile_of_normal(confidence)
    centre = (successes + 0.5 * z * z) / (count + z * z)
    half = z * sqrt(centre * (1.0 - centre) / (count + z * z))
    return max(0.0, centre - half), min(1.0, centre + half)


def _check(successes: int, count: int) -> None:
    if not 0 <= successes <= count or not count:
        raise ValueError(f"{successes} of {count}")


@dataclass(frozen=True, slots=True)
class Mean:
    """Mean of independent values with its standard error and interval."""

    value: float
    standard_error: float
    low: float
    high: float


def mean_of(values: Sequence[float], confidence: float = CONFIDENCE) -> Mean:
    """Mean of independent values with Student's t interval.

    Of a right-skewed law, such as that of the estimates of a small probability, the interval is
    slightly too low with few values. Raises ValueError for fewer than two values.
    """
    from scipy.stats import t  # noqa: PLC0415 - optional

    if len(values) < 2:
        raise ValueError(f"no interval of {len(values)} values")
    value = fmean(values)
    error = stdev(values) / sqrt(len(values))
    half = float(t.ppf(0.5 + 0.5 * confidence, len(values) - 1)) * error
    return Mean(value, error, value - half, value + half)


def geometric_mean_of(values: Sequence[float], confidence: float = CONFIDENCE) -> Mean:
    """Geometric mean of independent positive values, such as gains: `mean_of` their logarithms.

    Raises ValueError for fewer than two values, and for any that are not positive.
    """
    logs = mean_of([log(value) for value in values], confidence)
    value = exp(logs.value)
    return Mean(value, value * logs.standard_error, exp(logs.low), exp(logs.high))


# ---- Variant


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A run that needs no file: `text` is a complete scenario, as in `Scenario.text`.

    `name` is a shipped name or a path, as entered by the user. `overrides` (`key.path=value`) and
    `seed` replace values in `text`, except those overrides that it was `read_with`.
    """

    text: str
    name: str
    overrides: tuple[str, ...] = ()
    seed: int = 1
    read_with: tuple[str, ...] = ()

    @property
    def scenario(self) -> Scenario:
        """The scenario; raises ScenarioError for invalid overrides."""
        others = [text for text in self.overrides if text not in self.read_with]
        return scenario_from_text(self.text, label=self.name, overrides=others, seed=self.seed)

    @property
    def command(self) -> str:
        sets = [f"--set={text}" for text in self.overrides]
        parts = ("convoy", "run", self.name, *sets, "--seed", str(self.seed), "--clock", "virtual")
        return shlex.join(parts)

    def run(self) -> RunSummary:
        return run_unlogged(self.scenario)

    def breaks(self, limit: Limit) -> bool:
        """Run until the limit is broken or the run ends; return whether it was broken.

        Faster than a summary and the same as `broken_by` it. A failed vehicle ends the run. Raises
        PlugInError if the limit is on a figure of the user's class that fails.
        """
        scenario = self.scenario
        if limit.row.live not in SIGNALS and not limit.row.event:
            return broken_by(limit, run_unlogged(scenario))
        limits = scenario.tables.limits

        def breach(run: RunTables) -> int | None:
            """Instant of the breach, if no collision ended the run before."""
            at = first_breach(run, limit)
            end = first_breach(run, Limit("collisions_max", limits.collisions_max or 0))
            is_ended = may_end_early(scenario) and end is not None and at is not None and end < at
            return None if is_ended else at

        run, _ = run_tables(scenario, is_over=lambda run: breach(run) is not None)
        return breach(run) is not None


def variant_of(name: str, overrides: Sequence[str] = (), seed: int = 1) -> Variant:
    """Read a scenario with the files that it names; raises ScenarioError."""
    text, read_with = scenario_text(name, overrides)
    return Variant(text=text, name=name, overrides=tuple(overrides), seed=seed, read_with=read_with)


def limited_variant(name: str, overrides: Sequence[str], limit: str) -> tuple[Variant, Limit]:
    """Read a scenario and a limit of its convoy, such as "v4.error_m=0.5"; raises ScenarioError."""
    variant = variant_of(name, overrides)
    scenario = variant.scenario
    return variant, parsed_limit(limit, scenario.vehicle_names, scenario.own_figures)
