"""One run of a study: a scenario with overrides and a seed."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from math import exp, log, sqrt
from statistics import fmean, stdev

from scenarios.definition.run_limits import Limit, parsed_limit
from scenarios.definition.scenario import Scenario, scenario_from_text, scenario_text
from scenarios.results.limits import broken_by
from scenarios.results.links import CONFIDENCE, quantile_of_normal
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual import run_unlogged

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


def mean_interval(
    values: Sequence[float], confidence: float = CONFIDENCE, *, is_gain: bool = False
) -> tuple[float, float | None, float | None]:
    """Mean of independent values, and the ends of Student's t interval.

    The interval needs two values and SciPy. Of a right-skewed law, such as that of the estimates of
    a small probability, it is slightly too low with few values. The mean of positive gains is the
    geometric one, with the interval of the logarithms.
    """
    if is_gain and min(values) > 0.0:
        mean, low, high = mean_interval(list(map(log, values)), confidence)
        return exp(mean), low if low is None else exp(low), high if high is None else exp(high)
    mean = fmean(values)
    if len(values) < 2 or not find_spec("scipy"):
        return mean, None, None
    from scipy.stats import t  # noqa: PLC0415 - optional

    error = stdev(values) / sqrt(len(values))
    half = float(t.ppf(0.5 + 0.5 * confidence, len(values) - 1)) * error
    return mean, mean - half, mean + half


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
        """Run, and return whether the limit was broken.

        Raises PlugInError if the limit is on a figure of the user's class that fails.
        """
        return broken_by(limit, self.run())


def variant_of(name: str, overrides: Sequence[str] = (), seed: int = 1) -> Variant:
    """Read a scenario with the files that it names; raises ScenarioError."""
    text, read_with = scenario_text(name, overrides)
    return Variant(text=text, name=name, overrides=tuple(overrides), seed=seed, read_with=read_with)


def limited_variant(name: str, overrides: Sequence[str], limit: str) -> tuple[Variant, Limit]:
    """Read a scenario and a limit of its convoy, such as "v4.error_m=0.5"; raises ScenarioError."""
    variant = variant_of(name, overrides)
    scenario = variant.scenario
    return variant, parsed_limit(limit, scenario.vehicle_names, scenario.own_figures)
