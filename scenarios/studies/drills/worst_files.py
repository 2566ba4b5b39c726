"""The worst time of a burst as a drill that extends the scenario, and as JSON."""

import os
from pathlib import Path
from typing import Any

import tomli_w

from scenarios.definition.extends import merged
from scenarios.definition.library import drills, library, read_file
from scenarios.definition.overrides import Raw, parse_override
from scenarios.definition.scenario import scenario_from_text
from scenarios.definition.schema.limit_rows import WORDS
from scenarios.studies.drills.worst import BurstLoss, WorstInstant
from scenarios.studies.engine.results import refuse_existing, write_file

SCHEMA = "convoy.worst/1"
MARGIN = 1.5
"""Factor between the figure and the limit of the drill."""


def write_drill(worst: WorstInstant, file: Path) -> None:
    """Write the worst run as a drill into a new file; raises ScenarioError if it exists.

    The drill extends the scenario of the search with the overrides, the burst, and a limit with the
    factor `MARGIN`.
    """
    text = drill_text(worst, file)
    refuse_existing(file)
    write_file(file, text)


def drill_text(worst: WorstInstant, file: Path) -> str:
    """Return the text of the drill for `file`; raises ScenarioError if it is invalid."""
    variant = worst.variant
    base = variant.name
    if base not in (*library(), *drills()):
        base = os.path.relpath(Path(base).resolve(), file.resolve().parent)
    tables: Raw = {
        "extends": base,
        "name": file.stem,
        "description": f"burst loss at the worst time of {Path(variant.name).stem}",
        "seed": variant.seed,
    }
    whole = merged(read_file(variant.name), variant.overrides).raw
    for override in variant.overrides:
        _copy_key(whole, tables, parse_override(override)[0])
    row = WORDS[worst.word]
    bound = worst.figure / MARGIN if row.is_least else worst.figure * MARGIN
    limits = dict(tables.get("limits", {}))
    tables["limits"] = limits | {row.key: round(bound, 2)}
    text = (
        f"# Burst loss at {worst.at_s:g} s, the worst of {len(worst.figures)} start times\n"
        f"# simulated by `convoy worst`: {row.figure} {worst.figure:.3f}, "
        f"seed {variant.seed}.\n\n" + tomli_w.dumps(tables)
    )
    scenario_from_text(text, label=str(file), folder=file.resolve().parent)
    return text


def machine_readable(worst: WorstInstant, burst: BurstLoss) -> dict[str, Any]:
    name = WORDS[worst.word].figure
    return {
        "schema": SCHEMA,
        "scenario": worst.variant.name,
        "seed": worst.variant.seed,
        "burst_s": burst.for_s,
        "links": [list(pair) for pair in burst.links],
        "figure": name,
        "at_s": worst.at_s,
        name: worst.figure,
        "mean": worst.mean,
        "command": worst.variant.command,
        "simulated": [{"at_s": at, name: mean} for at, mean in worst.figures.items()],
    }


def _copy_key(whole: Raw, tables: Raw, parts: tuple[str, ...]) -> None:
    """Copy the key of an override from the whole scenario, or the array that contains it."""
    source: Any = whole
    target: Any = tables
    for depth, part in enumerate(parts):
        source = source[part]
        if depth == len(parts) - 1 or not isinstance(source, dict):
            target[part] = source
            return
        target = target.setdefault(part, {})
