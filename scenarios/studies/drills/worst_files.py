"""The worst instant as a drill, a short file that extends the scenario, and as JSON."""

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
"""The limit written is this many times as wide as the figure found."""


def write_drill(found: WorstInstant, file: Path) -> None:
    """Write the worst run as a drill into a new file; raises ScenarioError.

    It extends the scenario of the search, and holds the overrides, the burst, and a limit `MARGIN`
    times as wide as the figure found.
    """
    text = drill_text(found, file)
    refuse_existing(file)
    write_file(file, text)


def drill_text(found: WorstInstant, file: Path) -> str:
    """Return the text of the drill for `file`; raises ScenarioError if it is invalid."""
    one = found.variant
    base = one.name
    if base not in (*library(), *drills()):
        base = os.path.relpath(Path(base).resolve(), file.resolve().parent)
    tables: Raw = {
        "extends": base,
        "name": file.stem,
        "description": f"a burst at the worst instant of {Path(one.name).stem}",
        "seed": one.seed,
    }
    whole = merged(read_file(one.name), one.overrides).raw
    for override in one.overrides:
        _copy_key(whole, tables, parse_override(override)[0])
    row = WORDS[found.word]
    bound = found.figure / MARGIN if row.is_least else found.figure * MARGIN
    limits = dict(tables.get("limits", {}))
    tables["limits"] = limits | {row.key: round(bound, 2)}
    text = (
        f"# A burst at {found.at_s:g} s, the worst instant that convoy worst has found: "
        f"{found.word} {found.figure:.3f}\n"
        f"# (with seed {one.seed}, of {len(found.figures)} instants tried).\n\n"
        + tomli_w.dumps(tables)
    )
    scenario_from_text(text, label=str(file), folder=file.resolve().parent)
    return text


def machine_readable(found: WorstInstant, burst: BurstLoss) -> dict[str, Any]:
    tried = [{"at_s": at, found.word: figure} for at, figure in found.figures.items()]
    return {
        "schema": SCHEMA,
        "scenario": found.variant.name,
        "seed": found.variant.seed,
        "burst_s": burst.for_s,
        "links": [list(pair) for pair in burst.links],
        "figure": found.word,
        "at_s": found.at_s,
        found.word: found.figure,
        "mean": found.mean,
        "command": found.variant.command,
        "tried": tried,
    }


def _copy_key(whole: Raw, tables: Raw, parts: tuple[str, ...]) -> None:
    """Copy the key of an override from the whole scenario; a whole array if it is in one."""
    source: Any = whole
    target: Any = tables
    for depth, part in enumerate(parts):
        source = source[part]
        if depth == len(parts) - 1 or not isinstance(source, dict):
            target[part] = source
            return
        target = target.setdefault(part, {})
