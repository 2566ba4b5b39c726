"""One run of many: a scenario with overrides and a seed."""

import hashlib
import shlex
from dataclasses import asdict, dataclass
from typing import Any

from scenarios.definition.run_limits import Limit
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual.unlogged_run import run_unlogged
from scenarios.studies.engine.stamp import current_stamp
from scenarios.studies.many.limit_history import watch_limit


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A run that needs no file: `text` is a whole resolved scenario, as `Scenario.text` has it.

    `name` is the name given by the user (a shipped name or a path), `overrides` are laid over
    `text` as `key.path=value`, and over them the `seed`.
    """

    text: str
    name: str
    overrides: tuple[str, ...] = ()
    seed: int = 1

    @property
    def scenario(self) -> Scenario:
        """The scenario; raises ScenarioError with the refused overrides."""
        return scenario_from_text(
            self.text, label=self.name, overrides=self.overrides, seed=self.seed
        )

    @property
    def command(self) -> str:
        """The command that repeats the run, bit for bit, with a log."""
        sets = [f"--set={text}" for text in self.overrides]
        words = ("convoy", "run", self.name, *sets, "--seed", str(self.seed), "--clock", "virtual")
        return shlex.join(words)

    def run(self) -> RunSummary:
        return run_unlogged(self.scenario)

    def breaks(self, limit: Limit) -> bool:
        """Run until the limit is broken, or to the end; returns whether it was broken."""
        return watch_limit(self.scenario, limit).broken


def identity_of(variant: Variant, **options: Any) -> dict[str, Any]:
    """All that the results of a study of `variant` depend on, by the words of the command line."""
    return {
        "SCENARIO": variant.name,
        "its content": hashlib.sha256(variant.text.encode()).hexdigest()[:12],
        "--set": list(variant.overrides),
        **{f"--{name.replace('_', '-')}": value for name, value in options.items()},
        **asdict(current_stamp()),
    }
